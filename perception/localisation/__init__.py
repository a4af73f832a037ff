"""Where am I, where are they, and how sure.

Read `models` (what the walker's filter believes of the world), `tag_edges` and `landmarks` (tags in the
picture to range and bearing), `filter` (the robot's pose), `relocation` (the same from nothing), `scan`,
`keyframes` and `registration` (the same in a home without any marker, in this order), `track` (one
obstacle), `turning` (what it may do out of sight), `obstacles` (all of them, from frame to frame), and
`consistency` (whether these covariances can be believed).

Beneath them, `square_root` is the sigma-point filter itself, compiled, that cannot lose its positivity, and
`engines` lets the walker's filter run on it or on filterpy. For wheels and other planar bodies read
`planar` (odometry and landmarks, with what spoils both as states), `planar_fit` (its parameters by
likelihood, without truth) and `association` (landmarks that do not tell who they are).

Looking back, later measurements correct earlier poses: `factors` (what was measured, in our words), `smoother`
(a whole run at once), `fixed_lag` (the last seconds, as the run goes on), `walk_factors` (a walker's sensors
as factors), and `graph`, the one place where GTSAM's factors are made.

Source: seed 001, sections 2, 3 and 14.
"""
