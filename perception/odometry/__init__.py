"""RGB-D odometry: the trajectory of a hand-held camera from its depth images, with losses detected.

Read in this order: `pyramid` (image pyramid), `alignment` (relative pose of two images, with covariance),
`hypotheses` (initial poses after a large rotation), `odometry` (image by image, losses, relocalisation),
`alarm` (probability that a pose is wrong), `place_recognition` and `back_end` (loop closures and pose graph), `pose_uncertainty`
and `view_errors` (covariances of the trajectory), `rgbd_odometry` (all of it, from frames to trajectory), `odometry_poses` (the
pose source of the pipeline). `baselines` offers Open3D's and small_gicp's alignment behind the same signature.

Source: Newcombe et al. 2011; Steinbrücker et al. 2011; Kerl et al. 2013; overlap off the floor is ours.
"""
