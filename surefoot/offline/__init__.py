"""Verbs on a whole recording, beside `surefoot.run.process`: map, panorama, monocular, smooth.

Read `job` first: the input and the common output files. Then `map` (with `placed_images`, the camera poses by pose
source, and `g2o`, the pose graph as a file), `panorama` (with `panorama_views`), `monocular` (with `colour_camera_pose`), and `smooth`.

Sources: seed 000 (monocular), seed 004 (panorama).
"""
