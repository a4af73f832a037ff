"""The floor: the plane the robot stands on with its covariance, and the obstacles that rise from it.

Read in this order: `prior` (predicted floor), `sample` (stratified points, floor score), `ransac` and `hough` (two
plane searches), `refine` (fit to all points, covariance), `common_error` (its part by distortion), `choose` (`find`, which joins them),
`classify` (floor, obstacle, hole, overhang), `levelling` (camera pose by the floor), `segmented_view` (one
classified depth image), `common_floor` (the floor of a whole recording, in the axes of its poses), `depth_calibration`
(noise and bend of a sensor from flat surfaces). `flow_chart` is the procedure of seed 003 as
published.

Source: seed 003, sections 3 and 5.
"""
