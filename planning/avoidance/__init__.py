"""Avoidance: which side to pass what blocks the way, and by which motion.

Read in this order: `complexity` (how much stands left and right), `direction` (the side, and who blocks the
way), `fams` (the fuzzy selection of a motion), `pivot` (where the passage begins), `choice` (all of it for one
scene, explained in words), `primitives` (the motion as footsteps).

Everything here takes plain numbers: edges as azimuths, left positive, distances and widths in m.

Source: seed 004, sections 2.3 and 2.4, eq. (21) to (30).
"""
