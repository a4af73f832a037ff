"""Evaluation of runs against ground truth.

Read `evaluate` first (all figures of one run), then `targets` (their bounds and the closing table) and
`metrics` (the formulas).
"""
