"""Processing a recording: the camera's trajectory in space, ignored poses, and Ctrl-C."""

from __future__ import annotations

import json
import signal
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from surefoot.config.schema import Config
from surefoot.evaluation.evaluate import evaluate
from surefoot.recordings.open import open_recording
from surefoot.results.run_folder import RunFolder
from surefoot.results.tables import read_tum
from surefoot.run.interrupt import stop_requested
from surefoot.run.process import process
from surefoot.store.query import asker

WALK = Path(__file__).parents[3] / "data" / "walk"


def quiet(text):
    pass


@pytest.fixture(scope="module")
def kitchen(recordings):
    return recordings / "sevenscenes_redkitchen" / "pan"


@pytest.fixture(scope="module")
def whole(kitchen, tmp_path_factory):
    """The run of the kitchen, undisturbed."""
    out = tmp_path_factory.mktemp("kitchen") / "whole"
    process(kitchen, None, Config(), out, quiet)
    return out


def test_given_poses_are_the_trajectory_of_the_camera_in_space(kitchen, whole):
    found = read_tum(whole / "trajectory.txt")
    frames = list(open_recording(kitchen).frames())
    assert len(found) == len(frames)
    given = np.array([frame.T_world_camera.rotation for frame in frames])
    mine = np.array([pose_of(found, k) for k in range(len(found))])
    turn = mine[0] @ given[0].T
    np.testing.assert_allclose(mine, turn @ given, atol=1e-9)
    positions = np.array([frame.T_world_camera.translation for frame in frames])
    np.testing.assert_allclose(found.positions, positions @ turn.T, atol=1e-9)
    summary = json.loads((whole / "summary.json").read_text())
    assert summary["trajectory"] == "camera"
    with asker([whole], quiet) as tables:
        rows = tables.ask("SELECT x_m, y_m, z_m FROM frames ORDER BY stamp_s").rows
    np.testing.assert_allclose(rows, found.positions, atol=1e-9)
    assert len(RunFolder(whole).read_csv("space_covariance.csv")) == len(frames)


def pose_of(trajectory, k):
    from scipy.spatial.transform import Rotation

    return Rotation.from_quat(trajectory.quats_xyzw[k]).as_matrix()


def test_ignored_poses_are_the_truth_for_the_camera_s_own_odometry(recordings, tmp_path):
    config = replace(Config(), ignore_poses=True)
    process(recordings / "tum_fr3_cabinet", None, config, tmp_path / "run", quiet)
    truth = tmp_path / "run" / "truth" / "trajectory.txt"
    metrics = evaluate(RunFolder(tmp_path / "run"), truth)
    assert metrics["matched_poses"] == 38
    assert metrics["ate_m"] < 0.03
    assert metrics["pose_dof"] == 6
    assert 0.2 < metrics["pose_variance_ratio"] < 3.0


def test_a_stereo_pair_without_poses_is_followed_by_its_own_odometry(recordings, tmp_path):
    process(recordings / "euroc_v101_stereo" / "static", None, Config(), tmp_path / "run", quiet)
    found = read_tum(tmp_path / "run" / "trajectory.txt")
    assert len(found) == 7
    assert np.abs(found.positions - found.positions[0]).max() < 0.02  # the rig stands still


def test_given_poses_without_a_vertical_are_not_called_missing(tmp_path):
    recording = tmp_path / "wall"
    (recording / "depth").mkdir(parents=True)
    for n in range(2):
        wall = np.full((60, 80), 1500, np.uint16)
        cv2.imwrite(str(recording / "depth" / f"{n}.png"), wall)
    (recording / "stamps.txt").write_text("0.0\n0.1\n")
    (recording / "poses.txt").write_text("0.0 0 0 0 0 0 0 1\n0.1 0 0 0.1 0 0 0 1\n")
    (recording / "recording.toml").write_text(
        'stamps = "stamps.txt"\n'
        "[camera]\nwidth = 80\nheight = 60\nfx = 60.0\nfy = 60.0\ncx = 40.0\ncy = 30.0\n"
        '[depth]\nfolder = "depth"\nscale_per_metre = 1000\nnone = [0]\n'
        '[poses]\nfile = "poses.txt"\naxes = "optical"\n'
    )
    notes = " ".join(process(recording, None, Config(), tmp_path / "run", quiet).notes)
    assert "neither poses" not in notes
    assert "poses, but no vertical" in notes
    assert "world.up" in notes


