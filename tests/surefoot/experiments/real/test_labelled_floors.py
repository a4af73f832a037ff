"""Depth from grey levels and the noise estimated from residuals, on synthetic planes."""

from __future__ import annotations

import numpy as np
import pytest

from perception.depth.points import Points
from perception.primitives.plane import Plane
from surefoot.experiments.real.labelled_floors import NYU, Curve, as_depth, residual_noise


@pytest.mark.parametrize("curve", NYU.curves)
def test_grey_level_noise_gives_the_stated_depth_noise(curve: Curve):
    grey = np.full((427, 564), 120.0)
    grey[::2] += 1.0
    depth = as_depth(grey, curve, NYU, 1.0)
    step = float(depth.z[0, 0] - depth.z[1, 0])
    assert abs(step) == pytest.approx(float(depth.sigma[1, 0]), rel=0.02)
    assert step < 0.0  # brighter is nearer


def test_the_residuals_give_the_standard_deviation_of_the_noise():
    rng = np.random.default_rng(0)
    rays = np.column_stack([rng.uniform(-0.5, 0.5, (5000, 2)), np.ones(5000)])
    rays[:, 1] += 0.6
    plane = Plane(np.array([0.0, -1.0, 0.0]), 0.5)
    inverse = rays[:, 1] / 0.5
    for share in (0.3, 0.8):
        z = 1.0 / (inverse + share * 0.01 * rng.normal(size=5000))
        points = Points(rays * z[:, None], 0.01 * z**2, np.arange(5000))
        assert residual_noise(points, plane) == pytest.approx(1.1 * share, rel=0.06)
