"""Planning: what shall we do.

Read in this order: `commands` (what is asked of a body), `search` (the terrain map to via points),
`route` (the via points kept from cycle to cycle, detours), `univector` (the field that walks to a via
point), `footsteps` (a desired heading and speed as a step that the gait can make), `guard` (lets only
steps pass that stay clear of what stands and of what may move, by `hypotheses` and `prediction`), `gaze`
(where to look meanwhile), `swarm` (the best pixel of a picture, without a map), `avoidance` (which of seven
motions leads past what blocks the way), `exploration` (where nobody has looked yet). `dynamic_window` and `velocity_obstacles` are peers of the guard, behind the
interface of `stepping`.

Sources: seed 003 (search), seed 001 (field, gaze), seed 000 (footsteps, swarm), seed 004 (avoidance); route and guard are ours.
"""
