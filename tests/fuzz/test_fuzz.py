"""A short, fixed round of damaged files through every door; `make fuzz` runs as many as one likes."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from campaign import campaign
from doors import DOORS

FEW = {
    "mesh": 3,
    "icl": 15,
    "scene": 40,
    "whole_run": 6,
    "shown_run": 4,
    "session": 20,
    "report": 1,
}
"""Inputs of doors that take long."""


@pytest.mark.parametrize("name", DOORS)
def test_a_damaged_file_is_refused_or_read_and_nothing_else(name, tmp_path):
    found = campaign(DOORS[name], FEW.get(name, 60), 7, tmp_path / "files")
    assert not [f"{one.file}: {one.fault}" for one in found.findings]
    assert found.refused or name in FEW
