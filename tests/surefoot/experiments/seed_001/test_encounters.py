"""Encounters with a moving obstacle: they meet as specified, and uncertainty increases the distance."""

from dataclasses import replace

import numpy as np

from planning.planners.settings import BESIDE_GUARD
from surefoot.experiments.seed_001.encounters import (
    LIMIT_S,
    MEETS_S,
    RADIUS_M,
    SPEED_MPS,
    _moving_obstacle,
    encounter,
    encounters,
)

SEEDS = range(40)


def test_obstacle_and_robot_would_reach_the_meeting_point_at_the_same_time() -> None:
    """At the meeting time the obstacle is on the robot's path, within 0.4 m of the robot."""
    for seed in SEEDS:
        place, velocity, radius = _moving_obstacle(np.random.default_rng(seed), 0.07)
        size = float(np.hypot(*velocity))
        crosses = -place[1] / velocity[1]
        assert SPEED_MPS[0] <= size <= SPEED_MPS[1]
        assert RADIUS_M[0] <= radius <= RADIUS_M[1]
        assert MEETS_S[0] <= crosses <= MEETS_S[1]
        assert abs(place[0] + velocity[0] * crosses - 0.07 * crosses) <= 0.4


def test_uncertainty_increases_the_distance_to_obstacles_and_costs_little_time() -> None:
    """The same encounters with and without uncertainty: fewer near misses, and every goal is reached."""
    many = range(160)  # one in twelve is a near miss
    certain = encounters(many, BESIDE_GUARD)
    uncertain = encounters(many, replace(BESIDE_GUARD, uncertainty=True))
    away_m = np.array([[one.clearance_m for one in some] for some in (certain, uncertain)])
    times = [np.mean([one.time_s for one in some]) for some in (certain, uncertain)]
    for near_m in (0.05, 0.1):
        without, with_uncertainty = (away_m < near_m).sum(axis=1)
        assert with_uncertainty < without
    assert away_m[1].mean() > away_m[0].mean() + 0.005
    assert times[1] < 1.2 * times[0]
    assert all(one.time_s < LIMIT_S for one in (*certain, *uncertain))


def test_an_encounter_is_reproducible() -> None:
    field = replace(BESIDE_GUARD, velocity_change=True, uncertainty=True)
    assert encounter(3, field) == encounter(3, field)
