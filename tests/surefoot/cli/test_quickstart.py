"""The first result that a user sees: from the package alone, right, and small enough to ship."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from importlib import resources
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from surefoot.cli.main import main
from surefoot.run.run_recorder import bar

SCHEMAS = Path(__file__).resolve().parents[3] / "docs" / "schemas"
PACKAGED = Path(str(resources.files("surefoot"))) / "quickstart"


@pytest.fixture(scope="module")
def shown(
    tmp_path_factory: pytest.TempPathFactory, pages: Callable[..., Any]
) -> tuple[Path, Result]:
    """Run folder and output of the verb."""
    out = tmp_path_factory.mktemp("quickstart") / "run"
    words = ["quickstart", "--out", str(out)]
    with pages():
        return out, CliRunner().invoke(main, words, catch_exceptions=False)


def test_the_recording_in_the_package_is_below_two_megabytes():
    assert sum(p.stat().st_size for p in PACKAGED.rglob("*") if p.is_file()) < 2e6


def test_the_help_names_the_folder_that_is_written_by_default():
    shown = CliRunner().invoke(main, ["quickstart", "--help"]).stdout
    assert str(Path("runs") / "quickstart") in shown
    assert "runs/NAME-N" not in shown


def test_quickstart_processes_every_frame_and_names_a_page_that_exists(shown):
    out, result = shown
    assert result.exit_code == 0
    summary = json.loads((out / "summary.json").read_text())
    assert summary["frames"] > 40
    assert not summary["skipped"]
    named = re.search(r"^open (.*) in a browser$", result.stdout, re.MULTILINE)
    assert named is not None
    assert "<html" in Path(named.group(1)).read_text(encoding="utf-8")


def test_the_line_against_the_truth_agrees_with_the_metrics(shown):
    out, result = shown
    metrics = json.loads((out / "metrics.json").read_text())
    said = re.search(r"position (\d+) mm", result.stdout)
    assert said is not None
    assert float(said.group(1)) == pytest.approx(1e3 * metrics["position_rmse_m"], abs=0.5)
    assert metrics["position_rmse_m"] < 0.02
    assert metrics["floor_tof_angle_deg_median"] < 0.2


@pytest.mark.parametrize("name", ["summary", "obstacles", "metrics", "views"])
def test_the_json_files_of_a_run_follow_their_schemas(shown, name):
    jsonschema = pytest.importorskip("jsonschema")
    schema = json.loads((SCHEMAS / f"{name}.schema.json").read_text(encoding="utf-8"))
    validator = jsonschema.Draft202012Validator(schema)
    content = json.loads((shown[0] / f"{name}.json").read_text(encoding="utf-8"))
    assert [error.message for error in validator.iter_errors(content)] == []
    assert content


def test_a_bar_is_filled_to_its_share_and_never_beyond():
    assert bar(0.5, 4) == "[==  ]"
    assert bar(-1.0, 4) == "[    ]"
    assert bar(2.0, 4) == "[====]"
