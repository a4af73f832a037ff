"""The last check on a footstep among static and moving obstacles.

In reading order: `prediction` (motion patterns learnt from tracks), `hypotheses` (where obstacles may be during the
next seconds), `guard` with `guard_settings` (rollout of candidate plans, choice of the step), `line_of_sight` (the
target by which plans are judged), `step_filter` (the protocol). Modules whose names end in `_kernels` hold
compiled loops.

Source: ours.
"""
