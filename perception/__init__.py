"""Perception: which obstacles, floor and poses there are, with their uncertainty.

Read in this order: `primitives` (shared values), `depth` (each depth sensor to depth with a standard deviation per
pixel), `monitoring` (what contradicts what), `floor` (the ground plane and the classes of points), `terrain` (plane regions, ramps, stairs), `obstacles` (clusters, detections, tracks),
`filtering` (the unscented Kalman filter, its models and consistency), `localisation` (the pose of the robot),
`features` (image features for matching), `odometry` (the trajectory of a handheld RGB-D camera), `smoothing`
(factor graphs), `planar` (wheeled robots), `monocular` (floor and obstacles by one camera), `estimate` (the
result of one frame).

Conventions of the whole project:

- SI units; radians in code, degrees only in files and on the command line.
- World frame W: z up, floor at z = 0, yaw counter-clockwise from +x.
- Body frame: origin on the floor below the centre of the robot, x ahead, y left, z up. Its pose is a `Pose2` in W; it
  never tilts, so the kinematic floor is z = 0 of the body frame.
- Camera frame: x right, y down, z ahead. Pixel centres at integer coordinates (u, v).
- `T_to_from` maps coordinates: `p_to = T_to_from.apply(p_from)`.
- Missing depth is NaN, never 0.

Sources: Han et al. 2018 (seed 000, monocular), Yoo and Kim 2010 (seed 001, localisation and obstacles), seed 003 (stereo
and floor), Kang et al. 2013 (seed 004, time of flight and features).
"""
