"""docs/outputs.md documents every file that the report lists and every column of the tables."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import pytest

from mapping.panorama.obstacles import PanoramaGap, PanoramaObstacle
from surefoot.report.page import FILES
from surefoot.results.measurement_log import ODOMETRY_HEADER, SIGHTINGS_HEADER
from surefoot.run.run_recorder import COMMAND_HEADER, INNOVATION_HEADER

TEXT = (Path(__file__).parents[3] / "docs" / "outputs.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", [*FILES, "views.json", "clearance.csv"])
def test_every_file_of_a_run_folder_is_documented(name):
    assert Path(name.replace("figures/map.svg", "figures/*.svg")).name in TEXT


@pytest.mark.parametrize(
    "entry", [*fields(PanoramaObstacle), *fields(PanoramaGap)], ids=lambda f: f.name
)
def test_every_entry_of_an_obstacle_or_gap_of_a_panorama_is_documented(entry):
    assert entry.name.startswith("sigma_") or f"`{entry.name}`" in TEXT


@pytest.mark.parametrize(
    "column", [*ODOMETRY_HEADER, *SIGHTINGS_HEADER, *INNOVATION_HEADER, *COMMAND_HEADER]
)
def test_every_column_of_the_tables_is_documented(column):
    assert f"`{column}`" in TEXT
