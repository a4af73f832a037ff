"""Runs of tests draw no pages, but where a test looks at them."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator

import pytest

from surefoot.report import page

_WRITE = page.write_report


@pytest.fixture(scope="module", autouse=True)
def _no_pages() -> Iterator[None]:
    """Runs draw no report and no replay page, which takes seconds, but within `pages`."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(page, "write_report", lambda run: run.path("report.html"))
        yield


@pytest.fixture(scope="session")
def pages() -> Callable[[], contextlib.AbstractContextManager[None]]:
    """`with pages():` around the runs whose report or replay page a test looks at."""

    @contextlib.contextmanager
    def drawn() -> Iterator[None]:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(page, "write_report", _WRITE)
            yield

    return drawn
