"""The generated views show the floor, and show more of another surface."""

from __future__ import annotations

import numpy as np
import pytest

from surefoot.experiments.seed_003 import walls


@pytest.mark.parametrize("kind", list(walls.KINDS))
def test_every_view_shows_the_floor_as_the_smaller_part(kind):
    scene = walls.draw(kind, np.random.default_rng(0))
    on_floor = np.abs(scene.view.floor.distance(scene.points.xyz)) < 0.02
    assert walls.LEAST_FLOOR[kind] * 0.8 < np.mean(on_floor) < 0.6
    assert scene.view.floor.distance(scene.points.xyz).min() > -0.1  # no point below the floor


def test_a_bare_wall_shows_no_floor():
    scene = walls.bare_wall(np.random.default_rng(0))
    assert scene.view.floor.distance(scene.points.xyz).min() > 0.02
