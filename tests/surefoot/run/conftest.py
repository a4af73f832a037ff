"""What it means that two runs have the same results."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from surefoot.config.load import load
from surefoot.run import process

TABLES = (
    "trajectory_covariance.csv",
    "trajectory.txt",
    "obstacles.json",
    "innovations.csv",
    "floor.csv",
    "map.pgm",
    "cloud.ply",
    "ground.json",
    "heights.csv",
)


@pytest.fixture
def assert_same() -> Callable[[Path, Path], None]:
    """Asserts that two run folders hold the same estimates and maps, bit for bit."""

    def same(one: Path, other: Path) -> None:
        for name in TABLES:
            assert (one / name).is_file() == (other / name).is_file(), name
            if (one / name).is_file():
                assert (one / name).read_bytes() == (other / name).read_bytes(), name
        if not (one / "terrain.npz").is_file():  # without depth there is no grid
            return
        with np.load(one / "terrain.npz") as grid, np.load(other / "terrain.npz") as again:
            assert set(grid.files) == set(again.files)
            for key in grid.files:
                np.testing.assert_array_equal(grid[key], again[key], err_msg=key)

    return same


@pytest.fixture
def assert_same_offline(
    assert_same: Callable[[Path, Path], None], tmp_path: Path
) -> Callable[[Path], None]:
    """Asserts that the recording of a live run, processed with its settings, gives the same."""

    def same(live: Path) -> None:
        offline = tmp_path / "offline"
        process.process(live, None, load(live / "config.toml"), offline, lambda text: None)
        assert_same(live, offline)

    return same
