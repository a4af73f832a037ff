"""The figures in docs/papers.md are those that were measured, and each names its experiment and figure."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from typing import Any

import pytest

from surefoot.experiments.support.experiment import FILES, load

DOCS = Path(__file__).resolve().parents[2] / "docs"


def script() -> Any:
    spec = importlib.util.spec_from_file_location("papers_page", DOCS / "papers.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


PAGE = script()
TEXT = PAGE.PAGE.read_text(encoding="utf-8")
KEPT = json.loads(PAGE.KEPT.read_text(encoding="utf-8"))


def test_every_figure_of_the_page_names_an_experiment_and_one_of_its_figures():
    shown = PAGE.named(TEXT)
    assert len(shown) >= 12
    assert TEXT.count("<!--") == len(PAGE.NUMBER.findall(TEXT))  # no comment that is misspelt
    for identity, figures in shown.items():
        assert identity in FILES
        assert figures == set(KEPT[identity]["figures"]), identity
    assert set(KEPT) == set(shown)


def test_the_page_shows_the_kept_figures():
    assert PAGE.filled(TEXT, KEPT) == TEXT


@pytest.mark.parametrize("identity", KEPT)
def test_what_is_kept_says_when_and_how_it_was_measured(identity):
    one = KEPT[identity]
    assert one["date"] >= "2026-11-23"
    if one["seeds"] is None:  # shown before results were kept
        assert one["date"] <= "2026-11-24"
    else:
        assert one["seeds"] >= 1
        assert one["version"]
    targets = load(identity).targets
    assert targets


def result(**figures: float) -> dict[str, Any]:
    return {"id": "000-E1", "figures": figures, "seeds": 10, "version": "0.1.0"}


def test_a_result_brings_its_figures_into_the_page(tmp_path, monkeypatch):
    page = tmp_path / "papers.md"
    page.write_text(
        "<!--000-E1 share .0%-->15 % and <!--000-E1 off_m .3-->0.1 m; <!--x-1 a .1-->2.0"
    )
    kept = tmp_path / "papers.json"
    kept.write_text('{"x-1": {"figures": {"a": 2.0}}}')
    monkeypatch.setattr(PAGE, "PAGE", page)
    monkeypatch.setattr(PAGE, "KEPT", kept)
    given = tmp_path / "result.json"
    given.write_text(json.dumps(result(share=0.92345, off_m=0.0264, other=1.0)))
    PAGE.main([str(given)])
    assert page.read_text() == (
        "<!--000-E1 share .0%-->92 % and <!--000-E1 off_m .3-->0.026 m; <!--x-1 a .1-->2.0"
    )
    found = json.loads(kept.read_text())["000-E1"]
    assert found["figures"] == {"share": 0.92345, "off_m": 0.0264}
    assert (found["seeds"], found["version"]) == (10, "0.1.0")


def test_a_result_without_a_shown_figure_is_refused(tmp_path):
    with pytest.raises(SystemExit, match="has no off_m"):
        PAGE.taken(result(share=0.9), {"share", "off_m"})
