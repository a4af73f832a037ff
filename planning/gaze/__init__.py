"""Where to look while walking.

In reading order: `evaluations` (how much each reason to look weighs: psi_lm, psi_sf, psi_ob, psi_way),
`selection` (what each direction of the head is worth, and the one to take), `sampling` (the ground round
the robot, as the camera sees it), `tag_gain` (what a landmark would tell), `attention` (the evaluations of this
moment, from live covariances, and two reasons more) with `attention_config`, `sweep` (the plain policy: look where
the next steps go, glance left and right in between, and do not lose sight of what moves), `policy` (which of them
decides). Compiled loops are in `_gaze_kernels`.

Sources: seed 001, section 3, eq. (1) to (6); seed 003, section 5 (head command); the order of glances is ours.
"""
