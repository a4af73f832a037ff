"""Walks over several levels by `simulate`: what is refused, and what a short one leaves."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

from mapping.ground.levels import Levels
from mapping.ground.obstacles import ObstacleMap
from mapping.io import ground_file
from perception.estimate import Estimate
from perception.monitoring.status import SLOW, STAND, Doubt
from perception.primitives.errors import ConfigError
from perception.primitives.pose import Pose2, Pose3, head_rotation
from planning.commands import GazeCommand, WalkCommand
from planning.planners.caution import PAUSE, Caution
from planning.planners.mission import ON_LEVELS, MissionConfig
from planning.planners.planner import Decision
from planning.world_model import WorldModel
from sim.faults.injection import FaultConfig
from sim.robot_config import RobotConfig
from sim.robots import catalogue as catalogue_of_robots
from sim.scenes import catalogue
from surefoot.config.load import load
from surefoot.config.presets import fitted
from surefoot.config.schema import Config
from surefoot.mcap_file import messages
from surefoot.recordings.open import open_recording
from surefoot.results.moment_drawings import SURFACES
from surefoot.results.moments import ESTIMATES, read_moments
from surefoot.results.run_folder import RunFolder
from surefoot.run import checkpoint, level_walk, process
from surefoot.run.level_pipeline import LevelPipeline
from surefoot.run.simulate import simulate

CLIMBER = Path(__file__).parents[2] / "little_robot" / "climber.toml"
"""The humanoid of boxes with a depth camera and legs that step up."""
ROBOT = RobotConfig(model=str(CLIMBER), colour=False, stereo=False, tof_source="rays")
STOREYS = catalogue.load("storeys", 3)


def test_the_scene_chooses_the_planner_and_flat_ones_keep_theirs():
    config = Config(robot=ROBOT, scene="storeys")
    assert level_walk.planned(config, STOREYS).mission.planner == ON_LEVELS
    flat = Config()
    assert level_walk.planned(flat, catalogue.load("boxes", 0)) is flat


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
        level_walk.planned(Config(robot=ROBOT, mission=mission), STOREYS)


def test_legs_that_are_too_short_are_refused_with_the_height_of_the_steps():
    with pytest.raises(ConfigError, match=r"5 cm .*risers of \d cm; choose --robot g1"):
        level_walk.planned(Config(), STOREYS)


def test_a_body_that_falls_is_refused():
    with pytest.raises(ConfigError, match="dynamic"):
        level_walk.planned(Config(robot=RobotConfig(body="dynamic")), STOREYS)


@pytest.fixture(scope="module")
def walked(tmp_path_factory):
    """The folder of a short recorded walk: the robot looks about for five seconds, then it makes some steps."""
    mission = MissionConfig(time_limit_s=9.5)
    config = fitted(Config(scene="storeys", seed=3, robot=ROBOT, mission=mission))
    out = tmp_path_factory.mktemp("levels") / "run"
    summary = simulate(config, out, True, lambda line: None, report=False)
    assert summary.reached == (0, 1)
    return RunFolder.open(summary.folder)


def test_a_short_walk_leaves_poses_heights_and_the_ground_near_the_truth(walked):
    true, found = (walked.read_trajectory(f"{place}trajectory.txt") for place in ("truth/", ""))
    away = found.positions - true.positions
    assert np.abs(away[:, 2]).max() < 0.005
    assert np.linalg.norm(away[:, :2], axis=1).max() < 0.1
    table = walked.read_csv("heights.csv")
    assert (table.numbers("sigma_m") >= 0.0).all()
    surfaces, _ = ground_file.load(walked.path("ground.json"))
    ahead = [s for s in surfaces if s.contains(np.array([0.2, 0.0]))]
    assert ahead
    assert abs(float(ahead[0].height_at(np.array([0.2, 0.0]))[0])) < 0.01
    assert 'planner = "footholds"' in walked.path("config.toml").read_text()


def test_viewers_get_the_surfaces_at_their_heights(walked):
    topics = {topic for topic, _ in messages(walked.path(ESTIMATES))}
    assert SURFACES in topics
    seen = [one for one in read_moments(walked) if one.surfaces]
    assert seen
    lowest = min(float(one.corners[:, 2].min()) for one in seen[-1].surfaces)
    assert abs(lowest) < 0.01  # the floor on which the walk began
    assert all(one.heights_m is not None for one in read_moments(walked))


def test_its_recording_gives_the_same_poses_heights_and_ground_also_after_an_interruption(
    walked, assert_same_offline, assert_same, tmp_path, monkeypatch
):
    assert_same_offline(walked.root)
    config = load(walked.path("config.toml"))
    whole, resumed = (tmp_path / name for name in ("whole", "resumed"))
    process.process(walked.root, None, config, whole, lambda line: None)
    told = []

    def interrupt(line):
        told.append(line)
        if len(told) == 6:
            raise KeyboardInterrupt

    monkeypatch.setattr(checkpoint, "EVERY_S", 0.0)
    with pytest.raises(KeyboardInterrupt):
        process.process(walked.root, None, config, resumed, interrupt)
    process.process(walked.root, None, config, resumed, lambda line: None, resume=True)
    assert_same(whole, resumed)


def test_the_robot_stands_with_its_feet_where_they_are_while_it_has_no_pictures():
    stand = Doubt("no pictures", STAND)
    voxels = ObstacleMap().voxels
    levels = Levels((), voxels, 1, 0, Pose2(), 0.0, (0.0, 0.0), np.full(3, 0.01))
    world = WorldModel(Estimate(0.0, None, status=(stand,)), levels=levels)
    step = Decision(WalkCommand(0.2, rise_m=0.1), GazeCommand(0.1, 0.2), "up")
    cautious = Caution(catalogue_of_robots.read(CLIMBER).model).apply(step, world)
    assert cautious.walk.stay
    assert cautious.gaze == step.gaze
    slow = replace(world, estimate=Estimate(0.0, None, status=(Doubt("frozen", SLOW),)))
    caution = Caution(catalogue_of_robots.read(CLIMBER).model)
    stays = [caution.apply(step, slow).walk.stay for _ in range(2 * (PAUSE + 1))]
    assert stays == 2 * ([True] * PAUSE + [False])


def run_without(walked, lost):
    """What the pipeline makes of the frames that are left, beside what it makes of all: pairs of world models."""
    config, recording = load(walked.path("config.toml")), open_recording(walked.root)
    frames = list(recording.frames())
    whole, broken = (LevelPipeline(config, recording.info) for _ in range(2))
    known = {frame.stamp_s: whole.cycle(frame) for frame in frames}
    gone = [k for k, frame in enumerate(frames) if lost(k, frame)]
    left = [frame for k, frame in enumerate(frames) if k not in gone]
    assert len(gone) >= 2
    return [(broken.cycle(frame), known[frame.stamp_s]) for frame in left]


def test_frames_lost_on_the_way_of_a_foot_are_bridged_by_the_other(walked):
    for world, true in run_without(walked, lambda k, frame: not frame.footstep_due and k % 4 == 0):
        assert np.hypot(*(world.pose.mean - true.pose.mean)[:2]) < 0.02
        assert world.levels.landings == true.levels.landings
        assert world.levels.foot == true.levels.foot


def test_a_landing_that_nobody_saw_makes_ground_and_height_uncertain(walked):
    pairs = run_without(walked, lambda k, frame: frame.footstep_due and k in (15, 19))
    assert pairs[-1][0].levels.foot == pairs[-1][1].levels.foot
    assert pairs[-1][0].levels.landings == pairs[-1][1].levels.landings
    world, true = pairs[-1]
    height_m, sigma_m = world.levels.body_m
    assert sigma_m > 10.0 * true.levels.body_m[1]  # a step may have been on the way
    assert abs(height_m - true.levels.body_m[0]) < 3.0 * sigma_m
    off = world.pose.mean - true.pose.mean
    assert off @ np.linalg.solve(world.pose.covariance, off) < chi2.ppf(0.999, 3)


def test_a_camera_that_points_elsewhere_than_the_joints_say_is_noticed(walked):
    config, recording = load(walked.path("config.toml")), open_recording(walked.root)
    said = {}
    for off_rad in (0.0, 0.07):
        pipeline, said[off_rad] = LevelPipeline(config, recording.info), set()
        down = Pose3.from_rotation(
            head_rotation(0.0, off_rad) @ head_rotation(0.0, 0.0).T, np.zeros(3)
        )
        for k, frame in enumerate(recording.frames()):
            if k >= 8 and frame.depth is not None:
                T = frame.depth.T_body_camera
                turned = Pose3.from_rotation(down.rotation @ T.rotation, T.position)
                frame = replace(frame, depth=replace(frame.depth, T_body_camera=turned))
            said[off_rad] |= {one.words for one in pipeline.cycle(frame).estimate.status}
    assert "camera and joints disagree" in said[0.07]
    assert "camera and joints disagree" not in said[0.0]


def test_without_pictures_the_feet_stay_where_they_are_and_the_status_says_why(tmp_path):
    mission, faults = MissionConfig(time_limit_s=9.0), FaultConfig(("blackout",), 5.0, 3.0)
    config = fitted(Config(scene="storeys", seed=3, robot=ROBOT, mission=mission, faults=faults))
    out = tmp_path / "run"
    simulate(config, out, False, lambda line: None, report=False)
    run = RunFolder.open(out)
    dark_s = run.read_csv("truth/faults.csv").numbers("stamp_s")
    table = run.read_csv("status.csv")
    began = [
        s
        for s, event in zip(table.numbers("stamp_s"), table.words("event"), strict=True)
        if event == "begins"
    ]
    assert min(began) - dark_s.min() < 2.0
    true = run.read_trajectory("truth/trajectory.txt")
    dark = (true.stamps > dark_s.min() + 1.5) & (true.stamps <= dark_s.max())
    assert dark.sum() >= 2
    stood = true.positions[dark]
    assert np.abs(stood - stood[0]).max() < 0.01


def test_a_walk_that_finds_no_step_ends_and_says_so(tmp_path):
    """Our small robot does not see the ground where it would step."""
    small = RobotConfig(colour=False, stereo=False, tof_source="rays")
    mission = MissionConfig(planner=ON_LEVELS)
    config = Config(scene="boxes", seed=3, robot=small, mission=mission)
    summary = simulate(config, tmp_path / "run", False, lambda line: None, report=False)
    assert not summary.succeeded
    assert "stopped where no step led on: unknown" in summary.notes
