"""Sources of the documentation. The notebooks are executed by `make docs`, not here."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from perception.monitoring.status import LOST
from surefoot.recordings import description
from surefoot.run.frame_watch import GAP

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
NOTEBOOKS = [
    p for p in sorted(DOCS.rglob("*.md")) if "file_format: mystnb" in p.read_text(encoding="utf-8")
]
CELL = re.compile(r"```\{code-cell\}\n(.*?)```", re.DOTALL)
REASON = re.compile(r"^\| ((?:`[^`]+`(?:, | or | )?)+)", re.MULTILINE)


def cells(notebook: Path) -> list[str]:
    """The code of each cell, without its options."""
    found = CELL.findall(notebook.read_text(encoding="utf-8"))
    return [re.sub(r"\A(---\n.*?\n---\n|(:.*\n)+)", "", code, flags=re.DOTALL) for code in found]


def test_there_are_five_notebooks_and_the_pages_of_failures_and_of_stairs():
    names = {p.stem for p in NOTEBOOKS}
    assert names == {"floor", "trajectory", "map", "gaze", "planner", "limits", "stairs"}


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda p: p.stem)
def test_the_cells_of_a_notebook_are_python_and_its_pictures_have_words(notebook):
    text = notebook.read_text(encoding="utf-8")
    found = cells(notebook)
    assert len(found) >= 3
    for code in found:
        compile(re.sub(r"^!.*$", "pass", code, flags=re.MULTILINE), notebook.name, "exec")
    assert sum("subplots(" in code for code in found) == text.count("    alt: ")


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda p: p.stem)
def test_a_notebook_needs_nothing_that_the_package_does_not_ship_or_make(notebook):
    code = "\n".join(cells(notebook))
    assert not re.search(r"SUREFOOT_DATA|shared/|https?://|/home/|~/", code)


def test_every_reason_for_a_skipped_frame_in_the_how_to_is_one_that_a_reader_gives():
    readers = "".join(
        p.read_text(encoding="utf-8") for p in (ROOT / "surefoot" / "recordings").glob("*.py")
    )
    section = (
        (DOCS / "howto" / "recording.md")
        .read_text(encoding="utf-8")
        .split("Why is my recording")[1]
    )
    reasons = [word for row in REASON.findall(section) for word in re.findall(r"`([^`]+)`", row)]
    assert len(reasons) >= 10
    assert [reason for reason in reasons if reason not in readers] == []


def test_the_page_of_recordings_shows_every_key_of_a_description(tmp_path):
    page = (DOCS / "recordings.md").read_text(encoding="utf-8")
    block = page.split("```toml\n")[1].split("```")[0]
    (tmp_path / "recording.toml").write_text(block, encoding="utf-8")
    assert description.read_description(tmp_path / "recording.toml").colour_camera is not None
    keys = {key for table in description._KEYS.values() for key in table}
    assert [key for key in sorted(keys) if not re.search(rf"\b{key}\b", block)] == []


def test_the_page_of_faults_has_every_word_of_the_status():
    page = (DOCS / "howto" / "faults.md").read_text(encoding="utf-8")
    code = "".join(
        p.read_text(encoding="utf-8")
        for folder in ("perception", "surefoot/run")
        for p in (ROOT / folder).rglob("*.py")
    )
    words = {LOST, GAP, *re.findall(r'Doubt\("([a-z ]+)"', code)}
    assert len(words) >= 8
    assert [word for word in sorted(words) if f"`{word}`" not in page] == []


def test_every_example_that_the_pages_name_exists():
    named = {
        name
        for p in DOCS.rglob("*.md")
        for name in re.findall(r"`(examples/\w+\.py)`", p.read_text(encoding="utf-8"))
    }
    assert len(named) >= 5
    assert [name for name in sorted(named) if not (ROOT / name).is_file()] == []
