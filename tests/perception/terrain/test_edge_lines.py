"""Lines through borders that are rounded to whole pixels, against the true lines."""

from __future__ import annotations

import math

import numpy as np
import pytest

from perception.terrain import _edge_kernels as kernels

LONG = 100


def fitted(rows, noise_px, rng):
    """Angle and offset of a line that crosses some rows, less the truth, in standard deviations."""
    slope, start = rows / LONG, rng.uniform()
    x = np.arange(LONG) + 0.5
    border = np.round(start + slope * x + noise_px * rng.standard_normal(LONG))
    steps = np.tile([0.0, 1.0], (LONG, 1))
    line = np.zeros(kernels.LINE)
    middle_x, middle_y, way_x, way_y, _, _ = kernels.fit_line(
        np.column_stack([x, border]), steps, border.astype(np.int64), line
    )
    turn = math.atan(way_y / way_x) - math.atan(slope)
    off = (middle_y - start - slope * middle_x) * math.cos(math.atan(slope))
    return turn / math.sqrt(line[6]), off / math.sqrt(line[7])


@pytest.mark.parametrize("rows", [0.3, 0.7, 2.5, 10.0])
@pytest.mark.parametrize(("noise_px", "least"), [(0.0, 0.02), (0.5, 0.6)])
def test_a_line_keeps_to_its_covariance_however_few_rows_it_crosses(rows, noise_px, least):
    rng = np.random.default_rng(0)
    errors = [fitted(rows * rng.uniform(0.8, 1.2), noise_px, rng) for _ in range(400)]
    turn, off = np.mean(np.square(errors), axis=0)
    assert least < turn < 2.0
    assert least < off < 2.0
