"""A run folder with known numbers for the tests of this folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from surefoot.results.run_folder import RunFolder

from .make_runs import make_run


@pytest.fixture
def run(tmp_path: Path) -> RunFolder:
    """One such run."""
    return make_run(tmp_path / "walk")
