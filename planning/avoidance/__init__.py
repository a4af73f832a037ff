"""Avoidance: the side on which to pass an obstacle, and the motion to pass it with.

In reading order: `complexity` (weight of the obstacles left and right), `direction` (the side, and the obstacles in the
corridor), `fams` (fuzzy selection of a motion), `pivot` (start of the passage), `choice` (all of these for one scene,
with the reasons in words), `primitives` (the motion as footsteps), `gap_centre` (the middle of a gap on approach).

Inputs are plain arrays: edges as azimuths, left positive, rad; distances and widths in m.

Source: Kang 2013 (seed 004), sections 2.3 and 2.4, eq. (21) to (30).
"""
