"""Configuration files: complete, exact, and strict about what they do not know."""

from __future__ import annotations

import dataclasses
import math
import tomllib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from perception.depth.points import Points
from perception.floor import classify
from perception.localisation.landmarks import constrained_to_height, to_body_frame
from perception.localisation.localiser_noise import LocaliserConfig
from perception.primitives.errors import ConfigError, InputError
from perception.primitives.gaussian import Gaussian
from perception.primitives.plane import Plane
from perception.primitives.pose import Pose2, Pose3, head_rotation
from perception.primitives.robot_model import DARWIN_OP
from planning.avoidance.primitives import Leg, in_the_way
from planning.planners.mission import MissionConfig
from sim.body.dynamic.anatomy import gait_for
from surefoot.config import reference, toml
from surefoot.config.load import load
from surefoot.config.presets import WALKED_LOCALISER, on_body
from surefoot.config.schema import Config


@settings(deadline=None)
@given(
    st.integers(0, 10**6),
    st.floats(1e-3, 1e3, allow_nan=False),
    st.booleans(),
    st.sampled_from(["auto", "egl", "tiny"]),
)
def test_what_is_written_reads_back_to_the_same_bits(seed, tolerance_m, pairs, renderer):
    config = dataclasses.replace(
        Config(),
        seed=seed,
        renderer=renderer,
        mission=MissionConfig(tolerance_m=tolerance_m),
        robot=dataclasses.replace(Config().robot, image_pairs=pairs),
    )
    assert toml.parse(Config, tomllib.loads(toml.dumps(config))) == config


def test_every_value_is_written_so_that_no_default_can_change_a_run():
    written = tomllib.loads(toml.dumps(Config()))
    names = {name for name, *_ in reference.rows()}
    assert {name for name in names if "." not in name} <= set(written)
    assert {name.partition(".")[0] for name in names} == set(written)
    assert written["grid"]["evidence"]["limit"] == Config().grid.evidence.limit


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({"sead": 1}, "did you mean seed"),
        ({"grid": {"cel_m": 0.1}}, "grid.cel_m; did you mean grid.cell_m"),
        ({"seed": "one"}, "seed='one': expected a whole number"),
        ({"seed": True}, "seed=True: expected a whole number"),
        ({"mission": {"tolerance_m": float("nan")}}, "expected a finite number"),
        ({"mission": 3}, r"expected a table \[mission\]"),
        ({"mission": {"goals": 0}}, r"\[mission\] goals=0 must be at least 1"),
        ({"robot": {"dynamic": {"slope_rad": [0.1]}}}, "expected 2 values"),
        ({"robot": {"dynamic": {"slope_rad": 0.1}}}, "expected a list"),
        ({"internal": 3}, r"expected a table \[internal\]"),
        ({"internal": {"tracker.oldest": 3}}, "did you mean tracker.oldest_s"),
        ({"renderer": "gpu"}, "choose auto, egl or tiny"),
        ({"difficulty": 1.1}, r"difficulty=1.1 must lie in \[0, 1\]"),
    ],
)
def test_what_cannot_be_is_refused_with_its_place(table, said):
    with pytest.raises(ConfigError, match=said):
        toml.parse(Config, table)


def test_a_whole_number_serves_where_a_number_is_wanted():
    config = toml.parse(Config, {"mission": {"time_limit_s": 60}})
    assert config.mission.time_limit_s == 60.0
    assert isinstance(config.mission.time_limit_s, float)


def test_single_values_change_on_the_command_line_and_nothing_else_does():
    config = load(None, ["grid.cell_m=0.05", "renderer=tiny", "robot.stereo=false"], seed=4)
    assert (config.renderer, config.robot.stereo, config.seed) == ("tiny", False, 4)
    assert dataclasses.replace(config.robot, stereo=True) == Config().robot