def test_a_walking_body_keeps_its_planar_trajectory(tmp_path):
    process(WALK, None, Config(), tmp_path / "run", quiet)
    found = read_tum(tmp_path / "run" / "trajectory.txt")
    assert (found.positions[:, 2] == 0.0).all()
    assert not (tmp_path / "run" / "space_covariance.csv").exists()
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["trajectory"] == "body"


def test_after_ctrl_c_the_run_can_be_opened_and_resumes_to_the_same_bits(
    kitchen, whole, tmp_path, ctrl_c, pages
):

    def press(text):
        if text.startswith("frame 9 "):
            signal.raise_signal(signal.SIGINT)

    with pages():
        summary = process(kitchen, None, Config(), tmp_path / "cut", press)
    assert summary.interrupted
    assert summary.frames == 9
    cut = RunFolder.open(tmp_path / "cut")
    assert len(cut.read_trajectory("trajectory.txt")) == 9
    assert cut.read_json("summary.json")["interrupted"] is True
    assert cut.has("report.html")
    assert not list(cut.root.glob(".part-*"))

    said = []
    summary = process(kitchen, None, Config(), tmp_path / "cut", said.append, resume=True)
    assert said[0] == "resuming after frame 9"
    assert not summary.interrupted
    for name in (
        "trajectory.txt", "space_covariance.csv", "trajectory_covariance.csv", "floor.csv", "map.pgm",
        "obstacles.json", "innovations.csv", "cloud.ply",
    ):  # fmt: skip
        assert (cut.root / name).read_bytes() == (whole / name).read_bytes(), name
    assert not list(cut.root.glob(".checkpoint*"))


def press_twice():
    with stop_requested() as stopped:
        assert not stopped()
        signal.raise_signal(signal.SIGINT)
        assert stopped()
        signal.raise_signal(signal.SIGINT)


def test_a_second_ctrl_c_interrupts_at_once(ctrl_c):
    with pytest.raises(KeyboardInterrupt):
        press_twice()
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.parametrize(("scale", "said"), [(1000, True), (5000, False)])
def test_depth_of_which_nothing_is_within_reach_is_named(tmp_path, scale, said):
    """A floor 0.6 m below the camera in units of a fifth of a millimetre, read as such or as millimetres."""
    down = (np.arange(120) - 59.5)[:, None] / 130.0 * np.ones((1, 160))
    depth_m = np.where(down > 0.15, 0.6 / np.maximum(down, 0.15), 3.5)
    (tmp_path / "walk" / "depth").mkdir(parents=True)
    for number in range(3):
        values = np.rint(5000.0 * depth_m).astype(np.uint16)
        cv2.imwrite(str(tmp_path / "walk" / "depth" / f"{number}.png"), values)
    (tmp_path / "walk" / "recording.toml").write_text(
        "[camera]\nwidth = 160\nheight = 120\nfx = 130.0\nfy = 130.0\ncx = 79.5\ncy = 59.5\n"
        f"[depth]\nscale_per_metre = {scale}\nnone = [0]\n"
    )
    summary = process(tmp_path / "walk", None, Config(), tmp_path / "run", quiet)
    named = [note for note in summary.notes if "is within reach" in note]
    assert len(named) == said
    assert all(
        "in 3 of 3 frames, the median 17.5 m; check scale_per_metre" in note for note in named
    )
