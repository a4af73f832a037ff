"""Walks over several levels by `simulate`: what is refused, and what a short one leaves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mapping.io import ground_file
from perception.primitives.errors import ConfigError, InputError
from planning.planners.factory import make
from planning.planners.mission import ON_LEVELS, MissionConfig
from sim.robot_config import RobotConfig
from sim.robots import catalogue as robots
from sim.robots import installed
from sim.scenes import catalogue
from surefoot.config.presets import fitted
from surefoot.config.schema import Config
from surefoot.results.run_folder import RunFolder
from surefoot.run import level_walk
from surefoot.run.simulate import simulate

there = pytest.mark.skipif(
    installed.folder(robots.load("g1").package) is None, reason=installed.EXTRA
)
G1 = RobotConfig(model="g1", colour=False, stereo=False, tof_source="rays")
STOREYS = catalogue.load("storeys", 3)


@there
def test_the_scene_chooses_the_planner_and_flat_ones_keep_theirs():
    config = Config(robot=G1, scene="storeys")
    assert level_walk.planned(config, STOREYS).mission.planner == ON_LEVELS
    flat = Config()
    assert level_walk.planned(flat, catalogue.load("boxes", 0)) is flat


@there
@pytest.mark.parametrize(
    ("mission", "match"),
    [
        (MissionConfig(planner="field"), "several levels"),
        (MissionConfig(wander=True), "wander"),
        (MissionConfig(headings_deg=(0.0,)), "headings"),
    ],
)
def test_what_does_not_go_with_it_is_refused(mission, match):
    with pytest.raises(ConfigError, match=match):
        level_walk.planned(Config(robot=G1, mission=mission), STOREYS)


def test_legs_that_are_too_short_are_refused_with_the_height_of_the_steps():
    with pytest.raises(ConfigError, match=r"5 cm .*risers of \d cm; choose --robot g1"):
        level_walk.planned(Config(), STOREYS)


def test_a_body_that_falls_and_a_planner_of_world_models_are_refused():
    with pytest.raises(ConfigError, match="dynamic"):
        level_walk.planned(Config(robot=RobotConfig(body="dynamic")), STOREYS)
    planning = replace(Config().planning, mission=MissionConfig(planner=ON_LEVELS))
    with pytest.raises(InputError, match="simulate"):
        make(planning, [(1.0, 0.0)])


@there
def test_it_is_not_recorded(tmp_path):
    with pytest.raises(InputError, match="--record"):
        simulate(
            fitted(Config(scene="storeys", robot=G1)), tmp_path / "run", True, lambda line: None
        )


@there
def test_a_short_walk_leaves_poses_heights_and_the_ground_near_the_truth(tmp_path):
    mission = MissionConfig(time_limit_s=6.0)
    config = fitted(Config(scene="storeys", seed=3, robot=G1, mission=mission))
    summary = simulate(config, tmp_path / "run", False, lambda line: None, report=False)
    assert summary.reached == (0, 1)
    run = RunFolder.open(summary.folder)
    true, found = run.read_trajectory("truth/trajectory.txt"), run.read_trajectory("trajectory.txt")
    away = found.positions - true.positions
    assert np.abs(away[:, 2]).max() < 0.005
    assert np.linalg.norm(away[:, :2], axis=1).max() < 0.1
    table = run.read_csv("heights.csv")
    assert (table.numbers("sigma_m") >= 0.0).all()
    surfaces, _ = ground_file.load(run.path("ground.json"))
    ahead = [s for s in surfaces if s.contains(np.array([0.2, 0.0]))]
    assert ahead
    assert abs(float(ahead[0].height_at(np.array([0.2, 0.0]))[0])) < 0.01
    assert 'planner = "footholds"' in (summary.folder / "config.toml").read_text()
