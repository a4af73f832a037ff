"""The floor: the plane the robot stands on, how sure we are of it, and what rises from it.

Read in this order: `prior` (where it should be), `sample` (a few points, and what makes a plane a floor),
`ransac` and `hough` (two ways to think of a plane), `refine` (the fit to all points and its covariance),
`choose` (find, which joins them), then `classify` (floor, obstacle, hole, overhang).

Source: seed 003, sections 3 and 5.
"""
