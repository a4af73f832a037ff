"""Helpers that several experiments share.

`experiment` (figures, targets, registry), `trials` (parallel trials with a result cache), `walks` (simulated
walks), `course_runner` and `geometric_perception` (courses without images), `floor_views`, `simulated_depth`,
`random_terrain` (generated inputs with ground truth), `real_data` (real recordings).
`dynamic_window`, `velocity_obstacles` and `mppi` are baselines for the guard.
"""
