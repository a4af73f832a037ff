"""The guard among moving obstacles and walls, in walks simulated step by step."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from perception.primitives.errors import ConfigError
from perception.primitives.gaussian import Gaussian
from perception.primitives.motion import Motion
from perception.primitives.obstacle import Obstacle
from perception.primitives.pose import Pose2, wrap_angle
from perception.primitives.robot_model import DARWIN_OP
from planning.footsteps import footstep, limited_step
from planning.safety import guard as guard_module
from planning.safety.guard import Guard, GuardConfig, choose
from planning.safety.guard_settings import CELL_CONTACT_M, HEADING_COST_M, UNSEEN_PER_M2
from planning.safety.prediction import MotionPatterns

CONFIG = GuardConfig()
GAIT = DARWIN_OP.gait
NOTHING = np.zeros((0, 2))
TIGHT = np.diag([1e-4, 1e-4, 1e-4, 1e-4])


def mover(x, y, vx, vy, seen_s=0.0, moving=1.0):
    state = Gaussian(np.array([x, y, vx, vy]), TIGHT)
    return Obstacle(state, 0.10, 0.4, 1, moving, seen_s, 0.0)


def at(pose):
    return Gaussian(pose.vector, np.diag([1e-4, 1e-4, 1e-4]))


def play(
    start, target, mover_at, cells=NOTHING, steps=60, cruise=0.07, noticed_s=0.0, config=CONFIG
):
    """Walk to the target past an obstacle with known position and velocity; least gaps and final pose.

    The body follows its feet half a step later. The guard keeps its memory: without it left and right are equally
    good at every step. A change of the obstacle's motion is noticed after `noticed_s`.
    """
    guard, last = Guard(config, DARWIN_OP), limited_step(GAIT, 0.0, 0.0, 0.0)
    pose, gap, wall = start, math.inf, math.inf
    for k in range(steps):
        now = 0.65 * k
        x, y, vx, vy = mover_at(now - noticed_s)
        x, y = x + vx * noticed_s, y + vy * noticed_s
        heading = math.atan2(target[1] - pose.y, target[0] - pose.x)
        close = math.hypot(target[0] - pose.x, target[1] - pose.y) < 0.1
        wish = footstep(heading, 0.0 if close else cruise, pose, GAIT)
        if close:
            wish = limited_step(GAIT, 0.0, 0.0, 0.0)
        step = guard.choose(wish, at(pose), [mover(x, y, vx, vy, now)], cells, target, now)
        for part, walk in enumerate((last, step)):
            pose = pose @ Pose2(walk.forward_m / 2, walk.lateral_m / 2, walk.turn_rad / 2)
            x, y, _, _ = mover_at(now + 0.325 * (part + 1))
            gap = min(gap, math.hypot(x - pose.x, y - pose.y) - 0.25)
            if len(cells):
                wall = min(wall, float(np.hypot(*(cells - (pose.x, pose.y)).T).min()))
        last = step
    return gap, wall, pose


def door(half_m):
    """Cells of a wall 0.4 m ahead with a doorway in the middle."""
    y = np.arange(half_m + 0.025, 1.5, 0.05)
    return np.column_stack([np.full(2 * len(y), 0.4), np.concatenate([y, -y])])


@pytest.mark.parametrize(("in_cells", "passes"), [(True, True), (False, False)])
def test_a_track_of_what_stands_in_occupied_cells_is_not_charged_beside_them(in_cells, passes):
    """The end of a wall is tracked, 5 cm inside it and of 10 cm radius; the doorway leaves 4 cm to each side."""
    half = DARWIN_OP.radius_m + 0.04
    cells = door(half)
    if not in_cells:  # no cell shows the same thing
        cells = cells[np.hypot(*(cells - [0.4, half + 0.05]).T) > 0.15]
    frame = mover(0.4, half + 0.05, 0.0, 0.0, moving=0.01)
    wish = limited_step(GAIT, 0.05, 0.0, 0.0)
    made = choose(wish, at(Pose2()), [frame], cells, np.array([1.5, 0.0]), CONFIG)
    assert (made == wish) == passes


@pytest.mark.parametrize(
    ("first", "later_s", "stays"),
    [
        (limited_step(GAIT, 0.0, 0.0, 0.0), 0.65, True),
        (limited_step(GAIT, 0.1, 0.0, 0.0), 0.65, False),
        (limited_step(GAIT, 0.1, 0.0, 0.0), 5.0, True),
    ],
)
def test_the_half_step_after_the_last_command_is_taken_into_account(first, later_s, stays):
    """An obstacle passes 36 cm ahead: enough for a standing robot, not for one that still moves on."""
    guard, stand = Guard(CONFIG, DARWIN_OP), limited_step(GAIT, 0.0, 0.0, 0.0)
    guard.choose(first, at(Pose2()), [], NOTHING, np.array([2.0, 0.0]), 0.0)
    by = mover(0.36, 0.3, 0.0, -0.06, later_s)
    chosen = guard.choose(stand, at(Pose2()), [by], NOTHING, np.zeros(2), later_s)
    assert (chosen == stand) is stays


@pytest.mark.parametrize(
    ("place", "velocity", "target"),
    [
        ((-0.28, 0.46), (0.030, -0.053), (-0.56, 0.31)),
        ((-0.27, 0.43), (0.027, -0.050), (-0.63, 0.40)),
        ((-0.21, 0.43), (0.030, -0.053), (-0.43, 0.29)),
    ],
)
def test_a_slightly_faster_obstacle_is_let_pass(place, velocity, target):
    """Backing away keeps clear for longer than the horizon and ends in a contact."""
    gap, _, pose = play(
        Pose2(0.0, 0.0, 2.6),
        np.array(target),
        lambda t: (place[0] + velocity[0] * t, place[1] + velocity[1] * t, *velocity),
        steps=40,
    )
    assert gap > 0.05
    assert math.hypot(pose.x - target[0], pose.y - target[1]) < 0.15


@pytest.mark.parametrize("bearing", np.radians([-120, -90, 90, 120]))
def test_after_evading_the_robot_turns_to_its_target(bearing):
    """A standing robot evades an obstacle from ahead and then goes on to a target beside it."""
    target = 1.2 * np.array([math.cos(bearing), math.sin(bearing)])
    stand = limited_step(GAIT, 0.0, 0.0, 0.0)
    guard, last, pose = Guard(CONFIG, DARWIN_OP), stand, Pose2()
    for k in range(14):
        now = 0.65 * k
        comes = mover(0.6 - 0.06 * now, 0.0, -0.06, 0.0, now)
        step = guard.choose(stand, at(pose), [comes], NOTHING, target, now)
        for walk in (last, step):
            pose = pose @ Pose2(walk.forward_m / 2, walk.lateral_m / 2, walk.turn_rad / 2)
        last = step
    off = math.atan2(target[1] - pose.y, target[0] - pose.x) - pose.yaw
    assert abs(math.remainder(off, 2.0 * math.pi)) < 0.05
    assert math.hypot(target[0] - pose.x, target[1] - pose.y) < 1.0


def test_without_obstacles_nearby_the_desired_step_is_kept():
    wish = footstep(0.3, 0.07, Pose2(), GAIT)
    far = mover(4.0, 4.0, 0.05, 0.0)
    assert choose(wish, at(Pose2()), [far], NOTHING, np.array([2.0, 0.5]), CONFIG) is wish


def test_after_the_desired_step_a_plan_pursues_the_target_or_stands():
    wish = footstep(0.3, 0.07, Pose2(), GAIT)
    plans = guard_module._desired_plans(wish, GAIT)
    begins = [[wish.forward_m, wish.lateral_m, wish.turn_rad]] * 3
    np.testing.assert_array_equal(plans[:, :3], begins)
    np.testing.assert_array_equal(plans[:, 3], [1, 1, 2])  # steps
    cruise = GAIT.cruise_mps * GAIT.step_s
    np.testing.assert_array_equal(plans[:, 4:], [[cruise, 0, 0, 1], [0] * 4, [0] * 4])


@pytest.mark.parametrize("speed", [0.03, 0.06])
@pytest.mark.parametrize("offset", [-0.1, 0.0, 0.15])
def test_a_head_on_obstacle_is_passed(speed, offset):
    gap, _, end = play(
        Pose2(), np.array([2.0, 0.0]), lambda t: (2.0 - speed * t, offset, -speed, 0.0)
    )
    assert gap > 0.0
    assert end.x > 1.5


@pytest.mark.parametrize("speed", [0.03, 0.06])
@pytest.mark.parametrize("start", [-0.8, -0.5, -0.3, 0.0])
def test_a_crossing_obstacle_is_passed(speed, start):
    gap, _, end = play(
        Pose2(), np.array([2.0, 0.0]), lambda t: (0.9, start + speed * t, 0.0, speed)
    )
    assert gap > 0.0
    assert end.x > 1.5


@pytest.mark.parametrize("bearing", np.radians([0, 60, 120, 180, 240, 300]))
def test_a_standing_robot_evades_an_obstacle(bearing):
    direction = np.array([math.cos(bearing), math.sin(bearing)])

    def place(t):
        return *(direction * (0.9 - 0.05 * t)), *(-0.05 * direction)

    gap, _, _ = play(Pose2(), np.array([0.0, 0.0]), place, steps=50)
    assert gap > 0.0


def test_evasion_in_a_corridor_keeps_clear_of_its_walls():
    along = np.arange(-1.0, 3.0, 0.05)
    cells = np.concatenate(
        [np.stack([along, np.full_like(along, y)], axis=-1) for y in (-0.55, 0.55)]
    )
    gap, wall, _ = play(
        Pose2(), np.array([2.0, 0.0]), lambda t: (1.6 - 0.05 * t, 0.0, -0.05, 0.0), cells
    )
    assert gap > 0.0
    assert wall >= 0.12


def test_a_wall_ahead_is_avoided():
    ys = np.arange(-1.0, 1.0, 0.05)
    cells = np.stack([np.full_like(ys, 0.5), ys], axis=-1)
    _, wall, _ = play(Pose2(), np.array([2.0, 0.0]), lambda t: (9.0, 9.0, 0.0, 0.0), cells)
    assert wall >= 0.12


def goes_straight_for_ever(obstacle: Obstacle) -> Motion:
    """Modes of which only the straight one has a probability, and no change between them."""
    state = obstacle.state
    return Motion(
        np.array([0.0, 1e-9, 1.0 - 1e-9, 0.0, 0.0]),
        np.tile(state.mean, (5, 1)),
        np.tile(state.covariance, (5, 1, 1)),
        np.zeros((5, 5)),
        np.eye(2) * 1e-4,
        state,
    )


@pytest.mark.parametrize("radius_m", [0.075, 0.15, 0.34])
def test_a_robot_of_any_size_walks_between_cells_that_its_disc_does_not_reach(radius_m):
    """Two rows of square cells, 5 cm wide: a disc this far from their middles is clear of their corners at any angle."""
    robot, corner_m = replace(DARWIN_OP, radius_m=radius_m), 0.025 * math.sqrt(2.0)
    sides = (radius_m + corner_m) * np.array([1.0, -1.0])
    cells = np.array([(x, y) for x in np.arange(-0.5, 1.5, 0.05) for y in sides])
    wish = footstep(0.0, 0.07, Pose2(), GAIT)
    assert choose(wish, at(Pose2()), [], cells, np.array([1.0, 0.0]), CONFIG, robot) is wish
    for wide in (1, 2):
        guard = Guard(CONFIG, robot, 0.05 * wide)
        assert guard.cell_distance_m == pytest.approx(radius_m + wide * corner_m, abs=1e-3)


def test_the_robot_does_not_follow_an_obstacle_that_may_reverse_closely():
    wish = footstep(0.0, 0.10, Pose2(), GAIT)
    away = mover(0.54, 0.0, 0.06, 0.0)
    target = np.array([1.0, 0.0])
    assert choose(wish, at(Pose2()), [away], NOTHING, target, CONFIG, stamp_s=0.0) is not wish
    steady = replace(away, motion=goes_straight_for_ever(away))
    assert choose(wish, at(Pose2()), [steady], NOTHING, target, CONFIG, stamp_s=0.0) is wish


@pytest.mark.parametrize("start", [-0.2, 0.0])
@pytest.mark.parametrize("turns_s", range(1, 14))
def test_an_obstacle_that_reverses_before_the_following_robot_is_avoided(start, turns_s):
    def back_and_forth(now):
        gone = min(now, 2.0 * turns_s - now)
        return start + 0.06 * gone, -0.55, math.copysign(0.06, turns_s - now), 0.0

    ahead = Pose2(0.0, 0.0, -math.pi / 2)
    target = np.array([0.3, -1.6])
    gap, _, _ = play(ahead, target, back_and_forth, steps=45, noticed_s=0.65)
    assert gap > 0.0


def test_an_obstacle_out_of_sight_may_be_anywhere_on_its_line():
    """It is predicted far away, but was last seen ten seconds ago and may have reversed."""
    wish = footstep(0.0, 0.07, Pose2(), GAIT)
    lost = mover(0.4, 1.2, 0.0, 0.06, seen_s=0.0)
    target = np.array([1.0, 0.0])
    assert choose(wish, at(Pose2()), [lost], NOTHING, target, CONFIG, stamp_s=0.0) is wish
    assert choose(wish, at(Pose2()), [lost], NOTHING, target, CONFIG, stamp_s=10.0) is not wish


def test_the_margin_grows_with_the_covariance():
    """The same step passes a certain obstacle and not an uncertain one."""
    wish = footstep(0.0, 0.07, Pose2(), GAIT)
    target = np.array([0.6, 0.0])
    there = mover(0.4, 0.40, 0.0, 0.0)
    sure, vague = (
        replace(there, state=Gaussian(there.state.mean, np.diag([v, v, 1e-8, 1e-8])))
        for v in (1e-4, 0.02)
    )
    assert choose(wish, at(Pose2()), [sure], NOTHING, target, CONFIG, stamp_s=0.0) is wish
    assert choose(wish, at(Pose2()), [vague], NOTHING, target, CONFIG, stamp_s=0.0) is not wish


def test_the_same_scene_gives_the_same_step():
    rng = np.random.default_rng(5)
    movers = [mover(*rng.uniform(-0.6, 0.6, 2), *rng.uniform(-0.06, 0.06, 2)) for _ in range(3)]
    cells, wish = rng.uniform(-1, 1, (40, 2)), footstep(1.0, 0.07, Pose2(), GAIT)
    target = np.array([1.0, 1.0])
    steps = {
        choose(wish, at(Pose2()), movers, cells, target, CONFIG, stamp_s=0.0) for _ in range(5)
    }
    assert len(steps) == 1


def test_a_horizon_in_a_wrong_unit_is_refused():
    with pytest.raises(ConfigError, match=r"must be .*at most"):
        replace(CONFIG, steps=10**9)


def test_without_obstacles_a_plan_costs_the_way_that_it_leaves_to_the_target():
    rng = np.random.default_rng(5)
    plans = guard_module._fixed_plans(guard_module.SHOWN, GAIT)
    for _ in range(5):
        robot, target = Pose2(*rng.uniform(-1.0, 1.0, 3)), rng.uniform(-1.5, 1.5, 2)
        config = replace(CONFIG, steps=guard_module.SHOWN)
        scene = guard_module._Scene(
            at(robot), [], NOTHING, target, config, DARWIN_OP, 0.0, MotionPatterns(), 0.2
        )
        places = scene.walked(plans)
        _, cost = scene.judge(places)
        for walked, claimed in zip(places, cost, strict=True):
            away = np.hypot(*(walked[:, :2] - target).T)
            nearest = min(away.min(), math.hypot(target[0] - robot.x, target[1] - robot.y))
            bearing = math.atan2(*(target - walked[-1, :2])[::-1])
            off = abs(wrap_angle(bearing - walked[-1, 2])) if nearest > 0.1 else 0.0
            expected = nearest + 0.1 * (away[-1] - nearest) + HEADING_COST_M * off
            assert claimed == pytest.approx(expected, abs=1e-9)


def test_the_first_pose_shown_is_the_step_that_the_guard_chose():
    """Past an obstacle that comes head on, where it replaces the desired step."""
    guard, wish = Guard(CONFIG, DARWIN_OP), limited_step(GAIT, 0.07, 0.0, 0.0)
    start = Pose2(0.1, -0.2, 0.4)
    ahead = np.array(start.apply(np.array([0.45, 0.02])))
    obstacle = mover(*ahead, -0.05, -0.02)
    step = guard.choose(
        wish, at(start), [obstacle], NOTHING, start.apply(np.array([2.0, 0.0])), 0.0
    )
    assert step != wish
    there = start @ Pose2(step.forward_m, step.lateral_m, step.turn_rad)
    np.testing.assert_allclose(guard.ahead[0], there.vector, atol=1e-9)
    assert 0.0 <= guard.risk <= 1.0


@pytest.mark.parametrize("yaw_deg", [30, 90, 140, 180])
def test_cells_under_its_own_body_hold_no_robot(yaw_deg):
    """A patch of the map that somebody left occupied; the body is in its midst, so nothing stands there."""
    side = np.arange(-0.11, 0.05, 0.05)
    cells = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    start, target = Pose2(0.0, 0.0, math.radians(yaw_deg)), np.array([0.44, 0.18])
    _, _, pose = play(start, target, lambda t: (9.0, 9.0, 0.0, 0.0), cells)
    assert math.hypot(pose.x - target[0], pose.y - target[1]) < 0.1


def test_the_robot_does_not_back_into_ground_that_it_never_saw():
    """A chair keeps it from its target to the left behind it; where it never looked there may be a wall."""
    side = np.arange(-1.0, 1.0, 0.05)
    ground = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    chair = np.array([(0.05 * i, 0.35 + 0.05 * j) for i in range(4) for j in range(3)])
    target, wish = np.array([-0.92, 0.77]), limited_step(GAIT, 0.0, 0.0, 0.24)
    steps = [
        Guard(CONFIG, DARWIN_OP).choose(wish, at(Pose2()), [], chair, target, 0.0, unseen)
        for unseen in (None, ground[ground[:, 0] > 0.6], ground[ground[:, 0] < -0.15])
    ]
    assert steps[0].forward_m < 0.0
    assert steps[1] == steps[0]  # what was not seen lies elsewhere
    assert steps[2].forward_m >= 0.0


@pytest.mark.parametrize("back_m", [0.0, 0.04, 0.08])
def test_unseen_ground_costs_by_the_area_behind_that_only_the_plan_covers(back_m):
    """Discs of the body's radius, shifted straight back: the first has reached x = -0.04 m, another one x = -back_m."""
    cell_m, r = 0.005, DARWIN_OP.breadth * CELL_CONTACT_M
    side = np.arange(-0.4, 0.4, cell_m)
    ground = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    scene = guard_module._Scene(
        at(Pose2()), [], NOTHING, np.array([1.0, 0.0]), CONFIG, DARWIN_OP, 0.0, MotionPatterns(), 0.2,
        ground, cell_m,
    )  # fmt: skip
    reached = np.array([-0.04, -back_m, 0.08])  # the third walks on, over ground ahead as unseen
    places = np.zeros((3, 2 * CONFIG.steps, 3))
    places[:, :, 0] = reached[:, None]

    def moved(d):  # what a disc shifted by d covers beyond one in place
        return math.pi * r**2 - 2 * r**2 * math.acos(d / 2 / r) + d / 2 * math.sqrt(4 * r**2 - d**2)

    more = max(moved(back_m) - moved(0.04), 0.0)
    expected = [0.0, 1.0 - math.exp(-UNSEEN_PER_M2 * more), 0.0]
    np.testing.assert_allclose(scene.ventures(places), expected, atol=2e-3)


def test_somebody_who_comes_is_given_way_to_wherever_the_robot_looked():
    """Nothing was seen behind the robot; an obstacle comes head on, faster than it backs away."""
    side = np.arange(-1.0, 1.0, 0.05)
    ground = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    comes, target = mover(0.6, 0.0, -0.05, 0.0), np.array([1.0, 0.0])
    wish = limited_step(GAIT, 0.0, 0.0, 0.0)
    steps = [
        Guard(CONFIG, DARWIN_OP).choose(wish, at(Pose2()), [comes], NOTHING, target, 0.0, unseen)
        for unseen in (None, ground[ground[:, 0] < -0.15])
    ]
    assert steps[0].forward_m < 0.0
    assert steps[1] == steps[0]
