"""The three gaze policies behind one interface, and the limits of the head."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from mapping.grid.confidence import ConfidenceLayer
from mapping.grid.egocentric_grid import EgocentricGrid, GridConfig
from perception.primitives import plugins
from perception.primitives.errors import ConfigError, InputError
from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import Obstacle
from perception.primitives.pose import Pose2
from perception.primitives.robot_model import DARWIN_OP, HeadLimits, RobotModel
from planning.commands import GazeCommand
from planning.gaze.attention import GazeContext
from planning.gaze.policy import EvaluationGaze, GazeConfig, GazeControl
from planning.gaze.selection import in_view
from planning.gaze.sweep import Sweep

STEP_S = 0.65
VIA = np.array([2.0, 0.0])
CONFIG = GazeConfig()
POSE = Gaussian(np.zeros(3), np.eye(3) * 1e-6)
FLOOR = replace(CONFIG.map, across_deg=44.0)


def mover(x, y, seen_s):
    state = Gaussian(np.array([x, y, 0.0, -0.05]), np.eye(4) * 1e-4)
    return Obstacle(state, 0.1, 0.4, 7, 1.0, seen_s, seen_s - 9.0)


class Standing:
    """A standing robot whose map becomes stale where it does not look."""

    def __init__(self, config=CONFIG, robot=DARWIN_OP):
        self.policy = GazeControl(config, robot)
        self.grid = EgocentricGrid(GridConfig(), np.zeros(2))
        self.confidence = ConfidenceLayer(self.grid)
        self.now = 0.0

    def look(self, obstacles=()):
        known = GazeContext(POSE, self.grid, self.confidence)
        gaze = self.policy.next(self.now, Pose2(), VIA, obstacles, known)
        self.now += STEP_S
        self.confidence.decay(STEP_S)
        places = self.grid.centres().reshape(-1, 2)
        seen = in_view(np.column_stack([places, np.full(len(places), -0.38)]), gaze, FLOOR)
        self.confidence.see(seen.reshape(self.grid.config.cells, -1))
        return gaze

    def surveyed(self):
        while self.policy.surveying:
            self.look()
        return self


def test_the_path_is_looked_at_every_three_seconds():
    standing = Standing().surveyed()
    way, seen = np.array([[1.0, 0.0, -0.38]]), standing.now
    for _ in range(50):
        gaze = standing.look([mover(0.2, 1.0, standing.now - 3.0)])
        if in_view(way, gaze, FLOOR)[0]:
            seen = standing.now
        assert standing.now - seen <= 3.0


def test_the_ground_within_the_range_of_the_neck_stays_fresh():
    standing, stale = Standing().surveyed(), []
    for _ in range(40):
        standing.look()
        places = standing.grid.centres().reshape(-1, 2)
        away = np.hypot(*places.T)
        region = (away > 0.4) & (away < 1.3) & (places[:, 0] > 0.0)
        stale.append(np.mean(standing.confidence.stale.ravel()[region]))
    fixed = Standing(replace(CONFIG, mode="fixed"))
    for _ in range(20):
        fixed.look()
    left = np.mean(fixed.confidence.stale.ravel()[region])
    assert np.mean(stale[10:]) < 0.2 * left


def test_an_obstacle_out_of_sight_is_looked_for_within_three_gazes():
    standing = Standing().surveyed()
    lost, place = mover(0.5, 0.9, standing.now - 1.5), np.array([[0.5, 0.9, -0.38]])
    gazes = [standing.look([lost]) for _ in range(3)]
    assert any(in_view(place, gaze, FLOOR)[0] for gaze in gazes)


def test_the_sweep_policy_is_the_sweep_and_the_fixed_policy_never_turns():
    sweep, policy = Sweep(), GazeControl(replace(CONFIG, mode="sweep"))
    for k in range(20):
        others = [mover(0.6, -0.8, 0.0)]
        assert policy.next(k * STEP_S, Pose2(), VIA, others) == sweep.next(
            k * STEP_S, Pose2(), VIA, others
        )
    fixed = GazeControl(replace(CONFIG, mode="fixed"))
    assert not fixed.surveying
    gazes = {fixed.next(k * STEP_S, Pose2(), VIA, []) for k in range(9)}
    assert len(gazes) == 1
    assert gazes.pop().pan_rad == 0.0


def test_without_a_context_the_sweep_decides():
    policy, sweep = GazeControl(CONFIG), Sweep()
    for k in range(15):
        assert policy.next(k * STEP_S, Pose2(), VIA, []) == sweep.next(k * STEP_S, Pose2(), VIA, [])
        assert isinstance(policy.policy, EvaluationGaze)
        assert policy.policy.attention is None


def test_the_survey_comes_first_and_again_on_request():
    standing = Standing()
    pans = []
    while standing.policy.surveying:
        pans.append(standing.look().pan_rad)
    assert max(pans) >= math.radians(80)
    assert min(pans) <= math.radians(-80)
    standing.policy.survey()
    assert standing.policy.surveying


def test_a_slow_head_keeps_on_turning_to_what_it_does_not_reach_in_time():
    """An overdue obstacle at the other end of the neck, out of reach within one step and within two."""
    standing = Standing(robot=RobotModel(head=HeadLimits(speed_radps=0.8))).surveyed()
    for _ in range(4):
        standing.look([mover(0.3, -1.0, standing.now)])
    lost, place = mover(0.1, 1.0, standing.now - 5.0), np.array([[0.1, 1.0, -0.38]])
    shown = []
    for _ in range(8):
        standing.look([lost])
        shown.append(bool(in_view(place, standing.policy.policy._present, FLOOR)[0]))
    assert not shown[0]
    assert any(shown)


def test_of_two_equally_overdue_obstacles_the_head_turns_to_the_one_that_it_reaches_sooner():
    standing = Standing(robot=RobotModel(head=HeadLimits(speed_radps=0.8))).surveyed()
    present = standing.policy.policy._present.pan_rad
    side = -1.0 if present > 0.0 else 1.0
    bearings = present + side * 0.6, present + side * 1.8
    soon, late = (mover(math.cos(b), math.sin(b), standing.now - 5.0) for b in bearings)
    gaze = standing.look([soon, replace(late, track=8)])
    assert abs(gaze.pan_rad - bearings[0]) < 0.4


def test_an_unknown_mode_is_refused():
    with pytest.raises(ConfigError, match="evaluations, seed, sweep, fixed"):
        GazeConfig(mode="stare")


class Ceiling:
    """A policy of a user's own, with nothing but the one method."""

    def __init__(self, config, robot):
        self.gaze = GazeCommand(0.1, 0.2)

    def next(self, stamp_s, robot, via, obstacles, known=None):
        return self.gaze


