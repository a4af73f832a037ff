"""Experiments: one file per published table or figure, and per claim of ours.

Read `support/experiment.py` first (figures, targets, registry), then any experiment. One room per paper
(`seed_000`, `seed_001`, `seed_003`, `seed_004`), `joint` for the whole system, `real` for real recordings.
`surefoot experiment` lists them; `surefoot experiment ID` runs one and compares its figures with the targets.
"""
