"""The whole chain: pixels to steps, live and from the recording, honest about what it may know."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from perception.primitives.plane import Plane
from perception.primitives.pose import Pose2, Pose3, wrap_angle
from sim.scene import FloorArea, Scene, StaticObject
from sim.shapes import Box
from surefoot.cli.main import main
from surefoot.config.load import load
from surefoot.config.schema import Config
from surefoot.evaluation.evaluate import evaluate
from surefoot.results.run_folder import RunFolder
from surefoot.run import simulate

SECONDS = 7.0


def quiet(text: str) -> None:
    """No progress in tests."""


def short(seconds: float, **changes: object) -> Config:
    """The home for some seconds, long enough to look round and make the first steps."""
    mission = dataclasses.replace(Config().mission, time_limit_s=seconds)
    return dataclasses.replace(Config(), mission=mission, **changes)


@pytest.fixture(scope="module")
def walked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recorded walk of seven seconds."""
    out = tmp_path_factory.mktemp("walk") / "live"
    simulate.simulate(short(SECONDS), out, True, quiet)
    return out


def test_a_recording_processed_gives_the_same_to_the_last_bit(walked, assert_same_offline):
    assert len(RunFolder.open(walked).read_csv("innovations.csv").words("source")) >= 10
    assert_same_offline(walked)


def test_a_walk_is_processed_with_its_own_settings_unless_others_are_given(tmp_path, assert_same):
    """The localiser of the walking body is another one than that of the kinematic body."""
    walked, ours, plain = (tmp_path / name for name in ("walked", "ours", "plain"))
    asked = load(None, ["robot.body=dynamic", "robot.stereo=false", "mission.time_limit_s=4.0"])
    simulate.simulate(asked, walked, True, quiet)
    call = CliRunner().invoke
    assert call(main, ["process", str(walked), "--out", str(ours)]).exit_code == 0
    assert_same(walked, ours)
    (tmp_path / "none.toml").write_text("")
    words = ["process", str(walked), "--config", str(tmp_path / "none.toml"), "--out", str(plain)]
    assert call(main, words).exit_code == 0
    claimed = "trajectory_covariance.csv"
    assert (walked / claimed).read_bytes() != (plain / claimed).read_bytes()


def test_the_configuration_that_a_run_wrote_runs_again_to_the_same_numbers(
    walked, tmp_path, assert_same
):
    simulate.simulate(load(walked / "config.toml"), tmp_path / "again", True, quiet)
    assert_same(walked, tmp_path / "again")
    for name in ("commands.csv", "config.toml"):
        assert (walked / name).read_bytes() == (tmp_path / "again" / name).read_bytes(), name


def test_no_truth_reaches_an_estimate_or_a_command(walked, tmp_path, monkeypatch, assert_same):
    from sim.truth import Truth

    garbage = Plane(np.array([1.0, 0.0, 0.0]), -7.0)
    monkeypatch.setattr(Truth, "robot_pose", lambda self: Pose2(99.0, -99.0, 1.0))
    monkeypatch.setattr(Truth, "camera_pose", lambda self, camera: Pose3((9.0, 9.0, 9.0)))
    monkeypatch.setattr(Truth, "floor", lambda self, camera: garbage)
    monkeypatch.setattr(Truth, "obstacles", lambda self: [(1, 5.0, 5.0, 3.0, 3.0, 9.0, 9.0)])
    monkeypatch.setattr(Truth, "names", lambda self: ["nonsense"])
    monkeypatch.setattr(Truth, "clearance_m", lambda self: (-1.0, "nonsense"))
    monkeypatch.setattr(Truth, "occupied", lambda self, points: np.ones(len(points), dtype=bool))
    simulate.simulate(short(SECONDS), tmp_path / "lied", True, quiet)
    assert_same(walked, tmp_path / "lied")
    commands = "commands.csv"
    assert (walked / commands).read_bytes() == (tmp_path / "lied" / commands).read_bytes()
    assert "99.0" in (tmp_path / "lied" / "truth" / "trajectory.txt").read_text()  # it was asked


def test_another_seed_is_another_walk_and_leaves_what_other_tools_open(walked, tmp_path, pages):
    with pages():
        simulate.simulate(short(1.0, seed=1), tmp_path / "other", False, quiet)
    ours = (walked / "trajectory.txt").read_text().splitlines()[2]
    assert (tmp_path / "other" / "trajectory.txt").read_text().splitlines()[2] != ours
    for part in ("config.toml", "map.yaml", "cloud.ply", "report.html", "summary.json"):
        assert (tmp_path / "other" / part).stat().st_size > 0, part