def test_a_policy_of_ones_own_needs_one_method():
    policy = GazeControl(replace(CONFIG, mode=plugins.reference(Ceiling)))
    assert not policy.surveying
    policy.survey()
    assert policy.next(0.0, Pose2(), VIA, []) == GazeCommand(0.1, 0.2)


def test_a_policy_that_returns_no_gaze_is_named():
    policy = GazeControl(replace(CONFIG, mode=plugins.reference(Ceiling)))
    policy.policy.gaze = (0.1, 0.2)
    with pytest.raises(InputError, match=r"Ceiling.*tuple.*GazeCommand"):
        policy.next(0.0, Pose2(), VIA, [])


def test_a_policy_that_returns_no_finite_gaze_is_named():
    policy = GazeControl(replace(CONFIG, mode=plugins.reference(Ceiling)))
    policy.policy.gaze = GazeCommand(math.nan, 0.2)
    with pytest.raises(InputError, match=r"Ceiling.*pan_rad=nan"):
        policy.next(0.0, Pose2(), VIA, [])


def test_a_policy_with_other_arguments_is_named():
    class Short(Ceiling):
        def next(self, stamp_s):
            return self.gaze

    class Bare(Ceiling):
        def __init__(self):
            pass

    policy = GazeControl(replace(CONFIG, mode=plugins.reference(Short)))
    with pytest.raises(InputError, match=r"gaze policy .*Short.* takes 2 positional"):
        policy.next(0.0, Pose2(), VIA, [])
    with pytest.raises(InputError, match=r"gaze policy .*Bare.* takes 1 positional"):
        GazeControl(replace(CONFIG, mode=plugins.reference(Bare)))


def test_a_policy_without_the_method_is_refused():
    with pytest.raises(InputError, match=r"Standing.*lacks next"):
        GazeControl(replace(CONFIG, mode=plugins.reference(Standing)))
