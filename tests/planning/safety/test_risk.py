"""Claimed probability of contact against simulated obstacles, and the guard's bound on it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from perception.obstacles._track_kernels import changes
from perception.obstacles.track import Detection
from perception.obstacles.tracker import ObstacleTracker
from perception.primitives.errors import ConfigError
from perception.primitives.gaussian import Gaussian
from perception.primitives.motion import GOING, Motion
from perception.primitives.obstacle import Obstacle
from perception.primitives.pose import Pose2
from perception.primitives.robot_model import DARWIN_OP
from planning.commands import WalkCommand
from planning.footsteps import footstep
from planning.safety._guard_kernels import walked
from planning.safety._risk_kernels import disc_mass
from planning.safety.guard import Guard, _desired_plans
from planning.safety.guard_settings import (
    CELL_CONTACT_M,
    RISK_S,
    SAME_RISK,
    SIZE_SIGMA_M,
    GuardConfig,
)
from planning.safety.prediction import MotionPatterns
from planning.safety.risk import Risk

STEP_S = DARWIN_OP.gait.step_s
CONFIG = GuardConfig()
GAIT, STEPS = DARWIN_OP.gait, CONFIG.steps
NOTHING = np.zeros((0, 2))
SURE = Gaussian(np.zeros(3), np.diag([1e-4, 1e-4, 1e-4]))


def watched(place: np.ndarray, velocity: np.ndarray, seed: int = 0) -> Obstacle:
    """The track of something seen for 9 s, now at a place."""
    rng, tracker = np.random.default_rng(seed), ObstacleTracker()
    for k in range(31):
        there = place + (0.3 * k - 9.0) * velocity + 0.01 * rng.standard_normal(2)
        tracker.update(0.3 * k, [Detection(there, np.eye(2) * 1e-4, 0.1)], SURE)
    (found,) = tracker.obstacles
    return found


def tracked(place: np.ndarray, velocity: np.ndarray, seed: int = 0) -> Obstacle:
    """As `watched`, known to move."""
    found = watched(place, velocity, seed)
    assert found.moving > 0.5
    return found


def places_of(plan: np.ndarray, target: tuple[float, float] = (3.0, 0.0)) -> np.ndarray:
    """(1, n, 3) poses on a plan from the origin."""
    return walked(np.zeros(3), plan[None], np.array(target), GAIT.max_turn_rad, STEPS)


def contact_share(obstacle: Obstacle, plan: np.ndarray, runs: int = 20000) -> float:
    """Share of simulated futures in which the plan touches: modes change at random, the pose and the sizes err.

    The body begins a step half a step after its command, and follows its feet evenly from then on.
    """
    rng, motion, dt = np.random.default_rng(1), obstacle.motion, 0.05
    assert isinstance(motion, Motion)
    weights = motion.probabilities.copy()
    weights[0] = 0.0
    weights *= obstacle.moving / weights.sum()
    weights[0] = 1.0 - obstacle.moving
    mode = rng.choice(5, runs, p=weights)
    root = np.linalg.cholesky(motion.covariances)
    x = motion.means[mode] + np.einsum("nij,nj->ni", root[mode], rng.standard_normal((runs, 4)))
    rates = motion.rates.copy()
    rates[4, 2:4] = 0.0
    chances = np.cumsum(changes(rates, dt), axis=1)
    chances[:, -1] = 1.0
    error = rng.multivariate_normal(np.zeros(2), SURE.covariance[:2, :2], runs)
    radius = DARWIN_OP.radius_m + obstacle.radius_m + SIZE_SIGMA_M * rng.standard_normal(runs)
    poses = places_of(plan)[0, :8]
    times = np.concatenate([[0.0], np.arange(1, 10) * STEP_S / 2])
    along = np.concatenate([[[0.0, 0.0]] * 2, poses[:, :2]])
    hit = np.zeros(runs, np.bool_)
    for k in range(round(RISK_S / dt)):
        after = (rng.random(runs)[:, None] > chances[mode]).sum(axis=1)
        anew = (after == 4) & (mode != 4)
        x[(after < GOING) & (mode != after), 2:] = 0.0
        x[anew, 2:] = rng.multivariate_normal(np.zeros(2), motion.fresh, int(anew.sum()))
        mode = after
        x[:, :2] += dt * x[:, 2:]
        here = [np.interp((k + 1) * dt, times, along[:, axis]) for axis in range(2)]
        hit |= np.hypot(*(x[:, :2] - here - error).T) < radius
    return float(hit.mean())


def claimed(obstacle: Obstacle, plan: np.ndarray) -> float:
    risk = Risk(SURE, [obstacle], 9.0, GuardConfig(), DARWIN_OP, MotionPatterns())
    return float(risk.of(places_of(plan), np.zeros(3))[0])


def test_the_mass_of_a_disc_is_that_of_samples():
    rng = np.random.default_rng(0)
    for spread in (0.01, 0.05, 0.2) * 12:
        a = spread * rng.standard_normal((2, 2))
        P, mean, radius = a @ a.T + 1e-5 * np.eye(2), 0.25 * rng.standard_normal(2), 0.3
        samples = rng.multivariate_normal(mean, P, 100000)
        share = float(np.mean(np.hypot(*samples.T) < radius))
        assert disc_mass(*mean, P[0, 0], P[1, 1], P[0, 1], radius) == pytest.approx(share, abs=6e-3)


@pytest.mark.parametrize(
    ("place", "velocity"),
    [
        ((0.60, 0.00), (-0.06, 0.00)),  # towards the robot
        ((0.30, 0.35), (0.00, -0.08)),  # across its path
        ((0.40, 0.30), (-0.03, 0.00)),  # passing by
        ((0.00, 0.45), (0.05, 0.05)),  # leaving
    ],
)
def test_the_claimed_risk_is_the_share_of_simulated_contacts(place, velocity):
    obstacle = tracked(np.array(place), np.array(velocity))
    ahead = _desired_plans(WalkCommand(forward_m=0.04), DARWIN_OP.gait)[0]
    for plan in (ahead, np.zeros(8)):
        share, claim = contact_share(obstacle, plan), claimed(obstacle, plan)
        assert abs(claim - share) < 0.03 + 0.2 * share


def test_far_obstacles_static_ones_and_furniture_are_no_risk():
    far = tracked(np.array([4.0, 1.0]), np.array([-0.1, 0.0]))
    assert claimed(far, np.zeros(8)) < 1e-6
    static = watched(np.array([0.3, 0.0]), np.zeros(2))
    assert contact_share(static, np.zeros(8)) - 0.005 < claimed(static, np.zeros(8)) < 0.01
    furniture = replace(static, moving=0.1, radius_m=0.3)
    assert claimed(furniture, np.zeros(8)) == 0.0


def test_one_that_may_move_is_a_risk_by_the_chance_that_it_goes():
    place, velocity = np.array([0.30, 0.35]), np.array([0.0, -0.08])
    ahead = _desired_plans(WalkCommand(forward_m=0.04), DARWIN_OP.gait)[0]
    doubtful = replace(tracked(place, velocity), moving=0.25)
    share = contact_share(doubtful, ahead)
    assert share > 0.02
    assert abs(claimed(doubtful, ahead) - share) < 0.02 + 0.2 * share


def test_a_tighter_bound_never_brings_more_risk_and_what_exceeds_it_is_named():
    wish, target, kept = WalkCommand(forward_m=0.04), np.array([2.0, 0.0]), []
    for seed in range(48):
        rng = np.random.default_rng(seed)
        place, velocity = rng.uniform(-0.5, 0.5, 2), rng.uniform(-0.1, 0.1, 2)
        mover, risks = tracked(place, velocity, seed), []
        for bound in (1.0, 0.008, 0.0008):
            guard = Guard(GuardConfig(risk=bound))
            guard.choose(wish, SURE, [mover], NOTHING, target, 9.0)
            assert (guard.word == "least risk") == (guard.risk > bound)
            risks.append(guard.risk)
        assert risks[0] >= risks[1] - SAME_RISK >= risks[2] - 2 * SAME_RISK
        kept.append(risks[2] < risks[0] - 0.002)
    assert any(kept)


@pytest.mark.parametrize(("moving", "least_m"), [(0.1, 0.25), (0.5, 0.36)])
def test_one_that_may_go_at_any_time_is_passed_at_a_distance(moving, least_m):
    """It stands 0.3 m beside the way to the target; no plan exceeds the bound, and going round costs little."""
    stands = replace(watched(np.array([1.0, 0.3]), np.zeros(2)), moving=moving)
    guard, pose, last, gaps = Guard(GuardConfig()), Pose2(), WalkCommand(), []
    target = np.array([2.0, 0.0])
    for k in range(70):
        dx, dy = target[0] - pose.x, target[1] - pose.y
        wish = footstep(
            math.atan2(dy, dx), 0.07 if math.hypot(dx, dy) > 0.1 else 0.0, pose, DARWIN_OP.gait
        )
        now = 9.0 + STEP_S * k
        body = Gaussian(pose.vector, SURE.covariance)
        step = guard.choose(wish, body, [replace(stands, seen_s=now)], NOTHING, target, now)
        assert guard.risk <= guard.config.risk
        for walk in (last, step):
            pose = pose @ Pose2(walk.forward_m / 2, walk.lateral_m / 2, walk.turn_rad / 2)
        last = step
        gaps.append(math.hypot(pose.x - 1.0, pose.y - 0.3))
    assert min(gaps) - DARWIN_OP.radius_m - stands.radius_m > least_m
    assert math.hypot(pose.x - 2.0, pose.y) < 0.15


@pytest.mark.parametrize(("top_mps", "counts"), [(0.1, True), (2.0, False)])
def test_after_a_plan_the_risk_counts_until_the_robot_can_get_out_of_the_way(top_mps, counts):
    """Somebody comes, surely straight on, and is here 2 s after the plan's end."""
    gait = replace(GAIT, max_speed_mps=top_mps)
    arrives_s = (STEPS + 0.5) * STEP_S + 2.0
    state = Gaussian(np.array([0.3 + 0.1 * arrives_s, 0.0, -0.1, 0.0]), np.diag([1e-4] * 4))
    comes = Obstacle(state, 0.1, 0.4, 1, 1.0, 9.0)
    risk = Risk(SURE, [comes], 9.0, CONFIG, replace(DARWIN_OP, gait=gait), MotionPatterns())
    claim = float(risk.of(places_of(np.zeros(8)), np.zeros(3), to_the_end=True)[0])
    assert (claim > 0.2) == counts


