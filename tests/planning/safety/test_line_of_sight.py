"""Blocked lines of sight against densely sampled segments, and the farthest visible point of a path."""

import numpy as np
import pytest

from planning.safety.line_of_sight import farthest_visible, is_blocked

NEAR_M = 0.2


@pytest.mark.parametrize("seed", range(20))
def test_a_point_near_the_segment_blocks_it(seed):
    rng = np.random.default_rng(seed)
    here, goal = rng.uniform(-2.0, 2.0, (2, 2))
    place = rng.uniform(-2.0, 2.0, 2)
    way = here + np.linspace(0.0, 1.0, 4001)[:, None] * (goal - here)
    away = np.hypot(*(way - place).T)
    nearest = int(np.argmin(away))
    beside = 0 < nearest < 4000  # not beyond its ends
    if abs(away[nearest] - NEAR_M) > 1e-3:
        expected = beside and away[nearest] < NEAR_M
        assert is_blocked(here, goal, place[None], NEAR_M) == expected


def test_an_empty_scene_and_an_empty_segment_are_not_blocked():
    assert not is_blocked(np.zeros(2), np.ones(2), np.empty((0, 2)), NEAR_M)
    assert not is_blocked(np.zeros(2), np.zeros(2), np.ones((1, 2)), NEAR_M)


CORNER = np.array([[1.0, 0.0], [1.5, 0.5], [1.5, 3.0]])
"""A path round a corner, from the origin."""


@pytest.mark.parametrize(
    ("wall", "point"),
    [
        ([], (1.5, 3.0)),  # no static obstacle
        ([(0.8, 1.0), (0.9, 1.5)], (1.5, 0.5)),  # inside the corner
        ([(1.2, 0.4), (0.8, 1.0), (0.9, 1.5)], (1.0, 0.0)),
        ([(0.5, 0.0), (0.5, 0.3), (0.5, 0.6), (0.5, 0.9)], (1.0, 0.0)),  # all blocked: the first
    ],
)
def test_the_target_is_the_last_visible_point_of_the_path(wall, point):
    standing = np.array(wall).reshape(-1, 2)
    found = farthest_visible(np.zeros(2), CORNER, standing, NEAR_M)
    np.testing.assert_array_equal(found, point)
