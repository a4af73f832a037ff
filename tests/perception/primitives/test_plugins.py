"""Implementations by name and by reference."""

from __future__ import annotations

import re

import pytest

from perception.primitives import plugins
from perception.primitives.errors import InputError

KNOWN = {"list": "collections:OrderedDict", "queue": "collections:deque"}


class Own:
    """A class of a user's own."""

    def go(self) -> None:
        """Its one member."""


def test_a_name_gives_its_class_and_so_does_a_reference():
    assert plugins.load("queue", KNOWN, "box").__name__ == "deque"
    assert plugins.load("collections:Counter", KNOWN, "box").__name__ == "Counter"


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("queu", "box 'queu' is unknown; did you mean 'queue'?"),
        ("nothing.here:Own", "module 'nothing.here' cannot be imported"),
        ("collections:Nothing", "module 'collections' has no 'Nothing'"),
        ("collections:Counter:x", "is unknown"),
    ],
)
def test_what_cannot_be_loaded_is_said_in_one_line(name, message):
    with pytest.raises(InputError, match=re.escape(message)) as caught:
        plugins.load(name, KNOWN, "box")
    assert "\n" not in str(caught.value)


def test_a_missing_member_is_named():
    with pytest.raises(InputError, match="lacks jump"):
        plugins.load(plugins.reference(Own), {}, "mover", ("go", "jump"))


def test_a_class_that_no_module_holds_is_found_by_its_reference():
    def made() -> type:
        class Local(Own):
            """Made in a function."""

        return Local

    local = made()
    assert plugins.load(plugins.name_of(local), {}, "mover", ("go",)) is local
    assert plugins.name_of("queue") == "queue"


def test_a_module_that_fails_on_import_is_named(tmp_path, monkeypatch):
    (tmp_path / "faulty_module.py").write_text("raise ValueError('no luck')\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(InputError, match="'faulty_module' raises ValueError: no luck"):
        plugins.load("faulty_module:Own", {}, "mover")


def test_an_error_inside_a_plug_in_is_traced_to_its_line(tmp_path, monkeypatch):
    (tmp_path / "faulty_member.py").write_text(
        "class Own:\n    def go(self):\n        return {}['x']\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    own = plugins.load("faulty_member:Own", {}, "mover", ("go",))()
    with pytest.raises(KeyError) as caught:
        own.go()
    assert "mover 'faulty_member:Own' raises KeyError" in (plugins.fault(caught.value) or "")
    assert "line 3" in (plugins.fault(caught.value) or "")
    with pytest.raises(KeyError) as other:
        _ = {}["x"]
    assert plugins.fault(other.value) is None
