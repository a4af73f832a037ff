"""Combinations of settings that are refused."""

from __future__ import annotations

from dataclasses import replace

import pytest

from perception.primitives.errors import ConfigError
from planning.univector.fields import FieldConfig
from surefoot.config.schema import Config


def test_prediction_by_flow_needs_two_pictures_per_step():
    config = Config()
    pairs = replace(config.robot, image_pairs=True)
    flow = replace(config.swarm, prediction="flow")
    with pytest.raises(ConfigError, match="image_pairs"):
        replace(config, swarm=flow)
    replace(config, swarm=flow, robot=pairs)
    with pytest.raises(ConfigError, match="image_pairs"):
        replace(config, swarm=replace(config.swarm, version="published"))


def test_the_swarm_planner_needs_a_colour_camera_and_does_not_explore():
    config = Config()
    mission = replace(config.mission, planner="swarm")
    with pytest.raises(ConfigError, match="set robot"):
        replace(config, mission=mission, robot=replace(config.robot, colour=False))
    with pytest.raises(ConfigError, match="leave wander off"):
        replace(mission, wander=True)


def test_the_published_motion_without_its_planner_is_refused():
    with pytest.raises(ConfigError, match=r"mission.planner='field'"):
        Config(univector=FieldConfig(mode="seed"))
