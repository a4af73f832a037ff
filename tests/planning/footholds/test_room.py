"""Room for the body: walls and tables bar the way, risers and the sides of a flight do not."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from mapping.ground.obstacles import VOXEL_M, Voxels
from mapping.ground.surface import Border, Surface
from perception.primitives.robot_model import RobotModel, StepLimits
from planning.footholds import room

ROBOT = RobotModel(
    radius_m=0.30,
    height_m=1.3,
    stance_m=0.2,
    foot_m=(0.205, 0.066),
    steps=StepLimits(0.10, 0.10, 0.35),
)
MIDDLE = np.zeros(2)
SIGMA_M = 0.02


def level(x0, x1, z, half=1.5) -> Surface:
    corners = np.array([[x0, -half], [x1, -half], [x1, half], [x0, half]])
    borders = np.full(4, int(Border.UNSEEN))
    return Surface(
        corners.mean(axis=0),
        np.array([z, 0.0, 0.0]),
        1e-6 * np.eye(3),
        corners,
        borders,
        np.full(4, 0.01),
    )


def block(x, y, z) -> np.ndarray:
    """Voxels of a box, each (from, to)."""
    axes = [np.arange(a + VOXEL_M / 2, b, VOXEL_M) for a, b in (x, y, z)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def terrain(surfaces, *blocks):
    places = np.concatenate([np.zeros((0, 3)), *blocks])
    voxels = Voxels(places, np.full(len(places), 0.9), np.full(len(places), SIGMA_M**2))
    return room.terrain(room.reachable(surfaces, 0.10), voxels, ROBOT, MIDDLE)


def blocked(found, x, y) -> bool:
    column, row = np.floor((np.array([x, y]) - found.origin) / found.cell_m).astype(int)
    return bool(found.blocked[row, column])


FLIGHT = [
    level(-1.0, 0.8, 0.0),
    level(0.8, 1.12, 0.08),
    level(1.12, 1.44, 0.16),
    level(1.44, 3.0, 0.24),
]
RISERS = [block((0.8 + 0.32 * k, 0.85 + 0.32 * k), (-1.5, 1.5), (0.08 * k, 0.08 * k + 0.08)) for k in range(3)]  # fmt: skip


def test_a_flight_of_stairs_bars_nothing():
    found = terrain(FLIGHT, *RISERS)
    assert not found.blocked.any()
    sides = [block((0.8 + 0.32 * k, 3.0), (1.5, 1.55), (0.0, 0.08 * (k + 1))) for k in range(3)]
    assert not terrain(FLIGHT, *RISERS, *sides).blocked.any()


def test_a_flight_that_rises_beyond_known_ground_bars_nothing_but_a_wall_there_does():
    ground = [level(-1.0, 0.7, 0.0)]
    treads = [block((0.8 + 0.32 * k, 1.12 + 0.32 * k), (-1.5, 1.5), (0.0, 0.08 * (k + 1))) for k in range(4)]  # fmt: skip
    assert not terrain(ground, *treads).blocked.any()
    assert blocked(terrain(ground, block((1.2, 1.25), (-1.5, 1.5), (0.0, 1.0))), 1.2, 0.0)


def test_a_wall_on_the_flight_bars_within_the_radius_and_what_its_error_asks():
    wall = block((0.0, 3.0), (0.5, 0.55), (0.0, 1.0))
    found = terrain(FLIGHT, *RISERS, wall)
    margin = norm.isf(room.RISK) * np.hypot(SIGMA_M, room.BODY_SIGMA_M)
    edge = 0.5 - ROBOT.radius_m - margin
    for x in (0.5, 1.3, 2.0):
        assert blocked(found, x, edge + 0.06)
        assert not blocked(found, x, edge - 0.06)


def test_where_the_body_may_be_no_obstacle_is_touched_with_more_than_the_chance():
    rng = np.random.default_rng(0)
    chances = []
    for _ in range(20):
        places = np.column_stack([rng.uniform(-1.5, 1.5, (40, 2)), np.full(40, 0.5)])
        places = (np.floor(places / VOXEL_M) + 0.5) * VOXEL_M
        places = places[np.linalg.norm(places[:, :2], axis=1) > 0.8]
        sigma = np.where(rng.random(len(places)) < 0.5, 0.015, rng.uniform(0.03, 0.12, len(places)))
        voxels = Voxels(places, np.full(len(places), 0.9), sigma**2)
        found = room.terrain([level(-2.0, 2.0, 0.0, 2.0)], voxels, ROBOT, MIDDLE)
        middles = found.origin + (np.argwhere(~found.blocked)[:, ::-1] + 0.5) * found.cell_m
        middles = middles[np.abs(middles).max(axis=1) < 1.5]
        apart = np.linalg.norm(middles[:, None] - places[:, :2], axis=2) - VOXEL_M / 2
        # the chance of the likeliest one, the place of either known
        errors = np.hypot(sigma, room.BODY_SIGMA_M) * rng.standard_normal((2000, len(places)))
        for gap in rng.permutation(apart)[:10] - ROBOT.radius_m:
            chances.append(np.max(np.mean(errors > gap, axis=0)))
    assert max(chances) < room.RISK + 0.02  # 2000 draws tell it to .005


@pytest.mark.parametrize(("low", "high", "bars"), [(1.2, 1.25, True), (1.4, 1.45, False), (0.0, 0.05, False)])  # fmt: skip
def test_only_what_is_as_high_as_the_body_bars(low, high, bars):
    found = terrain([level(-1.0, 3.0, 0.0)], block((1.0, 1.1), (-1.0, 1.0), (low, high)))
    assert blocked(found, 1.05, 0.0) == bars


def test_a_table_is_no_ground_and_its_top_bars():
    table = level(1.0, 1.5, 0.7, 0.4)
    found = room.reachable([level(-1.0, 3.0, 0.0), table], 0.10)
    assert table not in found
    top = block((1.0, 1.5), (-0.4, 0.4), (0.65, 0.7))
    assert blocked(terrain([level(-1.0, 3.0, 0.0), table], top), 1.25, 0.0)


def test_a_robot_too_near_to_a_wall_may_leave_it_but_not_approach():
    found = terrain([level(-1.0, 3.0, 0.0)], block((0.3, 0.35), (-1.0, 1.0), (0.0, 1.0)))
    assert not blocked(found, -0.05, 0.0)
    assert not blocked(found, -0.3, 0.0)
    assert blocked(found, 0.15, 0.0)


def test_beside_a_drop_it_costs_more():
    ground = [level(-1.0, 1.0, 0.0), level(1.0, 3.0, -0.5)]
    found = room.terrain(
        [ground[0], ground[1]], Voxels(np.zeros((0, 3)), np.zeros(0), np.zeros(0)), ROBOT, MIDDLE
    )
    row = int((0.0 - found.origin[1]) / found.cell_m)
    prices = found.price[
        row, np.floor((np.array([0.3, 0.75, 0.9]) - found.origin[0]) / found.cell_m).astype(int)
    ]
    assert prices[0] == 1.0 < prices[1] < prices[2]
