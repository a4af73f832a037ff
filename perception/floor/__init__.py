"""The floor: which plane the robot stands on, how sure that is, and what rises above it.

Read `prior` (where it should be), `proposals` (randomised Hough and RANSAC), `refine` (least squares and
covariance), `find` (which of several planes is the floor), `classify` (floor, obstacle, hole, overhang).

Source: seed 003, section 3 and Fig. 4.
"""
