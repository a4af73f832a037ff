"""The coarse map of the way to a goal, against a peer."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import distance_transform_cdt

from planning.footholds._way_kernels import spread


def test_an_unknown_cell_takes_the_height_of_the_nearest_known_one():
    rng = np.random.default_rng(0)
    for share in (0.01, 0.05, 0.3):
        known = rng.random((17, 23)) < share
        height = np.where(known, rng.random(known.shape), np.nan)
        filled = height.copy()
        spread(filled, 4)
        away = distance_transform_cdt(~known, metric="taxicab")
        np.testing.assert_array_equal(np.isfinite(filled), away <= 4)
        rows, columns = np.nonzero(known)
        for row, column in np.argwhere(np.isfinite(filled)):
            distance = np.abs(rows - row) + np.abs(columns - column)
            nearest = distance == away[row, column]
            assert filled[row, column] in height[rows[nearest], columns[nearest]]
