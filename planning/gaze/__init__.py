"""Gaze: where to look while walking.

In reading order: `evaluations` (the four psi, how much each reason to look counts), `selection` (the gaze map over
pan and tilt, and the direction to take), `sampling` (ground cells as the camera sees them), `landmark_gain` (how much
a sighting of a landmark reduces the pose covariance), `priority` and `untracked_targets` (clusters that need a track),
`arrivals` (directions from which something could have come unseen), `attention` (the gaze map of the present
moment), `sweep` (the simple policy: next steps, glances to both sides, tracks out of sight), `policy` (choice among
them). Compiled loops are in `_gaze_kernels`.

Sources: seed 001, section 3, eq. (1) to (6); seed 003, section 5 (head command); the order of glances is ours.
"""
