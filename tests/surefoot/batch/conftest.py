"""Recordings of the tests of batches."""

from __future__ import annotations

from pathlib import Path

import pytest

from .small import write_floor


@pytest.fixture
def recordings(tmp_path: Path) -> Path:
    """Four recordings in two folders."""
    for name in ("day/a", "day/b", "night/a", "night/c"):
        write_floor(tmp_path / "in" / name)
    return tmp_path / "in"
