"""Benchmarks: one file per hot path, ours against a named peer in the same process, interleaved.

Read `benchmark` (how two things are timed fairly), then any file. A bar is a ratio, at no worse accuracy;
absolute times are shown and never judged.
"""
