"""The page of a batch: unusual runs first, sortable, readable without scripts, nothing from outside."""

from __future__ import annotations

import html.parser
from pathlib import Path
from urllib.parse import unquote, urljoin, urlsplit

import cv2
import numpy as np
import pytest

from surefoot.report.batch_page import page, unusualness

from .browser import CHROMIUM, Browser

ROWS = 40


def row(number: int, **more: object) -> dict[str, object]:
    """A run like the others."""
    small = cv2.imencode(".webp", np.full((72, 96, 3), number, np.uint8))[1].tobytes()
    rng = np.random.default_rng(number)
    return {
        "name": f"walk-{number}", "recording": f"/in/walk-{number}", "status": "done", "reason": "", "picture": small,
        "link": f"walk-{number}/report.html", "frames": 100.0, "skipped": 0.0, "ate_m": 0.03 + 0.001 * rng.normal(),
        "floor_share": 0.9 + 0.01 * rng.normal(), "false_movers": None, "wall_s": 5.0 + number, **more,
    }  # fmt: skip


def batch() -> list[dict[str, object]]:
    """Runs of which 7 has a large error and 9 sees little floor, and two recordings without a run."""
    rows = [row(number) for number in range(ROWS)]
    rows[7]["ate_m"], rows[9]["floor_share"] = 0.06, 0.8
    failed = {"picture": b"", "link": "", "frames": None, "skipped": None, "ate_m": None, "floor_share": None, "wall_s": None}  # fmt: skip
    rows[20] |= failed | {"status": "failed", "reason": "<b>dark</b>"}
    rows[30] |= failed | {"status": "quarantined", "reason": "2 times: SIGSEGV"}
    return rows


class Cells(html.parser.HTMLParser):
    """Text of the table, row by row, and every reference of the page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.rows: list[list[str]] = []
        self.references: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")
        self.references += [value or "" for name, value in attributes if name in ("src", "href")]

    def handle_data(self, data: str) -> None:
        if self.rows and self.rows[-1]:
            self.rows[-1][-1] += data.strip()


def test_recordings_without_a_run_come_first_and_then_the_unusual_ones():
    cells = Cells(page("40 x process", "38 of 40 done", batch()))
    assert [one[0] for one in cells.rows[1:5]] == ["walk-30", "walk-20", "walk-7", "walk-9"]
    assert cells.rows[2][-1] == "<b>dark</b>"
    assert len(cells.rows) == 1 + ROWS
    assert all(one.startswith(("data:", "walk-")) for one in cells.references)
    assert f"walk-{ROWS - 1}/report.html" in cells.references
    assert "false movers" not in cells.rows[0]  # no run has any


@pytest.mark.parametrize("name", ["walk #3", "50% light", "why?", "10:30", 'it\'s "é"', "a&amp;b"])
def test_a_link_leads_to_the_run_whatever_its_name_is(name):
    shown = Cells(page("1 x process", "", [row(1, link=f"{name}/report.html")]))
    address = urljoin("file:///runs/all/index.html", shown.references[-2])
    assert unquote(urlsplit(address).path) == f"/runs/all/{name}/report.html"


def test_how_unusual_a_run_is_counts_robust_standard_deviations_in_the_bad_direction():
    rng = np.random.default_rng(0)
    normal = rng.normal(0.0, 2.0, 4001)
    rows = [{"status": "done", "ate_m": 50.0 + value, "floor_share": 0.9} for value in normal]
    rows += [{"status": "done", "ate_m": 60.0}, {"status": "done", "ate_m": 10.0}, {"status": "done"}]  # fmt: skip
    found = unusualness(rows)
    assert found[-3] == pytest.approx(5.0, abs=0.25)
    assert found[-2] == 0.0
    assert np.isnan(found[-1])
    assert np.mean(np.array(found) > 2.0) == pytest.approx(0.0228, abs=0.01)


def test_nis_is_unusual_where_it_is_far_from_one_either_way():
    rows = [
        {"status": "done", "track_nis": value} for value in (0.8, 0.9, 1.0, 1.1, 1.2, 0.09, 11.0)
    ]
    found = unusualness(rows)
    assert found[5] == pytest.approx(found[6], rel=0.01)  # 1/11 and 11
    assert min(found[5:]) > 3.5 > max(found[:5])


def test_two_runs_are_not_called_usual():
    cells = Cells(page("2 x process", "2 of 2 done", [row(0), row(1)]))
    assert [one[cells.rows[0].index("unusual")] for one in cells.rows[1:]] == ["", ""]


def test_figures_that_hardly_ever_differ_are_unusual_where_they_do():
    rows = [{"status": "done", "false_movers": float(number == 5)} for number in range(100)]
    found = unusualness(rows)
    assert np.argmax(found) == 5
    assert found[5] > 3.5
    assert max(found[:5] + found[6:]) == 0.0


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
def test_a_heading_sorts_by_its_column_in_both_directions_and_unknown_ones_stay_last(tmp_path):
    place = Path(tmp_path) / "index.html"
    place.write_text(page("40 x process", "38 of 40 done", batch()))
    shown = (
        "Array.from(document.querySelectorAll('tbody tr')).map((row) => row.cells[0].textContent)"
    )
    click = "Array.from(document.querySelectorAll('th button')).find((one) => one.textContent === '{}').click()"
    with Browser(tmp_path / "profile") as browser:
        browser.open(place, 1200)
        browser.run(click.format("time, s"))
        down = browser.run(shown)
        browser.run(click.format("time, s"))
        up = browser.run(shown)
        browser.wait("document.images[0].naturalWidth === 96")
        assert [one for one in browser.requests if not one.startswith(("data:", "file:"))] == []
        assert browser.errors == []
    with_time = [f"walk-{number}" for number in range(ROWS) if number not in (20, 30)]
    assert up[:-2] == with_time
    assert down[:-2] == with_time[::-1]
    assert {*up[-2:]} == {*down[-2:]} == {"walk-20", "walk-30"}


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
def test_a_long_name_hides_no_figures(tmp_path):
    rows = batch()
    rows[7]["name"] = rows[20]["name"] = "n" * 200
    place = Path(tmp_path) / "index.html"
    place.write_text(page("40 x process", "38 of 40 done", rows))
    with Browser(tmp_path / "profile") as browser:
        browser.open(place, 1200)
        right = "document.querySelector('thead th:last-child').getBoundingClientRect().right"
        assert browser.run(right) <= 1200
