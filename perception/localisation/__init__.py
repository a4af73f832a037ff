"""Localisation of a walking robot, and pose sources in general.

Read in this order: `tag_edges` and `landmarks` (tags in the image to range and bearing), `localiser_noise` and
`noise_factor` (noise of steps, gyro and head, and how much of it there is), `turn_check` (gyro against steps), `filter`
(the robot's pose), `relocalisation` (pose from the landmarks of one frame), `scan`, `keyframes`, `scan_search`,
`scan_alignment` and `registration` (localisation without landmarks). `ukf_engines` runs the filter on our compiled
square-root filter or on filterpy.

`pose_source` is the interface that the pipeline uses; `legged_poses` and `given_poses` implement it, from the
obstacle points of `static_points`, and so does `odometry.odometry_poses`.

Source: Yoo and Kim 2010 (seed 001), sections 2, 3 and 14.
"""
