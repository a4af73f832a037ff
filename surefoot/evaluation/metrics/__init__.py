"""Formulas of the evaluation, one module per kind of ground truth; each function documents its figures.

`trajectory` (position, heading, ATE, RPE), `gauge_alignment` (errors and covariances after alignment),
`consistency` (NEES and NIS), `calibration` (direction, CRPS, inflation,
conformal regions), `innovations` (size and whiteness), `floor` (planes), `maps` (grids), `surfaces`
(meshes), `obstacles` (tracks) with `ospa`, `footprints` (outlines), `contacts` (clearance, goals, path) and
`contact_classes`, `risk` (claimed probabilities of contact against contacts), `timing` (milliseconds per stage). `surefoot.evaluation.evaluate` applies them to one run, `surefoot.evaluation.referee` to the
trajectory of any system.

Sources: Umeyama 1991 (alignment), Sturm et al. 2012 (ATE, RPE), Bar-Shalom et al. 2001, section 5.4 (NEES).
"""