@pytest.mark.parametrize(
    "pair",
    [
        ("grid.cell_m=0.02", "grid.side_m=3.50"),
        ("univector.mode=seed", "mission.planner=field"),
        ("gait.cruise_mps=0.3", "gait.max_speed_mps=0.4"),
        ("reach.tof.nearest_m=4.0", "reach.tof.farthest_m=5.0"),
        ("reach.tof={nearest_m=4.0}", "reach.tof.farthest_m=5.0"),
    ],
)
def test_single_values_are_checked_together_in_any_order(pair):
    assert load(None, pair) == load(None, pair[::-1])
    with pytest.raises(ConfigError, match=pair[0].split(".")[0]):
        load(None, pair[:1])


def test_of_two_values_of_one_setting_the_later_one_counts():
    assert load(None, ["seed=1", "seed=2"]).seed == 2
    with pytest.raises(ConfigError, match=r"grid=3: expected a table \[grid\]"):
        load(None, ["grid.cell_m=0.05", "grid=3"])


def test_a_file_that_is_not_toml_is_named(tmp_path):
    path = tmp_path / "broken.toml"
    path.write_text("[grid\n")
    with pytest.raises(InputError, match=r"broken\.toml is not valid TOML"):
        load(path)


def test_a_file_of_an_earlier_version_is_read_without_its_retired_settings(tmp_path):
    path = tmp_path / "config.toml"
    path.write_text("seed = 7\n[floor.refine]\ndepth_share = 0.01\n")
    assert toml.read(Config, path) == Config(seed=7)


