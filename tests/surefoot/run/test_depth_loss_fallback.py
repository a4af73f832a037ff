"""Depth health, and walking by colour while depth is lost."""

from __future__ import annotations

import logging
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from perception.depth.health import DepthHealth, DepthHealthConfig
from perception.estimate import Estimate
from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError
from perception.primitives.frame import Depth
from perception.primitives.gaussian import Gaussian
from perception.primitives.plane import Plane
from planning.commands import GazeCommand, WalkCommand
from planning.planners.depth_loss_fallback import BY_COLOUR, STANDS, DepthLossFallback
from planning.planners.mission import MissionConfig
from planning.planners.planner import Decision
from planning.planners.settings import PlanningConfig
from planning.world_model import WorldModel
from surefoot.config.schema import Config
from surefoot.evaluation.evaluate import evaluate
from surefoot.results.run_folder import RunFolder
from surefoot.run import simulate
from surefoot.run.simulate import make_planner

CAMERA = Camera.from_view(80, 60, math.radians(60.0), math.radians(46.0))
BOWED = Plane(np.array([0.0, -math.cos(0.5), -math.sin(0.5)]), 0.38)
RAISED = Plane(np.array([0.0, -math.cos(0.7), math.sin(0.7)]), 0.38)


def seen(share: float, floor: Plane = BOWED) -> list[tuple[Depth, Plane, float]]:
    """One image, so much of whose columns answer."""
    z = np.full((60, 80), np.nan, np.float32)
    z[:, : round(80 * share)] = 1.0
    return [(Depth(z, z, CAMERA), floor, 3.0)]


def healthy_after(*shares: float) -> list[bool]:
    health = DepthHealth(DepthHealthConfig(footsteps=3))
    return [health.update(seen(share)) for share in shares]


def test_depth_is_lost_after_three_low_shares_in_a_row_and_back_after_three_high_ones():
    assert healthy_after(0.0, 0.0, 0.9, 0.0, 0.0, 0.0) == [True] * 5 + [False]
    assert healthy_after(0.0, 0.0, 0.0, 0.9, 0.0, 0.9, 0.9, 0.9)[2:] == [False] * 5 + [True]


def test_between_the_thresholds_nothing_changes():
    assert all(healthy_after(*[0.2] * 10))
    assert not any(healthy_after(0.0, 0.0, 0.0, *[0.2] * 10)[2:])


def test_a_camera_that_looks_elsewhere_does_not_count_and_a_missing_image_does():
    health = DepthHealth(DepthHealthConfig(footsteps=2))
    assert all(health.update(seen(0.0, RAISED)) for _ in range(5))
    assert [health.update([]) for _ in range(2)] == [True, False]


@pytest.mark.parametrize("height_m", [0.38, 1.0, 1.55])
def test_depth_is_lost_and_found_again_at_the_height_of_any_robot(height_m):
    """The head is bowed by 29 deg, as while walking by colour: a tall robot sees no floor nearer than 1.6 m."""
    floor = replace(BOWED, offset_m=height_m)
    health = DepthHealth(DepthHealthConfig(footsteps=2))
    assert [health.update(seen(share, floor)) for share in (0.0, 0.0)] == [True, False]
    assert [health.update(seen(share, floor)) for share in (0.9, 0.9)] == [False, True]


def test_floor_beyond_the_reach_of_the_sensor_is_not_missed():
    ((depth, floor, _),) = seen(0.0, replace(BOWED, offset_m=1.55))
    health = DepthHealth(DepthHealthConfig(footsteps=1))
    assert health.update([(depth, floor, 1.5)])


def test_one_good_camera_is_enough():
    health = DepthHealth(DepthHealthConfig(footsteps=1))
    assert health.update(seen(0.0) + seen(0.9))


def test_thresholds_the_wrong_way_round_are_refused():
    with pytest.raises(ConfigError, match="lost_share"):
        DepthHealthConfig(lost_share=0.5, found_share=0.2)


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({}, BY_COLOUR),
        ({"colour": False}, STANDS),
        ({"planner": "field"}, BY_COLOUR),
        ({"planner": "avoidance"}, None),
        ({"wander": True}, None),
        ({"fall_back": False}, STANDS),
    ],
)
def test_without_depth_the_robot_walks_by_a_colour_camera_or_stands(change, expected):
    config = Config()
    mission = {key: change[key] for key in ("planner", "wander") if key in change}
    config = replace(
        config,
        mission=MissionConfig(**mission),
        robot=replace(config.robot, colour=change.get("colour", True)),
        depth_health=DepthHealthConfig(fall_back=change.get("fall_back", True)),
    )
    planner = make_planner(config, ((1.0, 0.0),))
    assert isinstance(planner, DepthLossFallback) is (expected is not None)
    if expected is not None:
        pose = Gaussian(np.zeros(3), np.eye(3))
        decided = planner.decide(WorldModel(Estimate(0.0, pose, depth_healthy=False)))
        assert decided.why.startswith(expected)
        assert expected != STANDS or decided.walk == WalkCommand()


class AlwaysStanding:
    """Asks for no step, and is recognised by its word."""

    reached = 0

    def observe(self, world: WorldModel) -> None:
        """Nothing."""

    def decide(self, world: WorldModel) -> Decision:
        return Decision(WalkCommand(), GazeCommand(), "by depth")

    def distance_to_goal(self, world: WorldModel) -> float:
        return 1.0

    def finished(self, world: WorldModel) -> bool:
        return False


def test_when_depth_is_back_the_first_planner_decides_again_and_both_changes_are_logged(caplog):
    planner = DepthLossFallback(AlwaysStanding(), PlanningConfig(), ((1.0, 0.0),))
    pose = Gaussian(np.zeros(3), np.eye(3))
    with caplog.at_level(logging.WARNING):
        why = [
            planner.decide(WorldModel(Estimate(0.0, pose, depth_healthy=healthy))).why
            for healthy in (True, False, False, True)
        ]
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
        depth_health=DepthHealthConfig(fall_back=fall_back),
    )
    simulate.simulate(config, folder, fall_back, lambda text: None)
    run = RunFolder.open(folder)
    way = run.read_trajectory("truth/trajectory.txt")
    assert way is not None
    left = np.hypot(*(way.positions[-1, :2] - np.array([3.0, 1.5])))
    return {**evaluate(run), "left_m": float(left)}


def test_in_a_room_without_texture_the_robot_walks_on_by_colour_and_touches_nothing(
    tmp_path, assert_same_offline
):
    by_colour = walked(tmp_path / "run", True, 18.0)
    assert by_colour["contacts"] == 0
    assert by_colour["left_m"] < 2.0
    why = RunFolder.open(tmp_path / "run").read_csv("commands.csv").words("why")
    assert any(word.startswith(BY_COLOUR) for word in why)
    assert_same_offline(tmp_path / "run")


def test_without_the_fallback_the_robot_stands_where_it_sees_no_floor(tmp_path):
    found = walked(tmp_path / "run", False, 9.0)
    assert found["left_m"] > 2.3
    why = RunFolder.open(tmp_path / "run").read_csv("commands.csv").words("why")
    assert why[-1] == STANDS
