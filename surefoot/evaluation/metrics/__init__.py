"""How good is it: one file per kind of truth, formulas only.

`trajectory` (position, heading, ATE, RPE), `consistency` (does the covariance keep its promise),
`innovations` (is each surprise as large as expected, and new), `floor` (planes), `maps` (grids), `obstacles`
(tracks) with `ospa`, `contacts` (clearance, goal, path), `timing` (milliseconds per stage).
`surefoot.evaluation.evaluate` joins them for one run.

Sources: Umeyama 1991 (alignment), Sturm et al. 2012 (ATE, RPE), Bar-Shalom et al. 2001, section 5.4 (NEES).
"""