def test_where_no_plan_keeps_the_bound_the_least_dangerous_is_walked_and_named():
    rng = np.random.default_rng(3)
    around = [
        tracked(0.33 * np.array([math.cos(a), math.sin(a)]), -0.08 * np.array([math.cos(a), math.sin(a)]), k)
        for k, a in enumerate(rng.uniform(0.0, 0.3) + np.arange(6) * math.pi / 3)
    ]  # fmt: skip
    guard = Guard(GuardConfig(risk=0.001))
    guard.choose(WalkCommand(forward_m=0.04), SURE, around, NOTHING, np.array([2.0, 0.0]), 9.0)
    assert guard.risk > 0.001
    assert guard.word == "least risk"


def test_a_bound_that_is_no_probability_is_refused():
    for wrong in (0.0, -0.1, 1.5, math.nan):
        with pytest.raises(ConfigError, match="risk"):
            GuardConfig(risk=wrong)


def test_the_walked_places_of_a_straight_plan_lie_on_a_line():
    plan = _desired_plans(WalkCommand(forward_m=0.04), DARWIN_OP.gait)[1]
    start = Pose2(1.0, 2.0, math.pi / 2).vector
    (poses,) = walked(start, plan[None], np.zeros(2), GAIT.max_turn_rad, 3)
    np.testing.assert_allclose(poses[:, 1], [2.02, 2.04, 2.04, 2.04, 2.04, 2.04], atol=1e-12)


@pytest.mark.parametrize("speed_mps", [0.06, 0.1])
@pytest.mark.parametrize("seed", range(6))
def test_no_plan_keeps_the_bound_by_walking_into_something_static(seed, speed_mps):
    rng = np.random.default_rng(seed)
    behind = -0.33 * np.array([1.0, rng.uniform(-0.4, 0.4)])
    lost = tracked(behind, np.array([speed_mps, 0.0]), seed)
    along = np.arange(-0.6, 0.6, 0.04)
    wall = np.column_stack([np.full(len(along), 0.24), along])
    guard = Guard(GuardConfig(risk=0.004))
    guard.choose(WalkCommand(forward_m=0.0), SURE, [lost], wall, np.array([0.1, 0.0]), 9.0)
    assert guard.risk > 0.004  # to keep the bound it would have to walk into the wall
    steps = guard.ahead[: round(RISK_S / STEP_S), :2]
    away = np.hypot(*(steps[:, None] - wall[None]).transpose(2, 0, 1)).min()
    assert away >= CELL_CONTACT_M - 1e-6
