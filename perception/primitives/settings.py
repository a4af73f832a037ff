"""User settings: dataclass fields that a configuration file may set, with their documentation.

A configuration dataclass may have other fields too; those are parameters for code, not settings.
"""

from __future__ import annotations

import dataclasses
from typing import Any, TypeVar

T = TypeVar("T")
KEY = "setting"


@dataclasses.dataclass(frozen=True)
class Note:
    """Documentation of one setting.

    Args:
        unit: Its unit, such as "m"; empty for none.
        effect: What it changes, one clause.
        origin: The paper, or "ours" with a reason.
    """

    unit: str
    effect: str
    origin: str


def setting(default: T, unit: str, effect: str, origin: str) -> T:
    """A field that a user may set.

    Args:
        default: Its default value.
        unit: Its unit; empty for none.
        effect: What it changes, one clause.
        origin: The paper, or "ours" with a reason.
    """
    found: Any = dataclasses.field(default=default, metadata={KEY: Note(unit, effect, origin)})
    return found


def note_of(field: dataclasses.Field[Any]) -> Note | None:
    """The documentation of a field; None if it is not a setting."""
    return field.metadata.get(KEY)
