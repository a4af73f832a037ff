"""The middle of a gap from points with known edges."""

from __future__ import annotations

import math

import numpy as np
import pytest

from perception.primitives.pose import Pose2
from planning.avoidance.gap_centre import GapCentre
from planning.avoidance.primitives import Leg, beside, on_line

FRONT_M, DEPTH_M = 0.5, 0.24


def sides(rng, left_m: float, right_m: float, turned_rad: float = 0.0) -> np.ndarray:
    """Points of the fronts and the inner faces of two boxes half a metre ahead, noise of 1 mm."""
    along, aside = rng.uniform(0.0, DEPTH_M, 400), rng.uniform(0.0, 0.1, 400)
    x = FRONT_M + np.concatenate([along, 0.0 * aside])
    y = np.concatenate([0.0 * along, aside])
    both = np.concatenate([np.column_stack([x, left_m + y]), np.column_stack([x, right_m - y])])
    both += rng.normal(0.0, 0.001, both.shape)
    return Pose2(0.0, 0.0, turned_rad).apply(both)


@pytest.mark.parametrize("middle_m", [-0.02, 0.0, 0.012])
def test_the_middle_lies_between_both_sides(middle_m):
    rng = np.random.default_rng(0)
    middle = GapCentre(0.24)
    for _ in range(12):
        assert middle.look(sides(rng, middle_m + 0.12, middle_m - 0.12))
    assert middle.offset_m == pytest.approx(middle_m, abs=0.001)


def test_a_side_of_which_only_the_front_is_seen_counts_by_its_edge():
    rng = np.random.default_rng(3)
    middle = GapCentre(0.24)
    for _ in range(12):
        seen = sides(rng, 0.12, -0.12)
        inner_face = (seen[:, 1] > 0.0) & (seen[:, 0] > FRONT_M + 0.01)
        assert middle.look(seen[~inner_face])
    assert middle.offset_m == pytest.approx(0.0, abs=0.004)


def test_the_standard_deviation_is_consistent_with_random_headings():
    rng = np.random.default_rng(1)
    squares = []
    for _ in range(200):
        true, seen = rng.normal(0.0, 0.007), GapCentre(0.24)
        for _ in range(4):
            true += rng.normal(0.0, 0.0015)
            turned = rng.normal(0.0, math.radians(0.4))
            seen.look(sides(rng, true + 0.12, true - 0.12, turned))
        squares.append((seen.offset_m - true) ** 2 / seen.sigma_m**2)
    assert 0.4 < np.mean(squares) < 1.3  # 1 if exact; the edges are better here than it believes


@pytest.mark.parametrize(("left_m", "right_m"), [(0.15, -0.15), (0.09, -0.09), (0.12, -0.3)])
def test_a_gap_of_another_width_is_ignored(left_m, right_m):
    middle = GapCentre(0.24)
    assert not middle.look(sides(np.random.default_rng(2), left_m, right_m))
    assert middle.offset_m == 0.0
    passed = sides(np.random.default_rng(2), 0.12, -0.12) - [0.7, 0.0]
    assert not middle.look(passed)


@pytest.mark.parametrize("primitive", ["S", "F"])
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_shifted_leg_keeps_its_heading_and_its_end(primitive, way):
    target = Pose2(1.0, 0.4, 0.7)
    back = Pose2(0.0, -way, 0.0) if primitive == "S" else Pose2(-1.0, 0.0, 0.0)
    leg, robot = Leg(primitive, target, 0.24), target @ back
    moved = beside(leg, robot, 0.03)
    ends = on_line(leg, robot, np.array([[moved.target.x, moved.target.y], [robot.x, robot.y]]))
    np.testing.assert_allclose(ends, [[1.0, 0.03], [0.0, 0.0]], atol=1e-12)
    assert moved.target.yaw == pytest.approx(target.yaw)
    ahead = np.array([math.cos(0.7), math.sin(0.7)])
    travel = way * np.array([-ahead[1], ahead[0]]) if primitive == "S" else ahead
    left = np.array([-travel[1], travel[0]])
    np.testing.assert_allclose(
        [moved.target.x - 1.0, moved.target.y - 0.4], 0.03 * left, atol=1e-12
    )
