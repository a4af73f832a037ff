"""The decision of seed 004 against closed forms, Table 2 and its own invariants."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from perception.primitives.errors import ConfigError, InputError
from perception.primitives.pose import Pose2
from perception.primitives.robot_model import DARWIN_OP, GaitLimits
from planning.avoidance import primitives
from planning.avoidance.choice import AvoidanceConfig, ObstacleTable, choose
from planning.avoidance.complexity import FORMS, complexity
from planning.avoidance.direction import direction
from planning.avoidance.fams import MOTIONS, TABLE, FamsConfig, memberships, select, strengths
from planning.avoidance.pivot import PivotConfig, pivot


def _one(left_m: float, right_m: float, d: float, h: float, form: str) -> float:
    edges = np.array([[math.atan2(left_m, d), math.atan2(right_m, d)]])
    values = (np.array([v]) for v in (d, left_m - right_m, h))
    return float(complexity(edges, *values, form)[0])


@pytest.mark.parametrize("form", FORMS)
@settings(deadline=None, max_examples=40)
@given(st.floats(0.05, 0.6), st.floats(0.1, 0.5), st.floats(0.5, 2.0), st.floats(0.1, 0.6))
def test_complexity_is_odd_and_grows_with_size_and_nearness(form, left, width, d, h):
    value = _one(-left, -left - width, d, h, form)
    assert value > 0.0  # right of the way
    assert _one(left + width, left, d, h, form) == pytest.approx(-value)
    assert _one(-left, -left - width, d, 1.2 * h, form) > value
    assert _one(-left, -left - 1.02 * width, d, h, form) > value * (1 - 1e-9)


def test_integrated_complexity_is_continuous_straight_ahead():
    def jump(form: str) -> float:
        left, right = (_one(0.36 + o, -0.36 + o, 1.05, 0.32, form) for o in (0.005, -0.005))
        return abs(left - right)

    assert jump("integrated") < 0.01
    assert jump("frontal") > 0.3


def test_frontal_complexity_is_the_apparent_area_times_the_cosine():
    theta = math.atan2(-0.2, 1.0) / 2 + math.atan2(-0.6, 1.0) / 2
    assert _one(-0.2, -0.6, 1.0, 0.3, "frontal") == pytest.approx(0.4 * 0.3 * math.cos(theta))


def test_an_unknown_form_is_refused_by_name():
    with pytest.raises(InputError, match="integrated"):
        _one(0.1, -0.1, 1.0, 0.3, "nonesuch")


def test_the_side_has_fewer_obstacles_and_a_tie_goes_to_the_wider_gap():
    assert direction(0.5, 0.1, 2.0) == 1
    assert direction(-0.5, 2.0, 0.1) == -1
    assert direction(0.001, 0.3, 0.5) == -1
    assert direction(0.001, 0.4, 0.4) == 1


@settings(deadline=None, max_examples=40)
@given(st.lists(st.floats(-3.0, 3.0), min_size=1, max_size=20))
def test_memberships_are_triangles_that_sum_to_one(values):
    centres = FamsConfig().obstacle_centres_m
    degrees = memberships(np.array(values), centres)
    np.testing.assert_allclose(degrees.sum(axis=0), 1.0, atol=1e-12)
    assert np.all((degrees >= -1e-12) & (degrees <= 1 + 1e-12))
    np.testing.assert_allclose(memberships(np.array(centres), centres), np.eye(5), atol=1e-12)


def test_at_the_peaks_of_the_sets_the_motion_is_that_of_table_2():
    config = FamsConfig()
    for i, w in enumerate(config.obstacle_centres_m):
        for j, s in enumerate(config.gap_centres_m):
            at = select(np.array([w + 0.30]), np.array([s + 0.30]), config)
            assert at[0] == TABLE[i, j]


@settings(deadline=None, max_examples=40)
@given(st.floats(0.0, 1.6), st.floats(0.0, 1.2))
def test_strengths_equal_the_25_rules_one_by_one(width, gap):
    config = FamsConfig()
    wide = memberships(np.array([width - 0.30]), config.obstacle_centres_m)[:, 0]
    free = memberships(np.array([gap - 0.30]), config.gap_centres_m)[:, 0]
    best = np.zeros(len(MOTIONS))
    for i in range(5):
        for j in range(5):
            best[TABLE[i, j]] = max(best[TABLE[i, j]], min(wide[i], free[j]))
    found = strengths(np.array([width]), np.array([gap]), config)[:, 0]
    np.testing.assert_allclose(found, best, atol=1e-12)


@settings(deadline=None, max_examples=40)
@given(st.floats(0.0, 1.6), st.floats(0.0, 1.2), st.floats(0.0, 0.05))
def test_an_uncertain_gap_never_leads_to_walking_or_stopping(width, gap, sigma):
    sure, doubtful = (
        MOTIONS[int(select(np.array([width]), np.array([gap]), None, s)[0])]
        for s in (None, np.array([sigma]))
    )
    assert doubtful[0] == sure[0]
    assert doubtful == sure or (sure[1], doubtful[1]) == ("F", "S")


def test_the_default_pivot_in_closed_form():
    at = pivot("RF", 1, 0.36, 0.5, 0.72, 1.05)
    assert at.distance_m == pytest.approx(1.01, abs=0.005)
    assert math.degrees(at.turn_rad) == pytest.approx(37.0, abs=0.5)
    literal = pivot("RF", -1, -0.36, 0.5, 0.72, 1.05, PivotConfig(literal=True))
    assert literal.distance_m == pytest.approx(0.57, abs=0.005)
    assert -math.degrees(literal.turn_rad) == pytest.approx(-76.0, abs=0.5)  # theta, right positive


@pytest.mark.parametrize(("width", "gap"), [(0.72, 0.5), (0.9, 0.25), (0.6, 0.3), (0.0, 0.0)])
@pytest.mark.parametrize("side", [-1, 1])
def test_a_printed_turn_is_the_printed_arc_tangent(side, width, gap):
    literal = PivotConfig(literal=True)
    at = pivot("RF", side, side * width / 2, gap, width, 1.05, literal)
    across, ahead = -side * width / 2 - gap, 1.05 - gap  # theta and this are positive to the right
    assert -math.sin(at.turn_rad) * across == pytest.approx(math.cos(at.turn_rad) * ahead)
    assert abs(at.turn_rad) <= math.pi / 2
    assert at.distance_m == pytest.approx(math.hypot(across, ahead))
    turn, walk = primitives.passage("RF", at, Pose2(), 1.65)[:2]
    assert (turn.primitive, turn.target.yaw) == ("R", pytest.approx(at.turn_rad))
    end = turn.target.inverse() @ walk.target
    assert (end.x, end.y, end.yaw) == pytest.approx((at.distance_m, 0.0, 0.0))


@pytest.mark.parametrize("side", [-1, 1])
def test_a_printed_turn_by_half_a_circle_is_walked(side):
    at = pivot("TF", side, side * 0.45, 0.25, 0.9, 1.05, PivotConfig(literal=True))
    assert (at.distance_m, at.turn_rad) == (pytest.approx(0.2), side * math.pi)
    turn, walk = primitives.passage("TF", at, Pose2(), 1.65)[:2]
    assert (turn.primitive, abs(turn.target.yaw)) == ("T", pytest.approx(math.pi))
    assert (walk.target.x, walk.target.y) == pytest.approx((-0.2, 0.0))


@settings(deadline=None, max_examples=40)
@given(
    st.floats(0.02, 0.7), st.floats(0.5, 1.2), st.sampled_from([m for m in MOTIONS if m != "ST"])
)
def test_the_pivot_clears_the_obstacle_by_the_clearance(edge, gap, motion):
    config = PivotConfig()
    at = pivot(motion, 1, edge, gap, 0.7, 1.05, config)
    assert at.y_m - 0.30 / 2 - edge >= config.clearance_m - 1e-12
    mirrored = pivot(motion, -1, -edge, gap, 0.7, 1.05, config)
    assert (mirrored.x_m, mirrored.y_m) == pytest.approx((at.x_m, -at.y_m))


def _things(spans: list[tuple[float, float]], d: float = 1.05) -> ObstacleTable:
    edges = np.array(spans)
    n = len(spans)
    return ObstacleTable(
        np.arctan2(edges, d),
        edges,
        edges,
        np.full(n, d),
        edges[:, 0] - edges[:, 1],
        np.full(n, 0.32),
        np.full((n, 2), 0.004),
    )


def test_a_choice_explains_itself_with_its_numbers():
    choice = choose(_things([(0.9, 0.7), (0.2, -0.5), (-0.6, -0.9)]), AvoidanceConfig(), DARWIN_OP)
    assert choice is not None
    assert (choice.motion, choice.side) == ("RF", 1)
    for word in ("1.05 m", "0.70 m", "0.50 m", "left", "RF"):
        assert word in choice.why


def test_the_printed_average_of_labels_decides_on_request():
    """Beside a thing 1.3 m wide a gap of 0.21 m lies between ST (1) and TS (6), whose mean is RS (4)."""
    things = _things([(1.0, 0.86), (0.65, -0.65), (-0.86, -1.0)])
    best, mean = (
        choose(
            things, AvoidanceConfig(fams=FamsConfig(ordinal=ordinal), other_side=False), DARWIN_OP
        )
        for ordinal in (False, True)
    )
    assert best is not None
    assert mean is not None
    assert (best.motion, mean.motion) == ("TS", "RS")
    assert mean.fits == best.fits
    assert "TS (0.60)" in best.why
    assert "RS (0.00)" in mean.why  # no rule asks for it


@pytest.mark.parametrize(
    ("gap", "sigma", "motion", "passes"),
    [
        (0.40, 0.01, "RF", 1.0),
        (0.38, 0.10, "RS", 0.964),  # forward it fits with 0.79 only
        (0.28, 0.10, "ST", 0.788),  # the body needs 0.20 m sideways
        (0.28, 0.00, "RS", 1.0),
    ],
)
def test_the_motion_is_one_that_fits_the_gap_with_the_least_probability(gap, sigma, motion, passes):
    things = _things([(0.3 + gap, 0.2 + gap), (0.2, -0.5)])
    things.sigma_m[:] = 0.0
    things.sigma_m[0, 1] = sigma  # the facing side of the neighbour
    choice = choose(things, AvoidanceConfig(other_side=False), DARWIN_OP)
    assert choice is not None
    assert (choice.motion, choice.side) == (motion, 1)
    assert choice.passes == pytest.approx(passes, abs=0.001)
    assert f"fits with {choice.passes:.2f}" in choice.why


def test_a_doubtful_gap_is_left_for_a_sure_one_on_the_other_side():
    things = _things([(0.9, 0.6), (0.2, -0.5)])
    things.sigma_m[0, 1] = 0.3  # sideways it fits with 0.75 only
    paper, ours = (
        choose(things, AvoidanceConfig(other_side=other), DARWIN_OP) for other in (False, True)
    )
    assert paper is not None
    assert ours is not None
    assert (paper.motion, paper.side) == ("ST", 1)
    assert (ours.motion, ours.side) == ("RF", -1)


def test_neighbours_that_overlap_leave_no_gap_in_words():
    choice = choose(
        _things([(0.9, 0.28), (0.3, -1.1)]), AvoidanceConfig(other_side=False), DARWIN_OP
    )
    assert choice is not None
    assert (choice.motion, choice.side) == ("ST", 1)
    assert "no gap there" in choice.why
    assert choice.passes == 0.0


def test_a_least_probability_of_one_is_refused():
    with pytest.raises(ConfigError, match="least_fit"):
        AvoidanceConfig(least_fit=1.0)


def test_narrow_gaps_on_both_sides_stop_the_robot_and_a_free_corridor_needs_no_choice():
    choice = choose(_things([(0.9, 0.4), (0.3, -0.3), (-0.4, -0.9)]), AvoidanceConfig(), DARWIN_OP)
    assert choice is not None
    assert choice.motion == "ST"
    assert choose(_things([(0.9, 0.5), (-0.5, -0.9)]), AvoidanceConfig(), DARWIN_OP) is None


def test_a_passage_between_two_blocking_obstacles_is_found():
    choice = choose(_things([(1.2, -0.02), (-0.27, -1.2)]), AvoidanceConfig(), DARWIN_OP)
    assert choice is not None
    assert (choice.motion[1], choice.side) == ("S", -1)
    assert choice.gap_m == pytest.approx(0.25)
    closed = choose(_things([(1.2, 0.06), (-0.06, -1.2)]), AvoidanceConfig(), DARWIN_OP)
    assert closed is not None
    assert closed.width_m == pytest.approx(2.4)


def test_a_converging_side_wall_does_not_block():
    things = _things([(1.2, -0.02), (-0.27, -1.2), (1.25, 1.1)])
    things.distance_m[2] = 0.2
    choice = choose(things, AvoidanceConfig(), DARWIN_OP)
    assert choice is not None
    assert choice.distance_m == pytest.approx(1.05)
    assert choice.motion[1] == "S"


def test_the_other_side_is_tried_only_on_request():
    spans = [(0.6, 0.45), (0.35, -0.6)]
    paper = choose(_things(spans), AvoidanceConfig(other_side=False), DARWIN_OP)
    ours = choose(_things(spans), AvoidanceConfig(), DARWIN_OP)
    assert paper is not None
    assert ours is not None
    assert (paper.motion, paper.side) == ("ST", 1)
    assert ours.motion != "ST"
    assert ours.side == -1


@pytest.mark.parametrize("motion", [m for m in MOTIONS if m != "ST"])
@pytest.mark.parametrize("side", [-1, 1])
def test_the_legs_lead_through_the_gap_within_the_limits_of_the_gait(motion, side):
    gait, start = GaitLimits(), Pose2(0.4, -0.3, 0.6)
    edge, gap = 0.2, 0.26 if motion[1] == "S" else 0.5
    at = pivot(motion, side, side * edge, gap, 0.5, 1.05)
    robot, way = start, []
    legs = primitives.passage(motion, at, start, 1.65)
    for _ in range(400):
        while legs and primitives.reached(legs[0], robot):
            legs.pop(0)
        if not legs:
            break
        step = primitives.step(legs[0], robot, gait)
        assert abs(step.turn_rad) <= gait.max_turn_rad + 1e-12
        assert step.forward_m <= gait.max_speed_mps * gait.step_s + 1e-12
        assert abs(step.lateral_m) <= gait.max_side_mps * gait.step_s + 1e-12
        robot = robot @ Pose2(step.forward_m, step.lateral_m, step.turn_rad)
        way.append(start.inverse() @ robot)
    assert not legs
    assert way[-1].x == pytest.approx(1.65, abs=0.05)
    inside = [side * p.y - edge for p in way if 1.05 <= p.x <= 1.29]
    assert inside
    assert all(0.0 < y < gap for y in inside)
    if motion[1] == "S":  # the narrow side goes first
        assert all(
            abs(abs(p.yaw) - math.pi / 2) < math.radians(5.0) for p in way if 1.05 <= p.x <= 1.29
        )
