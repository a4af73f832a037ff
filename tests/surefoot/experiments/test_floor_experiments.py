"""The views of the floor experiments are what they say they are."""

from __future__ import annotations

import numpy as np
import pytest

from perception.depth.points import Points
from perception.primitives.plane import Plane
from surefoot.experiments.real.labelled_floors import NYU, Curve, as_depth, residual_noise
from surefoot.experiments.seed_003 import walls
from surefoot.experiments.support.floor_views import random_view


@pytest.mark.parametrize("kind", list(walls.KINDS))
def test_in_every_view_the_floor_is_there_and_not_the_larger_part(kind):
    view = walls.draw(kind, np.random.default_rng(0))
    on_floor = np.abs(view.look.floor.distance(view.points.xyz)) < 0.02
    assert walls.LEAST_FLOOR[kind] * 0.8 < np.mean(on_floor) < 0.6
    assert view.look.floor.distance(view.points.xyz).min() > -0.1  # nothing lies below it


def test_a_bare_wall_shows_no_floor():
    view = walls.bare_wall(np.random.default_rng(0))
    assert view.look.floor.distance(view.points.xyz).min() > 0.02


def test_the_joints_of_a_head_are_off_as_they_claim():
    rng = np.random.default_rng(0)
    looks = [random_view(rng, (0.3, 1.5), (10.0, 40.0)) for _ in range(400)]
    errors = np.array([look.prior.error_to(look.floor) for look in looks])
    claimed = np.sqrt(np.diag(looks[0].prior.covariance))
    np.testing.assert_allclose(errors.std(axis=0), claimed, rtol=0.15)


@pytest.mark.parametrize("curve", NYU.curves)
def test_grey_noise_becomes_the_depth_noise_that_it_is(curve: Curve):
    grey = np.full((427, 564), 120.0)
    grey[::2] += 1.0
    depth = as_depth(grey, curve, NYU, 1.0)
    step = float(depth.z[0, 0] - depth.z[1, 0])
    assert abs(step) == pytest.approx(float(depth.sigma[1, 0]), rel=0.02)
    assert step < 0.0  # brighter is nearer


def test_residuals_tell_how_large_the_noise_is():
    rng = np.random.default_rng(0)
    rays = np.column_stack([rng.uniform(-0.5, 0.5, (5000, 2)), np.ones(5000)])
    rays[:, 1] += 0.6
    plane = Plane(np.array([0.0, -1.0, 0.0]), 0.5)
    inverse = rays[:, 1] / 0.5
    for share in (0.3, 0.8):
        z = 1.0 / (inverse + share * 0.01 * rng.normal(size=5000))
        points = Points(rays * z[:, None], 0.01 * z**2, np.arange(5000))
        assert residual_noise(points, plane) == pytest.approx(1.1 * share, rel=0.06)