def test_an_error_in_a_file_begins_with_the_file(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text("[tracker]\nhits_to_show = 0\n")
    with pytest.raises(ConfigError, match=r"mine\.toml: \[tracker\]"):
        load(path)


@pytest.mark.parametrize("body", ["kinematic", "dynamic"])
def test_tags_are_not_misplaced_by_an_offset_of_the_head_that_joints_have(body):
    """Three deviations of the offset that each walk draws, and half a degree of sway."""
    config = load(None, [f"robot.body={body}"])
    off = math.radians(3.0 * config.robot.head.offset_deg + 0.5)
    level = Pose3.from_rotation(head_rotation(0.0, 0.0), np.array([0.0, 0.0, 0.4]))
    tilted = Pose3.from_rotation(head_rotation(0.0, off), level.position)
    for away_m in (0.5, 1.0, 2.0, 3.0):
        place = tilted.inverse().apply(np.array([[away_m, 0.0, 0.4]]))[0]
        seen = to_body_frame(Gaussian(place, 1e-6 * np.eye(3)), level, config.landmarks)
        assert constrained_to_height(seen, 0.4) is not None


def test_with_the_dynamic_body_only_the_value_named_changes(tmp_path):
    plain = load(None, ["robot.body=dynamic"])
    assert plain.localiser == WALKED_LOCALISER
    assert plain.landmarks == Config().landmarks
    path = tmp_path / "some.toml"
    path.write_text('[robot]\nbody = "dynamic"\n[localiser]\nstep_x_sigma_m = 0.007\n')
    named = load(None, ["localiser.step_x_sigma_m=0.007", "robot.body=dynamic"])
    for config in (load(path), named):
        assert config.localiser == dataclasses.replace(WALKED_LOCALISER, step_x_sigma_m=0.007)
        assert dataclasses.replace(config, localiser=WALKED_LOCALISER) == plain
    coded = dataclasses.replace(Config(), localiser=LocaliserConfig(step_x_sigma_m=0.007))
    assert on_body(coded, "dynamic") == named


def test_a_value_asked_for_stays_even_where_it_is_the_other_bodys():
    slip_m = LocaliserConfig().slip_m
    config = load(None, ["robot.body=dynamic", f"localiser.slip_m={slip_m}"])
    assert config.localiser == dataclasses.replace(WALKED_LOCALISER, slip_m=slip_m)


def test_what_was_written_with_another_body_reads_back_to_the_same(tmp_path):
    for overrides in (["robot.body=dynamic"], ["robot.dynamic.anatomy=tall"], []):
        config = load(None, [*overrides, "guard.risk=0.02"])
        path = tmp_path / "config.toml"
        path.write_text(toml.dumps(config))
        assert load(path) == config


@pytest.mark.parametrize("body", ["kinematic", "dynamic"])
def test_the_robot_model_grows_with_the_body(body):
    plain = load(None, [f"robot.body={body}"]).robot_model
    assert plain == DARWIN_OP
    grown = load(None, [f"robot.body={body}", "robot.dynamic.scale=2.0"]).robot_model
    for name in ("radius_m", "width_m", "depth_m", "height_m", "passage_width_m", "eye_m", "hip_m"):
        assert getattr(grown, name) == pytest.approx(2.0 * getattr(plain, name))
    assert grown.breadth == 2.0
    assert grown.gait.cruise_mps == 2.0 * plain.gait.cruise_mps
    assert grown.gait.max_turn_deg == plain.gait.max_turn_deg


@pytest.mark.parametrize("scale", [0.5, 1.0, 2.0])
def test_the_planned_steps_are_within_the_limits_of_the_body(scale):
    config = load(None, [f"robot.dynamic.scale={scale}"])
    most = gait_for(config.robot.dynamic.body, config.robot.gait)
    gait = config.robot_model.gait
    assert gait.max_speed_mps * gait.step_s <= most.forward_limit_m


def test_the_robot_of_seed_004_has_its_printed_size():
    config = load(None, ["robot.dynamic.anatomy=tall"])
    robot = config.robot_model
    assert (robot.width_m, robot.depth_m, robot.passage_width_m) == (0.30, 0.20, 0.30)
    assert robot.height_m == pytest.approx(0.60, abs=0.01)
    assert robot.radius_m > math.hypot(0.30, 0.20) / 2
    assert config.classes.robot_height_m == robot.height_m


@pytest.mark.parametrize(("anatomy", "blocked"), [("tall", True), ("darwin", False)])
def test_a_bar_at_58_cm_is_in_the_way_of_the_robot_of_60_cm(anatomy, blocked):
    config = load(None, [f"robot.dynamic.anatomy={anatomy}"])
    eye_m = config.robot_model.eye_m
    bar = np.column_stack([np.linspace(-0.2, 0.2, 9), np.full(9, eye_m - 0.58), np.full(9, 0.8)])
    points = Points(bar, np.full(9, 0.004), np.arange(9))
    level = Plane(np.array([0.0, -1.0, 0.0]), eye_m)
    labels = classify.classify(points, level, config.classes)
    assert np.all(labels == (classify.OBSTACLE if blocked else classify.OVERHANG))


def test_a_cell_is_in_the_way_of_the_configured_body():
    leg, robot = Leg("F", Pose2(1.0, 0.0, 0.0)), Pose2()
    cell = np.array([[0.15, 0.11]])
    for anatomy, blocked in (("tall", True), ("darwin", False)):
        model = load(None, [f"robot.dynamic.anatomy={anatomy}"]).robot_model
        assert in_the_way(leg, robot, cell, 0.05, model)[0] == blocked


@pytest.mark.parametrize("body", ["kinematic", "dynamic"])
def test_the_body_planned_for_by_default_has_the_measures_printed(body):
    config = load(None, [f"robot.body={body}"])
    plain = Config()
    own = {"robot": plain.robot, "localiser": plain.localiser}
    assert dataclasses.replace(config, **own) == plain


def test_the_walker_by_colour_has_one_camera_and_its_worlds_goals_unless_told_otherwise(tmp_path):
    swarm = "mission.planner=swarm"
    config = load(None, [swarm], scene="robots_room")
    assert (config.robot.tof, config.robot.stereo, config.robot.image_pairs) == (False, False, True)
    assert config.swarm.goal_times_s == (0.0, 70.0, 130.0, 150.0, 200.0)
    assert config.mission.goals == 5
    assert load(None, [swarm], scene="home").swarm.goal_times_s == ()
    told = load(None, [swarm, "robot.tof=true", "mission.goals=2"], scene="robots_room")
    assert (told.robot.tof, told.robot.stereo, told.mission.goals) == (True, False, 2)
    published = load(None, [swarm, "swarm.version=published"], scene="robots_room")
    file = tmp_path / "run.toml"
    file.write_text(toml.dumps(published), encoding="utf-8")
    assert load(file) == published
