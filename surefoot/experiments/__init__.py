"""Experiments: one file per published table or figure, and per claim of ours.

Read `experiment` (what every one of them is made of), then any file: it measures, and holds what it
measured against its targets. `surefoot experiment` lists them; `surefoot experiment ID` runs one.
"""
