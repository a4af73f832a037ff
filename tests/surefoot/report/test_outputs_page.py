"""docs/outputs.md documents every file that the report lists and every column of the tables."""

from __future__ import annotations

from pathlib import Path

import pytest

from surefoot.report.page import FILES
from surefoot.results.measurement_log import ODOMETRY_HEADER, SIGHTINGS_HEADER
from surefoot.run.run_recorder import COMMAND_HEADER, INNOVATION_HEADER

TEXT = (Path(__file__).parents[3] / "docs" / "outputs.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", [*FILES, "views.json", "clearance.csv"])
def test_every_file_of_a_run_folder_is_documented(name):
    assert Path(name.replace("figures/map.svg", "figures/*.svg")).name in TEXT


@pytest.mark.parametrize(
    "column", [*ODOMETRY_HEADER, *SIGHTINGS_HEADER, *INNOVATION_HEADER, *COMMAND_HEADER]
)
def test_every_column_of_the_tables_is_documented(column):
    assert f"`{column}`" in TEXT
