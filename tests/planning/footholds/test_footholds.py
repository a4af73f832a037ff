"""Footholds and footsteps over surfaces of known geometry."""

from __future__ import annotations

import itertools
from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.stats import norm

from mapping.ground.surface import Border, Surface
from perception.primitives.errors import ConfigError
from perception.primitives.pose import Pose2
from perception.primitives.robot_model import RobotModel, StepLimits
from planning.footholds._search_kernels import search
from planning.footholds.foothold import FootNoise, chances, packed
from planning.footholds.search import NODES, FootholdConfig, PlanEnd, Stance, plan
from planning.planners.foothold_planner import THOROUGH
from planning.search.path import Terrain

ROBOT = RobotModel(
    foot_m=(0.205, 0.066), hip_m=0.63, stance_m=0.20, steps=StepLimits(0.14, 0.10, 0.30)
)
ASKEW = RobotModel(
    foot_m=(0.205, 0.066), hip_m=0.63, stance_m=0.20, steps=StepLimits(0.10, 0.10, 0.35)
)
STANCE = Stance(-1, Pose2(0.0, -0.1))
FIRM = FootNoise(1e-6, 1e-6, 1e-6)
SLIPPING = FootNoise(0.0015, 0.0006, np.radians(0.6))


def rectangle(x0, x1, z=0.0, borders=(1, 1, 1, 1), sigma_m=0.005, half=0.5) -> Surface:
    """Sides in order: right, front, left, back."""
    outline = np.array([[x0, -half], [x1, -half], [x1, half], [x0, half]])
    return Surface(
        np.array([(x0 + x1) / 2, 0.0]),
        np.array([z, 0.0, 0.0]),
        1e-6 * np.eye(3),
        outline,
        np.array(borders),
        np.full(4, sigma_m),
    )


def flight(riser_m: float, tread_m: float, steps: int, away_m: float = 0.4) -> list[Surface]:
    """Ground, then steps, the last one a platform."""
    beyond, behind = (Border.RISE, Border.DROP) if riser_m > 0.0 else (Border.DROP, Border.RISE)
    found = [rectangle(-0.5, away_m, 0.0, (0, beyond, 0, 0))]
    for k in range(1, steps + 1):
        start = away_m + (k - 1) * tread_m
        last = k == steps
        end = start + (1.5 if last else tread_m)
        found.append(rectangle(start, end, k * riser_m, (1, 0 if last else beyond, 1, behind)))
    return found


def test_the_chance_of_an_edge_is_that_of_drawn_edges_and_feet():
    rng = np.random.default_rng(3)
    noise, sigma = FootNoise(0.004, 0.003, 0.03), 0.006
    surface = rectangle(0.0, 0.24, sigma_m=sigma, half=0.12)
    draws = 40_000
    shift = sigma * rng.standard_normal((draws, 4))  # of right, front, left, back, outwards
    error = noise.variances**0.5 * rng.standard_normal((draws, 3))
    corners = np.array([[0.1025, 0.033], [0.1025, -0.033], [-0.1025, 0.033], [-0.1025, -0.033]])
    for x, y, yaw in (
        (0.12, 0.0, 0.0),
        (0.128, 0.0, 0.05),
        (0.13, 0.08, 0.0),
        (0.115, -0.075, -0.1),
    ):
        c, s = np.cos(yaw + error[:, 2]), np.sin(yaw + error[:, 2])
        px = x + np.cos(yaw) * error[:, 0] - np.sin(yaw) * error[:, 1]
        py = y + np.sin(yaw) * error[:, 0] + np.cos(yaw) * error[:, 1]
        xs = px[:, None] + c[:, None] * corners[:, 0] - s[:, None] * corners[:, 1]
        ys = py[:, None] + s[:, None] * corners[:, 0] + c[:, None] * corners[:, 1]
        off = (ys.min(1) < -0.12 - shift[:, 0]) | (xs.max(1) > 0.24 + shift[:, 1])
        off |= (ys.max(1) > 0.12 + shift[:, 2]) | (xs.min(1) < -shift[:, 3])
        missed, unseen = chances(surface, Pose2(x, y, yaw), ROBOT, noise)
        assert unseen == 0.0
        assert missed == pytest.approx(off.mean(), abs=0.02 + 0.1 * off.mean())


