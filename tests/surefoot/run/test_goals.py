"""Goals: worked off by the estimated pose, and with a heading where one is asked for."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from perception.estimate import Estimate
from perception.primitives.errors import ConfigError
from perception.primitives.gaussian import Gaussian
from planning.planners.goals import Goals
from planning.planners.mission import MissionConfig
from planning.world_model import WorldModel
from surefoot.experiments.support.course_runner import course_config, walk

ROOM = """
extent = [0, 0, 5, 4]
start = [0.8, 2.0, 0]
goals = [[3.0, 2.0]]
[[cylinder]]
name = "post"
at = [2.0, 2.1]
radius = 0.1
height = 0.5
"""


def at(x: float, y: float, yaw_deg: float) -> WorldModel:
    pose = Gaussian(np.array([x, y, math.radians(yaw_deg)]), 1e-6 * np.eye(3))
    return WorldModel(Estimate(1.0, pose))


def test_without_a_heading_the_position_is_enough() -> None:
    goals = Goals([(1.0, 0.0), (2.0, 0.0)], MissionConfig(), [math.nan])
    assert goals.heading is None
    assert not goals.finished(at(1.05, 0.0, 123.0))
    assert goals.reached == 1
    assert goals.finished(at(2.05, 0.0, -50.0))


def test_a_goal_with_a_heading_lasts_until_the_robot_has_it() -> None:
    goals = Goals([(1.0, 0.0)], MissionConfig(), [90.0])
    assert goals.heading == pytest.approx(math.pi / 2)
    assert not goals.finished(at(1.05, 0.0, 10.0))
    assert goals.turning
    assert not goals.finished(at(1.15, 0.0, 80.0)), (
        "turning has moved it a little: only the heading counts"
    )
    assert goals.finished(at(1.15, 0.0, 86.0))
    assert not goals.turning


def test_a_robot_that_drifts_off_while_turning_must_return() -> None:
    goals = Goals([(1.0, 0.0)], MissionConfig(), [90.0])
    assert not goals.finished(at(1.05, 0.0, 10.0))
    assert not goals.finished(at(1.30, 0.0, 90.0))
    assert not goals.turning
    assert goals.finished(at(1.05, 0.0, 88.0))


def test_no_goal_is_reached_without_a_pose() -> None:
    goals = Goals([(1.0, 0.0)], MissionConfig())
    assert not goals.finished(WorldModel(Estimate(1.0, None)))
    assert goals.reached == 0


@pytest.mark.parametrize("heading_deg", [60.0, -90.0, 180.0])
def test_a_walk_ends_at_its_goal_with_the_heading_asked_for(
    tmp_path: Path, heading_deg: float
) -> None:
    """By the truth, past a post; position error of the courses 8 mm an axis, .35 deg, a step turns 14 deg."""
    scene = tmp_path / "room.toml"
    scene.write_text(ROOM)
    config = course_config(str(scene), 0)
    mission = replace(
        config.mission, goals=1, tolerance_m=0.1, headings_deg=(heading_deg,), time_limit_s=120.0
    )
    found = walk(replace(config, mission=mission))
    assert found.arrived
    assert found.contacts == []
    _, x, y, yaw = found.trace[-1]
    off = math.degrees(abs(math.remainder(yaw - math.radians(heading_deg), 2 * math.pi)))
    assert off <= 5.0 + 14.0 / 2 + 1.0  # the last decision is half a step before the end
    assert math.hypot(x - 3.0, y - 2.0) <= 0.2


def test_planners_that_cannot_arrive_with_a_heading_say_so() -> None:
    with pytest.raises(ConfigError, match="leave headings_deg empty, or choose search or field"):
        MissionConfig(planner="swarm", headings_deg=(90.0,))
    with pytest.raises(ConfigError, match="nan stands for any heading"):
        MissionConfig(headings_deg=(math.inf,))
