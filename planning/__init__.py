"""Planning: the next footstep and gaze, from a world model.

Read in this order: `commands` (what a body is asked to do), `footsteps` (a heading and a speed as one step of the
gait), `world_model` (what planning reads), `planners` (four planners and what they share), `search` (via points on the
grid), `univector` (the field that leads to a via point), `safety` (the guard), `gaze` (where to look
meanwhile), `swarm` (the best pixel of an image, without a map), `avoidance` (seven motions past obstacles),
`exploration` (places that were not seen yet).

Sources: seed 003 (search), seed 001 (field, gaze), seed 000 (footsteps, swarm), seed 004 (avoidance); guard, recovery
and fall-back are ours.
"""
