"""The reference page of all settings is complete and current."""

from __future__ import annotations

from pathlib import Path

from surefoot.config import reference

PAGE = Path(__file__).resolve().parents[3] / "docs" / "settings.md"


def test_every_setting_has_an_effect_and_an_origin():
    rows = reference.rows()
    assert len(rows) > 100
    assert [name for name, _, _, effect, origin in rows if not effect or not origin] == []


def test_settings_with_a_unit_in_their_name_state_that_unit():
    units = {"m": "m", "deg": "deg", "s": "s", "px": "px", "mps": "m/s"}
    wrong = [
        name
        for name, _, unit, _, _ in reference.rows()
        if (suffix := name.rpartition("_")[2]) in units
        and "_per_" not in name
        and unit != units[suffix]
    ]
    assert wrong == []


def test_the_page_in_docs_is_the_generated_one():
    assert PAGE.read_text(encoding="utf-8") == reference.markdown(), (
        "run: surefoot settings --markdown > docs/settings.md"
    )