def test_unseen_sides_count_by_themselves_and_sides_of_other_parts_not_at_all():
    seen = rectangle(0.0, 0.6, borders=(0, 0, 0, 0))
    assert chances(seen, Pose2(0.3, 0.0), ROBOT, FIRM) == pytest.approx((0.0, 0.0), abs=1e-9)
    missed, unseen = chances(seen, Pose2(0.5, 0.0), ROBOT, FIRM)
    assert missed == 0.0
    assert unseen < 1e-3
    over_m = 0.52 + 0.4 * ROBOT.foot_m[0] - 0.6  # of the inner four fifths, at a sigma of 5 mm
    assert chances(seen, Pose2(0.52, 0.0), ROBOT, FIRM)[1] == pytest.approx(
        norm.cdf(over_m / 0.005), abs=1e-3
    )
    assert chances(seen, Pose2(0.9, 0.0), ROBOT, FIRM) == (1.0, 1.0)
    corner = np.array([[0, -1.0], [1.0, -1.0], [1.0, -0.5], [0.3, -0.5], [0.3, 0.5], [0, 0.5]])
    bent = Surface(
        np.zeros(2), np.zeros(3), 1e-6 * np.eye(3), corner, np.ones(6, int), np.full(6, 0.005)
    )
    assert chances(bent, Pose2(0.15, 0.2), ROBOT, FIRM)[0] < 1e-6
    assert chances(bent, Pose2(0.80, -0.75), ROBOT, FIRM)[0] < 1e-6
    assert chances(bent, Pose2(0.25, -0.40), ROBOT, FIRM)[0] > 0.5  # across the inner corner


def test_the_far_side_of_a_thin_wall_that_is_badly_known_bars_no_foot_on_this_side():
    ring = [(0, 0), (2, 0), (2, 2), (1.05, 2), (1.05, 0.5), (0.95, 0.5), (0.95, 2), (0, 2)]
    sigma = np.full(8, 0.005)
    sigma[5] = 0.1  # of the far side, seen long ago
    floor = Surface(
        np.ones(2), np.zeros(3), 1e-6 * np.eye(3), np.array(ring, float), np.full(8, 2), sigma
    )
    assert chances(floor, Pose2(1.45, 1.2), ROBOT, FIRM)[0] < 1e-6
    assert chances(floor, Pose2(0.80, 1.2), ROBOT, FIRM)[0] == pytest.approx(
        norm.cdf((0.80 + ROBOT.foot_m[0] / 2 - 0.95) / 0.1), abs=1e-3
    )


def walked(ground, goal, stance=STANCE, config=None, steps=60):
    """The footholds and commands of a robot that plans anew at every step, and where the last plan ended."""
    done = []
    for _ in range(steps):
        found = plan(ground, stance, np.array(goal), 0.1, ROBOT, SLIPPING, config)
        if not found.footholds:
            break
        first = found.footholds[0]
        done.append((first, found.commands[0]))
        stance = Stance(first.foot, first.pose, first.height_m)
        if found.end is not PlanEnd.HORIZON and len(found.footholds) == 1:
            break
    return done, found.end


@pytest.mark.parametrize(("riser_m", "tread_m"), [(0.12, 0.28), (0.10, 0.34), (-0.09, 0.28)])
def test_stairs_are_walked_within_the_limits_of_the_robot(riser_m, tread_m):
    ground = flight(riser_m, tread_m, 4)
    done, end = walked(ground, (2.0, 0.0))
    assert end is PlanEnd.GOAL
    before, foot, pose = 0.0, STANCE.foot, STANCE.pose
    for step, command in done:
        assert step.foot == -foot
        assert step.missed <= 0.01
        assert step.unseen <= 0.01
        assert chances(ground[step.surface], step.pose, ROBOT, SLIPPING)[0] == pytest.approx(
            step.missed
        )
        assert command.rise_m == pytest.approx(step.height_m - before)
        assert -ROBOT.steps.down_m <= command.rise_m <= ROBOT.steps.up_m
        assert (
            command.forward_m
            <= (ROBOT.steps.reach_m if abs(command.rise_m) > 0.01 else 0.065) + 1e-9
        )
        frame = pose @ Pose2(0.0, -foot * ROBOT.stance_m / 2)
        moved = frame @ Pose2(command.forward_m, command.lateral_m, command.turn_rad)
        lands = moved @ Pose2(0.0, step.foot * ROBOT.stance_m / 2)
        assert lands.vector == pytest.approx(step.pose.vector, abs=1e-9)
        before, foot, pose = step.height_m, step.foot, step.pose
    assert before == pytest.approx(4 * riser_m)


