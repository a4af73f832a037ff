"""What every replay page must do, for tests of the runs that write one."""

from __future__ import annotations

import json
from pathlib import Path

from .browser import Browser

LARGEST_BYTES = 12e6
PANES = """JSON.stringify(Object.fromEntries([...document.querySelectorAll('#map, #pictures canvas, #plots canvas')].map((one) => {
  const figure = one.closest('figure');
  const title = figure ? figure.querySelector('figcaption').textContent.split(':')[0] : one.closest('section').querySelector('h2').textContent;
  return [title, one.toDataURL()];
})))"""


def go(browser: Browser, moment: int) -> None:
    """Move the slider as a user does, and wait until everything is drawn."""
    browser.run(
        f"(() => {{ const s = document.getElementById('instant'); s.value = {moment};"
        "s.dispatchEvent(new Event('input')); })()"
    )
    browser.wait(f"document.documentElement.dataset.drawn === '{moment}'")


def moved(browser: Browser, page: Path, width: int) -> list[str]:
    """Titles of the panes that change from the first moment to the middle of a page.

    Asserts that the page is small, fits the width, asks for nothing, and reports no error.
    """
    assert page.stat().st_size <= LARGEST_BYTES
    browser.open(page, width)
    browser.wait("document.documentElement.dataset.ready === '1'")
    go(browser, 0)
    before = json.loads(browser.run(PANES))
    go(browser, int(browser.run("document.documentElement.dataset.moments")) // 2)
    after = json.loads(browser.run(PANES))
    assert browser.run("document.documentElement.scrollWidth") <= width
    outside = [url for url in browser.requests if not url.startswith(("file:", "data:", "blob:"))]
    assert outside == []
    assert browser.errors == []
    return [name for name in before if before[name] != after[name]]
