"""Run folders: writing and reading the files of a run.

Read `run_folder` first (one run on disk), then `tables` (CSV and TUM readers), `row_stream` (tables written
during a run) and `formats` (cells, JSON values). `measurement_log`, `ground_truth_log` and
`trajectory_uncertainty` each define some of the tables; docs/outputs.md lists all of them. `registry` loads
experiments and benchmarks by name.
"""