def test_a_robot_crosses_the_home_without_touching_anything(tmp_path):
    out = tmp_path / "home"
    robot = dataclasses.replace(Config().robot, stereo=False)
    config = dataclasses.replace(Config(), seed=3, robot=robot)
    summary = simulate.simulate(config, out, False, quiet)
    metrics = evaluate(RunFolder.open(out))
    start, goal = (
        np.array(json.loads((out / "summary.json").read_text())[name][:2])
        for name in ("start", "goal_positions")
    )
    assert summary.succeeded
    assert np.linalg.norm(np.ravel(goal)[:2] - start) >= 4.0
    assert metrics["goals_missed"] == 0
    assert metrics["contacts"] == 0
    assert metrics["position_rmse_m"] <= 0.05
    assert metrics["heading_rmse_deg"] <= 2.0
    assert metrics["floor_tof_angle_deg_median"] <= 0.5
    assert metrics["floor_tof_height_mm_median"] <= 5.0
    assert metrics["grid_correct_share_one_cell"] >= 0.95


def test_a_fall_ends_a_run_and_is_told(tmp_path):
    steep = ("robot.body=dynamic", "robot.dynamic.slope_rad=[0.25, 0.0]", "robot.stereo=false")
    config = load(None, steep, scene="home", seed=3)
    summary = simulate.simulate(config, tmp_path / "fell", False, quiet)
    assert summary.fell_at_s is not None
    assert 0.0 < summary.fell_at_s < 10.0
    assert not summary.succeeded
    assert evaluate(RunFolder.open(tmp_path / "fell"))["falls"] == 1.0


def scene_with(*things: StaticObject) -> Scene:
    extent = (-1.0, -1.0, 1.0, 1.0)
    floor = (FloorArea("plaster/white", extent),)
    return Scene("floor", 0, extent, floor, things, (), (), Pose2(0.1, -0.2, 3.14), ())


def test_a_robot_stands_about_its_mark_as_its_prior_says():
    scene = scene_with()
    placed = [simulate.true_start(scene, dataclasses.replace(Config(), seed=s)) for s in range(400)]
    off = np.array([(p.x - 0.1, p.y + 0.2, wrap_angle(p.yaw - 3.14)) for p in placed])
    sigma = np.sqrt(np.diag(simulate.START_COVARIANCE))
    assert np.all(np.abs(off.mean(axis=0)) < 4.0 * sigma / np.sqrt(400))
    np.testing.assert_allclose(off.std(axis=0), sigma, rtol=4.0 / np.sqrt(800))
    assert simulate.true_start(scene, Config()) == placed[0]


def test_a_robot_is_put_down_clear_of_what_stands_there():
    box = StaticObject(
        "box", (Box((0.1, -0.052, 0.2), (0.4, 0.1, 0.4), 0.0),)
    )  # 98 mm from the mark
    placed = [
        simulate.true_start(scene_with(box), dataclasses.replace(Config(), seed=s))
        for s in range(50)
    ]
    assert max(p.y for p in placed) <= -0.102 - np.hypot(0.110, 0.164) / 2
    tight = StaticObject("box", (Box((0.1, -0.15, 0.2), (0.4, 0.1, 0.4), 0.0),))
    assert simulate.true_start(scene_with(tight), Config()) == scene_with().start


def test_the_run_starts_off_the_mark_that_it_was_told(walked):
    told = np.array(json.loads((walked / "summary.json").read_text())["start"])
    true = RunFolder.open(walked).read_trajectory("truth/trajectory.txt")
    off = np.append(true.positions[0, :2] - told[:2], wrap_angle(true.yaws[0] - told[2]))
    sigma = np.sqrt(np.diag(simulate.START_COVARIANCE))
    assert np.all(off != 0.0)
    assert np.all(np.abs(off) < 4.5 * sigma)


def test_the_summary_says_how_to_make_the_run_again(walked):
    summary = json.loads((walked / "summary.json").read_text())
    assert summary["command"].startswith("surefoot simulate --config")
    assert summary["renderer"] in ("egl", "tiny")
