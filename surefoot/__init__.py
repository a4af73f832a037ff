"""Surefoot: the pipeline, on top of all.

Read `pipeline` (the cycle, from pixels to the map), `whereabouts` (who knows where the body is),
`planners` (who decides the next footstep) and `navigator` (the joint stack's step and look), `bodies` (a
live robot or a recording), `runs` (a whole walk, a whole recording), `journal` and `run_folder` (what is
written down), `evaluation` with `metrics` (held against the truth), `report` and `plots` (for people),
`recordings` (for other tools), `experiments` and `benchmarks` (what is claimed, measured again), `cli`
(the verbs).

Sources: seeds 000, 001, 003 and 004, joined.
"""

from .namesakes import refuse as _refuse_namesakes

_refuse_namesakes()
