"""The walk in data/ is what a newcomer tries first: it must open, process, and agree with its truth."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from click.testing import CliRunner

from surefoot.cli.main import main
from surefoot.config.schema import Config
from surefoot.evaluation.evaluate import evaluate
from surefoot.recordings.open import open_recording
from surefoot.results.run_folder import RunFolder
from surefoot.run import process

from ..report.browser import CHROMIUM, Browser
from ..report.replaying import moved

WALK = Path(__file__).resolve().parents[3] / "data" / "walk"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory, pages: Callable[..., Any]) -> Path:
    """The shipped walk, processed."""
    out = tmp_path_factory.mktemp("shipped") / "run"
    words = ["process", str(WALK), "--out", str(out), "--smooth", "inf", "--json"]
    with pages():
        summary = json.loads(CliRunner().invoke(main, words, catch_exceptions=False).stdout)
    assert summary["frames"] == open_recording(WALK).info.frames
    assert not summary["skipped"]
    return out


@pytest.fixture(scope="module")
def metrics(run: Path) -> dict[str, float]:
    """The shipped walk, held against its truth."""
    return evaluate(RunFolder.open(run))


def test_the_recording_is_small_enough_to_ship():
    assert sum(p.stat().st_size for p in WALK.rglob("*") if p.is_file()) < 8e6


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on the PATH; apt-get install chromium")
def test_its_report_links_a_replay_page_that_moves_on_any_screen(run, tmp_path):
    assert 'href="replay.html"' in (run / "report.html").read_text(encoding="utf-8")
    with Browser(tmp_path) as browser:
        for width in (1300, 400):
            panes = " ".join(moved(browser, run / "replay.html", width))
            for name in ("Top view", "Camera", "Depth (tof)", "Nearest obstacle", "Tracks"):
                assert name in panes


def test_where_it_says_it_walked_is_where_it_walked(metrics):
    assert metrics["position_rmse_m"] <= 0.05
    assert metrics["heading_rmse_deg"] <= 2.0


def test_poses_smoothed_over_the_walk_are_no_worse_and_within_their_covariance(metrics):
    assert metrics["smoothed_position_rmse_m"] <= 1.1 * metrics["position_rmse_m"]
    assert metrics["smoothed_consistent"]


def test_its_floor_is_the_floor(metrics):
    assert metrics["floor_tof_angle_deg_median"] <= 0.5
    assert metrics["floor_tof_height_mm_median"] <= 5.0


def test_its_map_agrees_with_the_room(metrics):
    assert metrics["grid_correct_share"] >= 0.95


def test_filterpy_in_place_of_the_compiled_filter_gives_the_same_walk_and_tracks(run, tmp_path):
    ours = Config()
    config = replace(ours, localiser=replace(ours.localiser, engine="filterpy"))
    process.process(WALK, None, config, tmp_path / "run", lambda text: None)
    one, other = (read(folder) for folder in (run, tmp_path / "run"))
    assert [row["track"] for row in one.tracks] == [row["track"] for row in other.tracks]
    assert len(one.tracks) > 20
    np.testing.assert_allclose(one.poses, other.poses, atol=1e-6)
    for key in ("mean", "covariance", "moving"):
        values = [np.array([row[key] for row in found.tracks]) for found in (one, other)]
        np.testing.assert_allclose(*values, atol=1e-6)


class Estimates(NamedTuple):
    """Rows of trajectory_covariance.csv, and the tracks of obstacles.json."""

    poses: np.ndarray
    tracks: list[dict[str, Any]]


def read(folder: Path) -> Estimates:
    poses = np.loadtxt(folder / "trajectory_covariance.csv", delimiter=",", skiprows=1)
    return Estimates(poses, json.loads((folder / "obstacles.json").read_text())["tracks"])
