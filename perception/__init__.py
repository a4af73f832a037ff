"""Perception: what is there, and how sure are we.

Read in this order: `primitives` (the words everybody uses), `time_of_flight`, `structured_light` and `stereo`
with `block_matching` and `rectification` (sensors to depth with a sigma per pixel), `floor` (the plane the
robot stands on, and what rises above it), `clusters` with `round_front` (points to obstacles), `coloured`
(obstacles of known colours in a picture), `localisation` (the robot's pose, landmarks, moving obstacles),
`features` (points of a picture that are found again), `odometry` (the way of a camera in the hand),
`monocular` (floor and moving obstacles by a single camera), `depth_to_colour` (two cameras made one).

Conventions, stated once for the whole project:

- SI units; radians inside, degrees only in files and on the command line.
- World frame W: z up, floor at z = 0, yaw counter-clockwise from +x.
- Body frame: origin on the floor under the robot's middle, x ahead, y left, z up. Its pose on the floor
  is a `Pose2` in W; it never tilts, so the kinematic floor is z = 0 of the body frame.
- Camera frame: x right, y down, z ahead. Pixel centres at integer coordinates (u, v).
- `T_to_from` maps coordinates: `p_to = T_to_from.apply(p_from)`.
- Missing depth is NaN, never 0.

Sources: seed 000 (monocular), seed 003 (stereo, floor, grid), seed 004 (time of flight, features), seed 001
(localisation, obstacles).
"""