@pytest.mark.parametrize("riser_m", [0.12, -0.09])
def test_a_plan_costs_its_way_on_the_ground_and_a_share_for_each_step_turn_rise_and_chance(riser_m):
    """The sum over its footsteps, from where they lead: no share is lost, doubled, or of the other sign."""
    sides, planes = packed(flight(riser_m, 0.28, 3))
    price = np.linspace(1.0, 2.0, 60 * 40).reshape(40, 60)  # of ground beside something
    blocked, grid = np.zeros((40, 60), np.bool_), np.array([-1.0, -2.0, 0.1])
    h, limits = 0.1, np.array([0.065, 0.02, 0.02, 0.25, 0.14, 0.10, 0.30, 0.27, 0.087])
    costs, risk = np.array([0.03, 0.07, 0.9, 1.7, 0.2]), 0.01
    body = np.array([0.1025, 0.033, h, 0.15])
    start = np.array([0.0, -h, 0.3, 0.0, -1.0, -1.0])
    goal = np.array([1.4, 0.1, 0.1])
    nodes, moves, last, _, _ = search(
        sides,
        planes,
        start,
        goal,
        body,
        limits,
        costs,
        SLIPPING.variances,
        risk,
        9.0,
        140,
        price,
        blocked,
        grid,
    )
    path = [last]
    while path[-1] > 0:
        path.append(int(nodes[path[-1], 9]))
    found = nodes[path[::-1]]
    middles = found[:, :2] + h * found[:, 5:6] * np.column_stack(
        [np.sin(found[:, 2]), -np.cos(found[:, 2])]
    )
    assert len(found) > 4
    assert abs(found[-1, 3]) > 0.5 * abs(riser_m)  # it takes stairs
    expected = 0.0
    for before, after, a, b in zip(found, found[1:], middles, middles[1:], strict=False):
        column, row = np.floor((b - grid[:2]) / grid[2]).astype(int)
        rise = after[3] - before[3]
        expected += price[row, column] * np.hypot(*(b - a)) + costs[0]
        expected += costs[1] * abs(after[2] - before[2])
        expected += costs[2] * rise if rise > 0.0 else -costs[3] * rise
        expected += costs[4] * (after[7] + after[8]) / risk
        assert after[6] == pytest.approx(expected, abs=1e-9)
    assert found[:, 5].tolist() == [(-1.0) ** (k + 1) for k in range(len(found))]  # feet take turns
    turns = np.diff(found[:, 2])
    np.testing.assert_allclose(moves[path[-2::-1], 2], turns, atol=1e-12)
    assert np.abs(turns).max() <= limits[3] + 1e-12


@pytest.mark.parametrize(("riser_m", "tread_m"), [(0.16, 0.28), (-0.12, 0.28), (0.10, 0.215)])
def test_what_is_too_high_or_too_narrow_is_not_stepped_on(riser_m, tread_m):
    done, end = walked(flight(riser_m, tread_m, 3), (2.0, 0.0), steps=12)
    assert end is PlanEnd.BORDER
    assert all(step.surface == 0 for step, _ in done)


def test_a_plan_ends_at_the_border_of_what_was_seen():
    done, end = walked([rectangle(-0.5, 1.0, borders=(0, 0, 0, 0))], (4.0, 0.0))
    last, _ = done[-1]
    assert end is PlanEnd.BORDER
    assert last.unseen <= 0.01
    assert 0.85 < last.pose.x < 0.91  # as near to the border as the sole may go
    assert plan([], STANCE, np.array([2.0, 0.0]), 0.1, ROBOT, SLIPPING).footholds == ()


def test_unknown_ground_between_two_heights_may_hold_stairs():
    ground = [rectangle(-0.5, 1.0, borders=(0, 0, 0, 0)), rectangle(2.2, 4.0, 0.5, half=9.0)]
    done, _ = walked(ground, (3.0, 0.0), steps=40)
    last, _ = done[-1]
    assert 0.8 < last.pose.x < 0.91  # at the border of what was seen


def test_a_goal_on_an_island_that_no_step_reaches_gives_no_steps():
    here, there = rectangle(-0.5, 0.6), rectangle(0.6, 2.6, 0.5)
    found = plan(
        [here, there, rectangle(-9.0, 9.0, -0.8, half=9.0)], STANCE, np.array([2.0, 0.0]), 0.1, ROBOT, FIRM
    )  # fmt: skip
    assert (found.end, found.footholds, found.gain_m) == (PlanEnd.BORDER, (), 0.0)


