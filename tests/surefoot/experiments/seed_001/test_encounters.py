"""Encounters with one mover: they are drawn as meant, and doubt keeps the robot farther away."""

from dataclasses import replace

import numpy as np

from planning.planners.settings import BESIDE_GUARD
from surefoot.experiments.seed_001.encounters import (
    LIMIT_S,
    MEETS_S,
    RADIUS_M,
    SPEED_MPS,
    _mover,
    encounter,
    encounters,
)

SEEDS = range(40)


def test_movers_and_robot_would_be_on_the_way_at_the_same_time() -> None:
    """Else an encounter is none: at the meeting time the mover is on the robot's line, within 0.4 m of it."""
    for seed in SEEDS:
        place, velocity, radius = _mover(np.random.default_rng(seed), 0.07)
        size = float(np.hypot(*velocity))
        crosses = -place[1] / velocity[1]
        assert SPEED_MPS[0] <= size <= SPEED_MPS[1]
        assert RADIUS_M[0] <= radius <= RADIUS_M[1]
        assert MEETS_S[0] <= crosses <= MEETS_S[1]
        assert abs(place[0] + velocity[0] * crosses - 0.07 * crosses) <= 0.4


def test_doubt_keeps_the_robot_farther_from_movers_and_costs_little_time() -> None:
    """The same encounters with and without it: fewer near misses, and every goal is reached all the same."""
    certain = encounters(SEEDS, BESIDE_GUARD)
    doubtful = encounters(SEEDS, replace(BESIDE_GUARD, uncertainty=True))
    near = [sum(one.clearance_m < 0.05 for one in some) for some in (certain, doubtful)]
    times = [np.mean([one.time_s for one in some]) for some in (certain, doubtful)]
    assert near[1] < near[0]
    assert times[1] < 1.2 * times[0]
    assert all(one.time_s < LIMIT_S for one in (*certain, *doubtful))


def test_an_encounter_comes_out_the_same_again() -> None:
    field = replace(BESIDE_GUARD, velocity_change=True, uncertainty=True)
    assert encounter(3, field) == encounter(3, field)
