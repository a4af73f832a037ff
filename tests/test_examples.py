"""The examples run as they are written, and do what they say."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import surefoot
from perception.primitives.pose import head_rotation
from surefoot.cli.main import main
from surefoot.experiments.joint import four_planners, gaze_coupling

ROOT = Path(__file__).resolve().parents[1]
WALK = ROOT / "data" / "walk"
WORKED = sorted(path.stem for path in (ROOT / "examples").glob("*.py"))


@pytest.fixture(autouse=True)
def _here(monkeypatch):
    """In the checkout, and without reports, which nobody looks at here."""
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr("surefoot.report.page.write_report", lambda run: run.path("report.html"))
    monkeypatch.setattr(sys, "path", [str(ROOT), *sys.path])


def run(*words: object) -> None:
    """A verb of the command line, which must succeed or at least end in a run."""
    result = CliRunner().invoke(main, [str(word) for word in words], catch_exceptions=False)
    assert result.exit_code in (0, 1), result.output


@pytest.mark.parametrize("name", ["my_planner", "my_guarded_planner", "my_gaze"])
def test_a_planner_and_a_gaze_policy_take_at_most_thirty_lines(name):
    lines = (ROOT / "examples" / f"{name}.py").read_text().splitlines()
    assert sum(1 for line in lines if line.strip()) <= 30


def test_the_planner_walks_towards_the_goal(tmp_path):
    run(
        *("simulate", "boxes", "--planner", "examples.my_planner:WalkStraight"),
        *(
            "--set",
            "mission.time_limit_s=6",
            "--set",
            "robot.stereo=false",
            "--out",
            tmp_path / "walk",
        ),
    )
    walk = surefoot.Run(tmp_path / "walk")
    assert walk.trajectory is not None
    first, last = walk.trajectory.poses[[0, -1], :2]
    goal = np.array(walk.summary["goal_positions"][0])
    assert np.linalg.norm(goal - last) < np.linalg.norm(goal - first) - 0.2
    assert "examples.my_planner:WalkStraight" in walk.path("config.toml").read_text()


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("examples.my_planner:WalkStraight", "blocked"),
        ("examples.my_guarded_planner:WalkGuarded", "guard"),
    ],
)
def test_the_planner_says_what_it_does_before_a_box(name, why, tmp_path):
    scene = tmp_path / "box.toml"
    scene.write_text(
        "extent = [0, 0, 3.4, 2.6]\nstart = [0.5, 1.3, 0]\ngoals = [[2.7, 1.3]]\n"
        '[[box]]\nname = "crate"\nat = [1.0, 1.05]\nsize = [0.3, 0.5, 0.4]\n'
    )
    settings = {"robot.stereo": False, "robot.colour": False}
    walk = surefoot.simulate(
        str(scene), planner=name, seconds=8.0, settings=settings, out=tmp_path / "walk"
    )
    table = walk._files.read_csv("commands.csv")
    assert table is not None
    assert why in table.words("why")


def test_the_gaze_policy_looks_left_and_right_by_turns_from_the_first_step(tmp_path):
    run(
        *("simulate", "empty_room", "--gaze", "examples.my_gaze:NearestFirst"),
        *(
            "--set",
            "mission.time_limit_s=5",
            "--set",
            "robot.stereo=false",
            "--out",
            tmp_path / "walk",
        ),
    )
    table = surefoot.Run(tmp_path / "walk")._files.read_csv("commands.csv")
    assert table is not None
    pans = table.numbers("pan_rad")
    assert "survey" not in table.words("why")  # ours begins with one
    turns = np.diff(pans)
    assert (turns[1:] * turns[:-1] < 0.0).all()  # left and right of the path by turns


def test_the_motion_model_follows_a_straight_motion():
    from examples.my_motion_model import ConstantVelocity

    rng = np.random.default_rng(3)
    tracker = surefoot.Tracker(motion_model=ConstantVelocity)
    for k in range(25):
        place = np.array([1.0 + 0.08 * 0.3 * k, 0.5]) + rng.normal(0.0, 0.01, 2)
        found = tracker.update(0.3 * k, [place], 1e-4 * np.eye(2))
    (track,) = found
    true = np.array([1.0 + 0.08 * 0.3 * 24, 0.5, 0.08, 0.0])
    assert track.state.mahalanobis_squared(true) < 18.5  # chi-square, 4, 0.999
    assert track.moving > 0.9


def test_the_motion_model_and_the_depth_source_process_a_recording_and_stand_in_its_config():
    sources = ["examples.my_depth_source:strong_returns"]
    own = surefoot.process(
        WALK,
        settings={
            "tracker.motion_model": "examples.my_motion_model:ConstantVelocity",
            "depth_sources": sources,
        },
    )
    assert own.floor is not None
    assert set(own.floor.sensors) == set(sources)
    assert own.floor.seen.mean() > 0.8
    assert own.grid is not None
    written = own.path("config.toml").read_text()
    assert sources[0] in written
    assert "examples.my_motion_model:ConstantVelocity" in written


def test_the_reader_reads_its_folder(tmp_path):
    camera = surefoot.Camera.from_view(80, 60, 1.0, 0.8)
    turn = head_rotation(0.0, 0.6)
    depth = 0.9 / -(camera.rays @ turn.T)[..., 2]
    depth_mm = np.where((depth > 0.0) & (depth < 4.0), 1000.0 * depth, 0.0).astype(np.uint16)
    folder = tmp_path / "frames"
    folder.mkdir()
    (folder / "camera.txt").write_text(f"80 60 {camera.fx} {camera.fy} {camera.cx} {camera.cy}\n")
    for k in range(4):
        pose = surefoot.Pose3.from_rotation(turn, np.array([0.1 * k, 0.0, 0.9])).matrix
        np.savez(folder / f"{k:04d}.npz", depth_mm=depth_mm, stamp_s=0.1 * k, T_world_camera=pose)
    run(
        *("process", folder, "--reader", "examples.my_reader:NumpyFolder"),
        *("--out", tmp_path / "run"),
    )
    processed = surefoot.Run(tmp_path / "run")
    assert processed.summary["frames"] == 4
    assert processed.trajectory is not None
    np.testing.assert_allclose(processed.trajectory.poses[:, 0], [0.0, 0.1, 0.2, 0.3], atol=1e-6)
    assert processed.floor is not None
    np.testing.assert_allclose(processed.floor.heights_m, 0.9, atol=0.01)
    again = surefoot.process(folder, config=processed.path("config.toml"))  # names the reader
    assert again.summary["frames"] == 4


@pytest.mark.parametrize(
    ("option", "name", "message"),
    [
        ("--planner", "examples.my_planner:Nobody", "planner .*has no 'Nobody'"),
        ("--planner", "examples.nothing:Nobody", "planner .*cannot be imported"),
        ("--gaze", "examples.my_planner:WalkStraight", "gaze policy .*lacks next"),
        ("--gaze", "stare", "gaze policy 'stare' is unknown"),
    ],
)
def test_a_plug_in_that_cannot_be_used_is_named_in_one_line(option, name, message, tmp_path):
    result = CliRunner().invoke(
        main, ["simulate", "empty_room", option, name, "--out", str(tmp_path / "walk")]
    )
    assert result.exit_code == 2
    assert len(result.stderr.strip().splitlines()) == 1
    assert re.search(message, result.stderr)


def test_an_error_inside_a_plug_in_names_it_and_its_line(tmp_path, monkeypatch):
    (tmp_path / "broken_planner.py").write_text(
        "from examples.my_planner import WalkStraight\n"
        "class Broken(WalkStraight):\n"
        "    def decide(self, world):\n"
        "        return 1 / 0\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    result = CliRunner().invoke(
        main,
        [
            "simulate",
            "empty_room",
            "--planner",
            "broken_planner:Broken",
            "--out",
            str(tmp_path / "w"),
        ],
    )
    assert result.exit_code == 1
    assert "planner 'broken_planner:Broken' raises ZeroDivisionError" in result.stderr
    assert "line 4" in result.stderr


def test_the_uses_of_arrays_find_what_was_put_in():
    from examples import library_arrays

    floor = library_arrays.floor_of_a_depth_image()
    assert floor.offset_m == pytest.approx(library_arrays.HEIGHT_M, abs=0.01)
    (board,) = library_arrays.obstacles_of_a_depth_image()
    assert board.centre == pytest.approx([1.4, 0.0], abs=0.02)
    assert library_arrays.depth_of_a_stereo_pair() == pytest.approx(1.0, abs=0.02)
    (footprint,) = library_arrays.footprints_of_a_point_cloud()
    assert footprint.box is not None
    assert footprint.box.length_m == pytest.approx(0.5, abs=0.03)
    path = library_arrays.path_over_a_map()
    assert len(path) > 2
    gaze = library_arrays.where_to_look()
    assert gaze.pan_rad > 0.3
    track = library_arrays.track_of_detections()
    assert track.velocity == pytest.approx([0.1, 0.0], abs=0.02)


def test_frames_of_ones_own_give_a_world_model():
    from examples import own_frames

    world = own_frames.main(frames=6)
    assert world.pose is not None
    assert world.grid is not None
    assert world.floor is not None


def test_whole_runs_come_back_as_arrays():
    from examples import whole_runs

    processed, walked = whole_runs.main(seconds=2.0)
    assert processed.metrics["position_rmse_m"] < 0.05
    assert walked.trajectory is not None


PLANNER, GAZE = "examples.my_planner:WalkStraight", "examples.my_gaze:NearestFirst"


def test_a_planner_of_ones_own_stands_in_the_table_of_the_experiment():
    configs = [
        four_planners.config_of(p, k) for k in range(4) for p in (*four_planners.ORDER, PLANNER)
    ]
    metrics = {
        "goals_missed": 0, "contacts": 0, "path_m": 3.0, "min_clearance_m": 0.1,
        "duration_s": 50.0, "computing_s": 20.0,
    }  # fmt: skip
    figures, table = four_planners.compare(configs, [metrics] * len(configs))
    assert figures["WalkStraight_walks"] == 4
    assert figures["WalkStraight_success_share"] == 1.0
    assert sum(line.startswith("WalkStraig ") for line in table) == 1 + len(four_planners.SCENES)
    assert all(len(line) <= len(table[0]) for line in table)


def test_a_gaze_policy_of_ones_own_walks_in_the_experiment(monkeypatch):
    monkeypatch.setattr(gaze_coupling, "LIMIT_S", 10.0)
    walked = gaze_coupling.walk_with_gaze(0, GAZE)
    assert walked.time_s >= 10.0
    assert walked.sigma_m > 0.0


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("INT-2", "--planner", PLANNER), "does not take --planner; these do: INT-4"),
        (("003-E3", "--gaze", GAZE), "does not take --gaze; these do: INT-2"),
        (("INT-4", "--planner", GAZE), "planner 'examples.my_gaze:NearestFirst' lacks reached"),
    ],
)
def test_an_experiment_refuses_what_it_cannot_compare(words, message):
    result = CliRunner().invoke(main, ["experiment", *words])
    assert result.exit_code == 2
    assert message in result.stderr
