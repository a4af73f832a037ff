"""Combinations of settings that are refused."""

from __future__ import annotations

from dataclasses import replace

import pytest

from perception.primitives.errors import ConfigError
from perception.primitives.settings import note_of
from planning.univector.fields import FieldConfig
from surefoot.config import toml
from surefoot.config.load import load
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


def test_only_settings_whose_sign_has_a_meaning_take_negative_numbers():
    taken = set()
    for name, item, value in toml.leaves(Config()):
        one = value[0] if isinstance(value, tuple) and value else value
        if note_of(item) is None or type(one) not in (int, float):
            continue
        negative = [-1] * len(value) if isinstance(value, tuple) else -1
        try:
            load(None, [f"{name}={negative}"])
        except ConfigError:
            continue
        taken.add(name)
    assert taken == {"localiser.slip_m", "grid.evidence.floor", "stereo.vergence_deg"}


@pytest.mark.parametrize("pair", ["search.p_solid=0", "cloud.voxel_m=1e-6", "surface.voxel_m=1e-6"])
def test_a_setting_with_which_nothing_works_is_refused(pair):
    with pytest.raises(ConfigError, match=pair.partition(".")[2].replace("1e-6", "1e-06")):
        load(None, [pair])
