"""The walk in data/ is what a newcomer tries first: it must open, process, and agree with its truth."""

from __future__ import annotations

from pathlib import Path

import pytest

from surefoot.config.schema import Config
from surefoot.evaluation.evaluate import evaluate
from surefoot.recordings.open import open_recording
from surefoot.results.run_folder import RunFolder
from surefoot.run import process

WALK = Path(__file__).resolve().parents[3] / "data" / "walk"


@pytest.fixture(scope="module")
def metrics(tmp_path_factory: pytest.TempPathFactory) -> dict[str, float]:
    """The shipped walk, processed and held against its truth."""
    out = tmp_path_factory.mktemp("shipped") / "run"
    summary = process.process(WALK, None, Config(), out, lambda text: None)
    assert summary.frames == open_recording(WALK).info.frames
    assert not summary.skipped
    return evaluate(RunFolder.open(out))


def test_the_recording_is_small_enough_to_ship():
    assert sum(p.stat().st_size for p in WALK.rglob("*") if p.is_file()) < 8e6


def test_where_it_says_it_walked_is_where_it_walked(metrics):
    assert metrics["position_rmse_m"] <= 0.05
    assert metrics["heading_rmse_deg"] <= 2.0


def test_its_floor_is_the_floor(metrics):
    assert metrics["floor_tof_angle_deg_median"] <= 0.5
    assert metrics["floor_tof_height_mm_median"] <= 5.0


def test_its_map_agrees_with_the_room(metrics):
    assert metrics["grid_correct_share"] >= 0.95
