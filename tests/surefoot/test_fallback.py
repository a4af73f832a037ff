"""Without depth the robot walks on by colour, safely; with depth nobody interferes."""

from __future__ import annotations

import logging
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from perception.depth.health import DepthTrust, DepthTrustConfig
from perception.estimate import Estimate
from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError
from perception.primitives.frame import Depth, Frame
from perception.primitives.gaussian import Gaussian
from perception.primitives.plane import Plane
from planning.commands import GazeCommand, WalkCommand
from planning.planners.mission import MissionConfig
from surefoot.config.schema import Config
from surefoot.evaluation.evaluate import evaluate
from surefoot.fallback import BY_COLOUR, Fallback
from surefoot.navigator import Navigator
from surefoot.planners import Decision, make
from surefoot.recordings.recording import RecordingInfo
from surefoot.results.run_folder import RunFolder
from surefoot.run import simulate
from surefoot.run.pipeline import Pipeline

CAMERA = Camera.from_view(80, 60, math.radians(60.0), math.radians(46.0))
BOWED = Plane(np.array([0.0, -math.cos(0.5), -math.sin(0.5)]), 0.38)
RAISED = Plane(np.array([0.0, -math.cos(0.7), math.sin(0.7)]), 0.38)


def seen(share: float, floor: Plane = BOWED) -> list[tuple[Depth, Plane]]:
    """One image, so much of whose columns answer."""
    z = np.full((60, 80), np.nan, np.float32)
    z[:, : round(80 * share)] = 1.0
    return [(Depth(z, z, CAMERA), floor)]


def verdicts(*shares: float) -> list[bool]:
    trust = DepthTrust(DepthTrustConfig(footsteps=3))
    return [trust.update(seen(share)) for share in shares]


def test_trust_goes_after_three_bare_answers_in_a_row_and_comes_back_after_three_good_ones():
    assert verdicts(0.0, 0.0, 0.9, 0.0, 0.0, 0.0) == [True] * 5 + [False]
    assert verdicts(0.0, 0.0, 0.0, 0.9, 0.0, 0.9, 0.9, 0.9)[2:] == [False] * 5 + [True]


def test_between_the_thresholds_nothing_changes():
    assert all(verdicts(*[0.2] * 10))
    assert not any(verdicts(0.0, 0.0, 0.0, *[0.2] * 10)[2:])


def test_a_camera_that_looks_elsewhere_has_no_say_and_a_silent_one_has():
    trust = DepthTrust(DepthTrustConfig(footsteps=2))
    assert all(trust.update(seen(0.0, RAISED)) for _ in range(5))
    assert [trust.update([]) for _ in range(2)] == [True, False]


def test_one_good_camera_is_enough():
    trust = DepthTrust(DepthTrustConfig(footsteps=1))
    assert trust.update(seen(0.0) + seen(0.9))


def test_thresholds_the_wrong_way_round_are_refused():
    with pytest.raises(ConfigError, match="lost_share"):
        DepthTrustConfig(lost_share=0.5, found_share=0.2)


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({}, True),
        ({"colour": False}, False),
        ({"planner": "field"}, True),
        ({"planner": "avoidance"}, False),
        ({"wander": True}, False),
        ({"fall_back": False}, False),
    ],
)
def test_who_has_a_colour_camera_and_goals_falls_back(change, expected):
    config = Config()
    mission = {key: change[key] for key in ("planner", "wander") if key in change}
    config = replace(
        config,
        mission=MissionConfig(**mission),
        robot=replace(config.robot, colour=change.get("colour", True)),
        depth_trust=DepthTrustConfig(fall_back=change.get("fall_back", True)),
    )
    assert isinstance(make(config, ((1.0, 0.0),)), Fallback) is expected


class Standing:
    """Asks for nothing, and can be told apart."""

    reached = 0

    def notice(self, frame: Frame, estimate: Estimate, pipeline: Pipeline) -> None:
        """Nothing."""

    def decide(self, frame: Frame, estimate: Estimate, pipeline: Pipeline) -> Decision:
        return Decision(WalkCommand(), GazeCommand(), "by depth")

    def distance_to_goal(self, estimate: Estimate) -> float:
        return 1.0

    def finished(self, estimate: Estimate) -> bool:
        return False


def test_when_depth_is_back_it_decides_again_and_both_changes_are_said(caplog, monkeypatch):
    config = replace(Config(), depth_trust=DepthTrustConfig(footsteps=1))
    planner = Fallback(Standing(), config, ((1.0, 0.0),))
    pipeline = Pipeline(config, RecordingInfo("none", "simulation"))
    estimate = Estimate(0.0, Gaussian(np.zeros(3), np.eye(3)), (), (), (), None)
    answers = iter([0.9, 0.0, 0.0, 0.9])
    monkeypatch.setattr(planner.trust, "best_share", lambda views: next(answers))
    with caplog.at_level(logging.WARNING):
        why = [planner.decide(Frame(0.0), estimate, pipeline).why for _ in range(4)]
    assert [word.startswith(BY_COLOUR) for word in why] == [False, True, True, False]
    assert [word == "by depth" for word in why] == [True, False, False, True]
    assert ["walking by colour" in line for line in caplog.messages] == [True, False]
    assert len(caplog.messages) == 2


def walked(folder: Path, fall_back: bool, limit_s: float) -> dict[str, float]:
    """2.4 m to a goal beyond a box, in a room without texture, by stereo and colour; so long."""
    config = Config(scene="plain_room")
    config = replace(
        config,
        robot=replace(config.robot, tof=False),
        mission=MissionConfig(time_limit_s=limit_s),
        depth_trust=DepthTrustConfig(fall_back=fall_back),
    )
    simulate.simulate(config, folder, False, lambda text: None)
    run = RunFolder.open(folder)
    way = run.read_trajectory("truth/trajectory.txt")
    assert way is not None
    left = np.hypot(*(way.positions[-1, :2] - np.array([3.0, 1.5])))
    return {**evaluate(run), "left_m": float(left)}


def test_in_a_room_without_texture_the_robot_walks_on_by_colour_and_touches_nothing(tmp_path):
    by_colour = walked(tmp_path / "run", True, 18.0)
    assert by_colour["contacts"] == 0
    assert by_colour["left_m"] < 2.0


def test_without_the_fall_back_it_gets_nowhere(tmp_path):
    assert walked(tmp_path / "run", False, 9.0)["left_m"] > 2.3


def test_the_planner_by_depth_is_what_was_asked_for():
    config = replace(
        Config(),
        depth_trust=DepthTrustConfig(fall_back=False),
        mission=MissionConfig(look_about=False),
    )
    assert isinstance(make(config, ((1.0, 0.0),)), Navigator)
