"""The built documentation: links lead somewhere, nothing is fetched from outside, questions are answered in two clicks.

`make docs` builds the pages and runs these tests; without the pages they are skipped.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urldefrag, urljoin, urlparse

import pytest

SITE = Path(__file__).resolve().parents[2] / "build" / "docs" / "html"
pytestmark = pytest.mark.skipif(
    not (SITE / "index.html").is_file(), reason="the documentation is not built: make docs"
)
LOADS = {
    "script": "src",
    "img": "src",
    "iframe": "src",
    "source": "src",
    "link": "href",
    "video": "src",
}

QUESTIONS = {
    "floor from my depth image": ("find_floor", "Use your own image in its place"),
    "own planner": ("decide", "--planner", "GoalSeeker"),
    "P12 in floor.csv": ("P12", "rad·m", "second tilt with the height"),
    "why is my recording skipped": ("skipped", "depth image has no valid pixel", "the stamp"),
    "what paper 3 said, what was found": ("the paper", "what we found", "singular at the floor"),
}
"""Words that the page must hold which answers the question."""
CLICKS = {
    "floor from my depth image": "floor from my depth image",
    "own planner": "planner of my own",
    "P12 in floor.csv": "P12",
    "why is my recording skipped": "skipped",
    "what paper 3 said, what was found": "third paper",
}
"""Words of the link that a reader with this question would choose."""


class Page(HTMLParser):
    """Links, ids, loaded files and text of a page."""

    def __init__(self, file: Path) -> None:
        super().__init__()
        self.links: list[tuple[str, str]] = []
        self.ids: set[str] = set()
        self.loads: list[str] = []
        self.text: list[str] = []
        self._link: list[str] | None = None
        self._href = ""
        self.feed(file.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        if "id" in given:
            self.ids.add(given["id"])
        if tag == "a" and "href" in given:
            self._link, self._href = [], given["href"]
        wanted = LOADS.get(tag)
        if (
            wanted
            and wanted in given
            and given.get("rel") not in ("canonical", "search", "next", "prev", "index")
        ):
            self.loads.append(given[wanted])

    def handle_endtag(self, tag: str) -> None:
        if tag == "a" and self._link is not None:
            self.links.append((self._href, " ".join("".join(self._link).split())))
            self._link = None

    def handle_data(self, data: str) -> None:
        self.text.append(data)
        if self._link is not None:
            self._link.append(data)


@cache
def page(name: str) -> Page:
    return Page(SITE / name)


def pages() -> Iterator[str]:
    """Names of all pages but the highlighted sources."""
    for file in sorted(SITE.rglob("*.html")):
        name = file.relative_to(SITE).as_posix()
        if not name.startswith(("_modules", "_static")):
            yield name


def target(name: str, href: str) -> tuple[str, str] | None:
    """Page and anchor of a link; None if it leads outside."""
    if urlparse(href).scheme:
        return None
    path, anchor = urldefrag(urljoin(f"/{name}", href))
    return unquote(path).lstrip("/"), unquote(anchor)


def test_every_internal_link_leads_to_a_page_and_to_its_anchor():
    broken, followed = [], 0
    for name in pages():
        for href, _ in page(name).links:
            found = target(name, href)
            if found is None:
                continue
            followed += 1
            path, anchor = found
            if not (SITE / path).is_file() or (
                anchor and path.endswith(".html") and anchor not in page(path).ids
            ):
                broken.append(f"{name}: {href}")
    assert broken == []
    assert followed > 5000


def test_no_page_loads_anything_from_outside():
    outside = [
        f"{n}: {load}" for n in pages() for load in page(n).loads if re.match(r"(https?:)?//", load)
    ]
    assert outside == []
    for sheet in SITE.rglob("*.css"):
        assert not re.search(
            r"(url\(|@import)\s*['\"]?(https?:)?//", sheet.read_text(encoding="utf-8")
        ), sheet


@pytest.mark.parametrize("question", QUESTIONS)
def test_a_question_is_answered_within_two_clicks(question):
    """The first click by the words that a reader looks for, the second by any link of the page it leads to."""
    clicked = links_of("index.html", CLICKS[question])
    assert clicked, "no link of the index has the words of the question"
    within_two = clicked | {name for first in clicked for name in links_of(first)}
    texts = ("".join(page(name).text) for name in within_two)
    assert any(all(word in text for word in QUESTIONS[question]) for text in texts)


def links_of(name: str, words: str = "") -> set[str]:
    """Pages that the links of a page lead to, if their text has these words."""
    found = (target(name, href) for href, text in page(name).links if words in text)
    return {path for path, _ in filter(None, found) if path.endswith(".html")}


def test_the_search_works_offline_and_knows_the_words_of_the_project():
    text = (SITE / "searchindex.js").read_text(encoding="utf-8")
    index = json.loads(text[text.index("(") + 1 : text.rindex(")")])
    for word in ("calibr", "covari", "panorama", "gaze", "skip"):
        assert any(term.startswith(word) for term in index["terms"]), word
    assert "searchindex.js" in "".join(page("search.html").loads)


def test_equations_are_drawn_by_the_browser_alone():
    text = (SITE / "theory" / "gaze.html").read_text(encoding="utf-8")
    assert text.count("<math") > 20
    assert not [load for load in page("theory/gaze.html").loads if "mathjax" in load.lower()]


def test_every_experiment_has_a_page_in_the_gallery():
    from surefoot.experiments.support.experiment import FILES

    listed = "".join(page("gallery/index.html").text)
    for name in FILES:
        assert (SITE / "gallery" / f"{name}.html").is_file()
        assert name in listed
