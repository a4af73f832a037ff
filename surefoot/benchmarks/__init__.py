"""Benchmarks: one file per time-critical function, compared with named other packages.

Read `benchmark` (the timing method) first, then any file. A bound is a ratio of times, at accuracy that is no worse;
absolute times are reported but not judged.
"""
