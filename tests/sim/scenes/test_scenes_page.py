"""The tables of docs/scenes.md are what the reader of scene files takes."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import tomli_w

from perception.primitives.errors import InputError
from sim.scene import Scene
from sim.scenes.scene_file import _KEYS as KEYS
from sim.scenes.scene_file import read_scene

PAGE = Path(__file__).parents[3] / "docs" / "scenes.md"
WHOLE: dict[str, dict[str, Any]] = {
    "": {"extent": [0, 0, 6, 5], "start": [0.6, 2.0, 0], "goals": [[5.4, 2.0]]},
    "box": {"at": [2.0, 4.5], "size": [0.4, 0.3, 0.5]},
    "cylinder": {"at": [3.0, 4.5], "radius": 0.1, "height": 0.4},
    "furniture": {"kind": "armchair", "at": [5.0, 4.0]},
    "model": {"file": "lamp.urdf", "at": [1.0, 4.0]},
    "moving_object": {"from": [3.6, 1.0], "to": [3.6, 3.0], "speed": 0.05},
    "area": {"extent": [1, 1, 2, 2]},
}
"""A scene that has only what is required."""
URDF = (
    '<robot name="lamp"><link name="a"><collision><geometry><box size="0.2 0.2 0.6"/></geometry>'
    '<origin xyz="0 0 0.3"/></collision></link></robot>'
)
WRONG: dict[str, Any] = {"text": 7, "material": "gold/none", "place": [1.0], "list of places": 3}
WRONG |= dict.fromkeys(("number", "whole number", "3 numbers", "4 numbers"), "much")


def rows() -> dict[tuple[str, str], tuple[str, str]]:
    """Type and default of each key of each table."""
    found: dict[tuple[str, str], tuple[str, str]] = {}
    kind = ""
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        heading = re.match(r"`\[\[(\w+)\]\]`", line)
        if heading:
            kind = heading[1]
        elif line.startswith("| `"):
            names, what, _, default, meaning = (c.strip() for c in line.strip("|").split("|"))
            assert meaning
            for name in re.findall(r"`(\w+)`", names):
                assert (kind, name) not in found
                found[kind, name] = what, default
    return found


ROWS = rows()


def scene(folder: Path, table_of: str, changes: dict[str, Any], drop: str = "") -> Scene:
    """A scene that has what is required and one entry of a kind, whose keys are changed."""
    (folder / "lamp.urdf").write_text(URDF)
    table = {k: value for k, value in (WHOLE[table_of] | changes).items() if k != drop}
    content = WHOLE[""] | {"tags": 0, table_of: [table]} if table_of else table
    (folder / "mine.toml").write_text(tomli_w.dumps(content))
    return read_scene(folder / "mine.toml", 0)


def test_the_tables_have_the_keys_that_the_reader_knows():
    assert set(ROWS) == {
        (kind, key) for kind, keys in KEYS.items() for key in keys if kind or key not in KEYS
    }


@pytest.mark.parametrize(("kind", "key"), ROWS)
def test_a_key_has_the_type_and_the_default_of_its_line(tmp_path, kind, key):
    what, default = ROWS[kind, key]
    with pytest.raises(InputError):
        scene(tmp_path, kind, {key: WRONG[what]})
    if default == "required":
        with pytest.raises(InputError):
            scene(tmp_path, kind, {}, drop=key)
        return
    assert key not in WHOLE[kind]
    literal = re.fullmatch(r'`("?)([^`"]+)\1`(, numbered)?', default)
    if literal is None:
        assert default in (
            "the `kind`", "name of the file, numbered", '`"y"` of glTF, else `"z"`', "drawn by the seed",
        )  # fmt: skip
        return
    value = literal[2] if literal[1] else float(literal[2])
    given = int(value) if what == "whole number" else value
    # solids compare by identity, their text by content
    assert repr(scene(tmp_path, kind, {key: given})) == repr(scene(tmp_path, kind, {}))
