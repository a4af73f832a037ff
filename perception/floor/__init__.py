"""The floor: the plane the robot stands on, how sure we are of it, and what rises from it.

Read in this order: `prior` (where it should be), `sample` (a few points, and what makes a plane a floor),
`ransac` and `hough` (two ways to think of a plane), `refine` (the fit to all points, in inverse depth, and
its covariance, per sensor), `choose` (find, which joins them and tries plane after plane), then `classify`
(floor, obstacle, hole, overhang; feet of things are told from the floor). `flow_chart` is the seed's own
procedure to the letter, for comparison.

Source: seed 003, sections 3 and 5.
"""
