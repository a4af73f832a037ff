"""Sources of the documentation. The notebooks are executed by `make docs`, not here."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

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


def test_every_example_that_the_pages_name_exists():
    named = {
        name
        for p in DOCS.rglob("*.md")
        for name in re.findall(r"`(examples/\w+\.py)`", p.read_text(encoding="utf-8"))
    }
    assert len(named) >= 5
    assert [name for name in sorted(named) if not (ROOT / name).is_file()] == []
