"""What bars the straight way to a goal: against the distance to points drawn along the way."""

import numpy as np
import pytest

from surefoot.swarm_planner import barred

NEAR_M = 0.2


@pytest.mark.parametrize("seed", range(20))
def test_barred_is_whatever_lies_near_a_point_of_the_way(seed):
    rng = np.random.default_rng(seed)
    here, goal = rng.uniform(-2.0, 2.0, (2, 2))
    place = rng.uniform(-2.0, 2.0, 2)
    way = here + np.linspace(0.0, 1.0, 4001)[:, None] * (goal - here)
    away = np.hypot(*(way - place).T)
    nearest = int(np.argmin(away))
    beside = 0 < nearest < 4000  # before and behind the ends it bars nothing
    if abs(away[nearest] - NEAR_M) > 1e-3:
        expected = beside and away[nearest] < NEAR_M
        assert barred(here, goal, place[None], NEAR_M) == expected


def test_nothing_bars_nothing():
    assert not barred(np.zeros(2), np.ones(2), np.empty((0, 2)), NEAR_M)
    assert not barred(np.zeros(2), np.zeros(2), np.ones((1, 2)), NEAR_M)
