"""A robot that sees its own arms: nothing of them reaches the world, and offline the same is removed as live."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from perception.depth import sources
from surefoot.config.load import load
from surefoot.experiments.joint.robots import own_points
from surefoot.recordings.mcap_format import McapRecording
from surefoot.results.run_folder import RunFolder
from surefoot.run import simulate

LITTLE = Path(__file__).resolve().parents[2] / "little_robot"


def walk(model: Path, out: Path, limit_s: float, record: bool) -> RunFolder:
    asked = [f"robot.model={model}", "robot.tof_source=rays", "robot.colour=false"]
    asked += ["mission.planner=field", f"mission.time_limit_s={limit_s}"]
    config = load(None, asked, scene="boxes", seed=1)
    simulate.simulate(config, out, record, lambda text: None)
    return RunFolder.open(out)


@pytest.fixture(scope="module")
def walked(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, RunFolder]:
    """The folder of the robot's own files, and its run with the recording."""
    folder = tmp_path_factory.mktemp("walk")
    shutil.copytree(LITTLE, folder / "robot")
    return folder / "robot", walk(folder / "robot" / "little.toml", folder / "live", 4.0, True)


def test_no_point_of_its_own_arms_is_used(walked):
    figures = own_points(walked[1], load(walked[1].root / "config.toml"))
    assert figures["own_pixels"] > 1000
    assert figures["own_cells"] == 0
    grid = np.load(walked[1].root / "terrain.npz")
    assert len(grid.files) > 0


def test_without_the_filter_its_arms_would_be_used(monkeypatch, tmp_path):
    monkeypatch.setattr(sources, "without_self", lambda depth, *rest: depth)
    run = walk(LITTLE / "little.toml", tmp_path / "live", 1.0, False)
    assert own_points(run, load(run.root / "config.toml"))["own_cells"] > 100


def test_a_recording_gives_the_same_offline_without_the_urdf(walked, assert_same_offline):
    robot, live = walked
    (robot / "little.urdf").unlink()
    assert_same_offline(live.root)


def test_the_recording_carries_joints_and_hulls(walked):
    recording = McapRecording(walked[1].root / "recording.mcap")
    own = recording.info.own_body
    assert own is not None
    assert {part.name.split()[0] for part in own.parts} >= {"l_forearm", "r_foot", "pelvis"}
    frames = list(recording.frames())
    assert all(len(frame.joints.angles) == len(own.tree.joints) for frame in frames)
    knees = [frame.joints.angles[own.tree.index("l_knee")] for frame in frames]
    assert np.ptp(knees) > 0.2  # it steps
