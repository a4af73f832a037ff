"""Runs: simulated walks and processed recordings.

Read in this order: `pipeline` (perception, frame by frame), `maps` (what it remembers), `perception_source` (its
protocol), `bodies` (robot or playback), `loop` (the walking loop), `run_recorder` and `summary` (results), `simulate`
and `process` (whole runs), `checkpoint` (resuming a run). `process_log` localises a wheeled robot in its log.
"""
