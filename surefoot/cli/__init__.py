"""The command line.

Read `main` first (the program and its verbs), then `run_verbs` (simulate, process, smooth), `recording_verbs` (map,
panorama, monocular) and `study_verbs` (evaluate, view, experiment, bench, doctor, completion). `options` holds what
several verbs share, `terminal` progress, errors and exit codes. `doctor`, `bootstrap` and `warmup` set up a machine.
"""
