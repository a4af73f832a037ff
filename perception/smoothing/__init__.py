"""Smoothing with factor graphs: a whole run at once, or its last seconds at every instant.

Read in this order: `factors` (measurements with covariances), `smoother` (batch), `fixed_lag` (incremental),
`walk_factors` (the sensors of a walking robot as factors), `lagged_filter` (live, in place of the pose filter), and
`graph`, the only module that makes GTSAM factors.

Source: Yoo and Kim 2010 (seed 001), sections 2, 3 and 14; Dellaert and Kaess 2006; Kaess et al. 2012.
"""
