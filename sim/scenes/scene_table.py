"""Checked reading of values from a scene file's tables; errors state file, entry, key and the expected value."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from perception.primitives.errors import InputError

from ..rendering.textures import KINDS, PALETTE

LEAST_M = 0.001  # ours: least size


class TableReader:
    """Reads values from tables.

    Args:
        path: Of the file, for errors.
        example: A complete file, for errors.
    """

    def __init__(self, path: Path, example: str) -> None:
        self.path = path
        self._example = example
        self._entry = ""

    @property
    def where(self) -> str:
        """The file and the current entry."""
        return f"{self.path}: {self._entry}"

    def refusal(self, key: str, value: object, expected: str) -> InputError:
        """The error for an invalid value."""
        return InputError(f"{self.where}{key} = {value!r}; expected {expected}")

    def entries(self, table: Mapping[str, Any], kind: str) -> Iterator[tuple[int, dict[str, Any]]]:
        """Number, from 1, and table of each [[kind]]; errors meanwhile refer to that entry."""
        for number, item in enumerate(table.get(kind, []), 1):
            name = item.get("name", item.get("kind", ""))
            self._entry = f"[[{kind}]] {number}{f' {name!r}' if name else ''}: "
            yield number, item
        self._entry = ""

    def items(self, table: Mapping[str, Any], key: str) -> list[Any]:
        """A list."""
        value = table.get(key, [])
        if not isinstance(value, list):
            raise self.refusal(key, value, "a list")
        return value

    def number(
        self,
        table: Mapping[str, Any],
        key: str,
        default: float | None = None,
        least: float = -math.inf,
        most: float = math.inf,
    ) -> float:
        """A finite number within a range."""
        value = table.get(key, default)
        good = isinstance(value, int | float) and not isinstance(value, bool)
        if not good or not math.isfinite(value):
            raise self.refusal(key, value, "a finite number")
        if not least <= value <= most:
            wanted = f"from {least:g} to {most:g}" if most < math.inf else f"at least {least:g}"
            raise self.refusal(key, value, f"a number, {wanted}")
        return float(value)

    def count(self, table: Mapping[str, Any], key: str, default: int, most: int) -> int:
        """A whole number from 0."""
        value = self.number(table, key, float(default))
        if not (value.is_integer() and 0 <= value <= most):
            raise self.refusal(key, table[key], f"a whole number from 0 to {most}")
        return int(value)

    def numbers(
        self,
        table: Mapping[str, Any],
        key: str,
        count: int,
        least: float = -math.inf,
        most: float = math.inf,
    ) -> tuple[Any, ...]:
        """A list of that many finite numbers within a range."""
        value = table.get(key)
        if not isinstance(value, list) or len(value) != count:
            raise self.refusal(
                key, value, f"a list of {count} numbers; for example\n{self._example}"
            )
        return tuple(self.number({key: v}, key, None, least, most) for v in value)

    def size(self, table: Mapping[str, Any], key: str) -> tuple[float, float, float]:
        """Three positive lengths."""
        x, y, z = self.numbers(table, key, 3)
        if min(x, y, z) < LEAST_M:
            raise self.refusal(key, [x, y, z], f"positive lengths, each at least {LEAST_M:g} m")
        return x, y, z

    def place(self, table: Mapping[str, Any], key: str) -> tuple[float, float]:
        """A point on the floor."""
        x, y = self.numbers(table, key, 2)
        return x, y

    def word(self, table: Mapping[str, Any], key: str, default: str | None = None) -> str:
        """A non-empty text."""
        value = table.get(key, default)
        if not isinstance(value, str) or not value:
            raise self.refusal(key, value, "a text in quotes")
        return value

    def material(self, table: Mapping[str, Any], key: str, default: str) -> str:
        """A known material."""
        value = self.word(table, key, default)
        kind, _, colour = value.partition("/")
        if kind not in KINDS or colour not in PALETTE:
            raise self.refusal(
                key, value, f"kind/colour, of {', '.join(KINDS)} and {', '.join(PALETTE)}"
            )
        return value
