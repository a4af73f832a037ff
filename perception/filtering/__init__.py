"""Kalman filtering: models, square-root unscented filter, consistency.

Read `models` (motion and measurement of the walking robot), `square_root` (the filter), `consistency` (normalised
errors against the chi-square band).

Source: Yoo and Kim 2010 (seed 001), section 3; van der Merwe and Wan 2001.
"""