def test_a_hole_is_walked_round():
    corners = [
        (-0.5, -0.8),
        (2, -0.8),
        (2, 0.8),
        (0.9, 0.8),
        (0.9, -0.2),
        (0.3, -0.2),
        (0.3, 0.8),
        (-0.5, 0.8),
    ]
    borders = np.array([0, 0, 0, 1, 1, 1, 0, 0])
    hole = Surface(
        np.zeros(2),
        np.zeros(3),
        1e-6 * np.eye(3),
        np.array(corners, float),
        borders,
        np.full(8, 0.01),
    )
    done, end = walked([hole], (1.4, 0.0))
    assert end is PlanEnd.GOAL
    assert min(step.pose.y for step, _ in done) < -0.3
    assert all(step.missed <= 0.01 for step, _ in done)


@pytest.mark.parametrize("foot", [1, -1])
def test_a_robot_that_stands_askew_climbs_at_once_where_its_other_foot_would_have_to_shift(foot):
    turn = foot * np.radians(10.0)  # beside the foot that has landed the edge is farther
    treads = [replace(one, sigma_m=np.full(4, 0.016)) for one in flight(0.084, 0.338, 3, 0.205)]
    goal = np.array([1.5, 0.0])
    found = plan(treads, Stance(foot, Pose2(0.0, 0.0, turn)), goal, 0.1, ASKEW, SLIPPING)
    assert found.footholds[0].height_m == pytest.approx(0.084)


def test_a_foot_does_not_step_up_where_the_other_one_has_no_ground_of_its_level():
    corners = np.array([(-0.5, -1), (2, -1), (2, 0), (0.4, 0), (0.4, 1), (-0.5, 1)])
    floor = Surface(
        np.zeros(2), np.zeros(3), 1e-6 * np.eye(3), corners,
        np.array([1, 0, 1, 1, 0, 0]), np.full(6, 0.005),
    )  # fmt: skip
    beam = rectangle(0.4, 2.0, 0.08, half=0.09)  # beside the floor: one foot on each would lead on
    shift = np.array([0.0, 0.1])
    beam = replace(beam, origin=beam.origin + shift, outline=beam.outline + shift)
    done, _ = walked([floor, beam], (1.6, 0.1), steps=10)
    assert len(done) > 4
    assert max(step.height_m for step, _ in done) == 0.0


def test_a_wall_that_only_the_surface_remembers_is_walked_round_and_a_step_up_is_not():
    corners = np.array([(-0.5, -2.5), (2, -2.5), (2, 2.5), (-0.5, 2.5)], float)
    corners[1, 0] = corners[2, 0] = 0.8
    corners = np.insert(corners, 2, (0.8, 1.0), axis=0)  # a wall up to here, then what was not seen
    ground = rectangle(0, 1, sigma_m=0.005)
    ends = {}
    for name, beyond, step in (("open", 0, []), ("wall", 2, []), ("step", 2, [rectangle(0.8, 2.5, 0.08, half=2.5)])):  # fmt: skip
        floor = Surface(
            ground.origin, ground.height, ground.covariance, corners,
            np.array([0, beyond, 0, 0, 0]), np.full(5, 0.005),
        )  # fmt: skip
        done, _ = walked([floor, *step], (2.3, -0.3))
        ends[name] = done[-1][0].pose
    assert ends["open"].y < 0.4
    assert ends["wall"].y > 0.9  # where the wall ends
    assert ends["step"].x > 1.9
    assert ends["step"].y < 0.4


def test_more_nodes_find_the_way_through_a_crooked_corridor():
    axis = -3.2 + (np.arange(128) + 0.5) * 0.05
    x, y = np.meshgrid(axis, axis)
    blocked = np.ones((128, 128), np.bool_)
    corners = np.array([(-0.6, 0.0), (0.15, 0.0), (0.5, -0.35), (1.1, 0.35), (2.6, 0.0)])
    for a, b in itertools.pairwise(corners):
        share = np.clip(
            ((x - a[0]) * (b - a)[0] + (y - a[1]) * (b - a)[1]) / ((b - a) @ (b - a)), 0, 1
        )
        off = np.hypot(x - a[0] - share * (b - a)[0], y - a[1] - share * (b - a)[1])
        blocked &= off > 0.08  # the frame between the feet has 16 cm
    corridor = Terrain(np.ones((128, 128)), blocked, blocked, np.full(2, -3.2), 0.05)
    floor = rectangle(-1.0, 3.0, half=2.0)
    found = {
        nodes: plan([floor], STANCE, np.array([2.5, 0.0]), 0.1, ROBOT, SLIPPING, None, corridor, nodes)
        for nodes in (NODES, THOROUGH)
    }  # fmt: skip
    bend_m = corners[2, 0]
    assert found[NODES].end is PlanEnd.BORDER
    assert max(one.pose.x for one in found[NODES].footholds) < bend_m
    assert found[THOROUGH].end is PlanEnd.HORIZON
    assert found[THOROUGH].footholds[-1].pose.x > bend_m


