"""Plots of a run.

Read `pictures` first (their list), then `style`. `top_view`, `surface`, `time_series` and `consistency` draw the
plots of the report; `panorama`, `avoidance` and `monocular` those of seed 004 and seed 000.
"""
