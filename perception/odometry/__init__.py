"""Odometry from depth images: how a camera in the hand moves, and when nobody can tell.

Read in this order: `pyramid` (an image made ready), `alignment` (two of them laid over each other, with the
covariance), `hypotheses` (where to start when the step was large), `odometry` (image after image, losses,
relocalisation). `peers` has Open3D's and small_gicp's behind the same signature.

Source: Newcombe et al. 2011; Steinbrücker et al. 2011; Kerl et al. 2013; overlap off the floor is ours.
"""