def test_a_search_without_a_node_is_refused():
    with pytest.raises(ConfigError, match="nodes=0"):
        plan([rectangle(-1.0, 3.0)], STANCE, np.array([2.5, 0.0]), 0.1, ROBOT, SLIPPING, nodes=0)


def test_more_risk_allows_narrower_treads():
    narrow = flight(0.10, 0.23, 3)
    assert walked(narrow, (1.6, 0.0), steps=12)[1] is PlanEnd.BORDER
    assert walked(narrow, (1.6, 0.0), config=FootholdConfig(0.2))[1] is PlanEnd.GOAL


def test_a_bound_that_is_no_chance_is_refused():
    with pytest.raises(ConfigError, match="risk"):
        FootholdConfig(0.0)


@pytest.mark.parametrize("turn_deg", [14.0, 30.0, 45.0])
def test_no_sole_is_set_upon_the_other(turn_deg):
    """Wide feet close together, which overlap if they turn inwards by more than 20 deg; areas by OpenCV."""
    robot = replace(ROBOT, foot_m=(0.21, 0.13), stance_m=0.18)
    robot = replace(robot, gait=replace(robot.gait, max_turn_deg=turn_deg))
    ground = [rectangle(-4.0, 4.0, half=4.0)]
    rng, headings = np.random.default_rng(0), []

    def sole(pose):
        ahead, left = np.degrees(pose.yaw), (robot.foot_m[0], robot.foot_m[1])
        return (pose.x, pose.y), left, ahead

    for angle in rng.uniform(-np.pi, np.pi, 6):
        goal = 1.5 * np.array([np.cos(angle), np.sin(angle)])
        found = plan(ground, STANCE, goal, 0.2, robot, FIRM, nodes=20 * NODES)
        poses = [STANCE.pose, *(one.pose for one in found.footholds)]
        headings += [one.yaw for one in poses]
        for before, after in itertools.pairwise(poses):
            _, shared = cv2.rotatedRectangleIntersection(sole(before), sole(after))
            area = 0.0 if shared is None else cv2.contourArea(cv2.convexHull(shared))
            assert area < 1e-5
    assert np.ptp(headings) > 1.0


@pytest.mark.parametrize("height_m", [0.18, 0.7])
def test_no_sole_is_set_below_another_surface(height_m):
    """The ground goes on below the board of an open step, or below a table; the shin does not."""
    floor = rectangle(-0.5, 3.0, borders=(0, 0, 0, 0), half=1.5)
    board = rectangle(0.7, 1.0, height_m, half=0.6)
    reach = np.array(ROBOT.foot_m) / 2
    for goal in ([0.66, 0.0], [2.0, 0.0], [1.04, 0.58]):
        done, _ = walked([floor, board], goal)
        assert done
        for foot, _ in done:
            c, s = abs(np.cos(foot.pose.yaw)), abs(np.sin(foot.pose.yaw))
            ahead, across = c * reach[0] + s * reach[1], s * reach[0] + c * reach[1]
            beside = abs(foot.pose.x - 0.85) > 0.15 + ahead or abs(foot.pose.y) > 0.6 + across
            assert beside, foot


def test_a_strip_that_rises_to_the_edge_of_a_step_does_not_bar_it():
    """Depth that smears a riser shows such strips; carried on over the step, their planes would be above it."""
    ground = flight(0.06, 0.33, 3)
    strips = []
    for k in range(3):
        edge = 0.4 + 0.33 * k
        outline = np.array(
            [[edge - 0.04, -0.5], [edge + 0.04, -0.5], [edge + 0.04, 0.5], [edge - 0.04, 0.5]]
        )
        plane = np.array([0.06 * k + 0.03, 0.7, 0.0])
        sides = np.array([Border.UNSEEN, Border.DROP, Border.UNSEEN, Border.RISE])
        strips.append(Surface(np.array([edge, 0.0]), plane, 1e-3 * np.eye(3), outline, sides, np.full(4, 0.03)))  # fmt: skip
    done, end = walked([*ground, *strips], (2.0, 0.0))
    assert end is PlanEnd.GOAL
    assert all(step.surface < len(ground) for step, _ in done)
    assert done[-1][0].height_m == pytest.approx(0.18)
