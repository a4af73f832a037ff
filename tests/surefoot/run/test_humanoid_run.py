"""The pipeline takes the frames of a described robot with a dynamic body, and its cameras see no part of it as world."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from perception.primitives.pose import wrap_angle
from sim.robots import catalogue, installed
from surefoot.config.load import load
from surefoot.experiments.joint.robots import figures_of
from surefoot.results.run_folder import RunFolder
from surefoot.run import simulate


@pytest.fixture(scope="module")
def walked(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    """A few seconds of a G1, whose waist turns its camera."""
    described = catalogue.load("g1")
    if installed.folder(described.package) is None:
        pytest.skip(f"{described.package} is not installed: {installed.EXTRA}")
    out: Path = tmp_path_factory.mktemp("walk") / "run"
    asked = ["robot.model=g1", "robot.body=dynamic", "robot.tof_source=rays", "robot.colour=false"]
    config = load(None, [*asked, "mission.time_limit_s=8"], scene="home", seed=3)
    simulate.simulate(config, out, False, lambda text: None)
    return RunFolder.open(out)


def test_the_robot_walks_by_its_own_perception(walked: RunFolder) -> None:
    told, true = (walked.read_trajectory(n) for n in ("trajectory.txt", "truth/trajectory.txt"))
    assert told is not None
    assert true is not None
    off = told.positions[-1, :2] - true.positions[-1, :2]
    assert np.hypot(*off) < 0.1
    assert abs(wrap_angle(told.yaws[-1] - true.yaws[-1])) < np.radians(3.0)
    figures = figures_of(walked, load(walked.root / "config.toml"))
    assert figures["falls"] == 0
    assert figures["own_pixels"] > 0
    assert figures["own_cells"] == 0


def test_no_frame_counts_as_missing(walked: RunFolder) -> None:
    status = walked.read_csv("status.csv")
    assert status is None or "gap in stamps" not in status.words("status")
