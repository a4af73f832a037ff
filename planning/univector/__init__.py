"""The univector field: walking to a via point among obstacles.

In reading order: `fields` (the move-to-goal field MUF, the avoid-obstacle field AUF, their sum, and `FieldConfig`),
`collision` (speeds that lead into a moving obstacle, widened by the covariance), `speed` (passing before it, behind
it, or leaving its path), `virtual_obstacle` (turning aside early where no speed avoids it), `motion` (heading and
speed from all of these), `published_gaze` (seed 001's gaze, which knows the extended shapes of obstacles). Compiled
loops are in `_kernels` and `_collision_kernels`.

Source: Yoo 2010 (seed 001), section 4, eq. (7) to (11).
"""
