"""TOML to nested frozen dataclasses and back, to the same bits.

Every value has a name and a type; what is unknown or of another type is refused with its place, the nearest
known name and what was expected. A value that a part itself refuses is reported with the same place.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
import tomllib
import types
import typing
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import tomli_w

from perception.primitives.errors import ConfigError, InputError

C = TypeVar("C")
WORDS = {bool: "true or false", int: "a whole number", float: "a number", str: "a text in quotes"}


def read(kind: type[C], path: Path, base: C | None = None, parts: Collection[str] = ()) -> C:
    """A configuration from a TOML file, of which any part may be left out.

    Args:
        kind: Of what.
        path: The file.
        base: What holds where the file says nothing; None: the defaults.
        parts: Only these keys and tables of the file count; none: all.

    Raises:
        InputError: The file is missing or not TOML.
        ConfigError: A key is unknown or a value impossible; the message begins with the file.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(
            f"configuration {path} cannot be read: {reason}; expected a TOML file"
        ) from error
    try:
        values = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"configuration {path} is not TOML: {error}") from error
    if parts:
        values = {key: value for key, value in values.items() if key in parts}
    try:
        return _merge(kind, base, values, "")
    except ConfigError as error:
        raise ConfigError(f"configuration {path}: {error}") from error


def parse(kind: type[C], values: Mapping[str, Any], where: str = "") -> C:
    """A configuration from nested tables; `where` is their place, for messages.

    Raises:
        ConfigError: A key is unknown or a value impossible.
    """
    return _merge(kind, None, values, where)


def changed(config: C, values: Mapping[str, Any]) -> C:
    """The same configuration with the values of nested tables, all at once.

    Raises:
        ConfigError: A key is unknown or a value impossible.
    """
    return _merge(type(config), config, values, "")


def override(config: C, assignments: Sequence[str]) -> C:
    """The same configuration with single values changed.

    Args:
        config: To begin with.
        assignments: Each "section.key=value"; the value as in TOML, quotes of a text may be left out.

    Raises:
        ConfigError: An assignment is malformed, its key unknown, its value impossible.
    """
    for assignment in assignments:
        name, sign, text = assignment.partition("=")
        keys = [key.strip() for key in name.split(".")]
        if not sign or not all(keys):
            raise ConfigError(
                f"{assignment!r} sets nothing; expected KEY=VALUE, such as grid.cell_m=0.02"
            )
        try:
            value: Any = tomllib.loads(f"value = {text}")["value"]
        except tomllib.TOMLDecodeError:
            value = text.strip()
        for key in reversed(keys):
            value = {key: value}
        config = _merge(type(config), config, value, "")
    return config


def dumps(config: Any) -> str:
    """The complete configuration as TOML; reading it gives an equal one."""
    return tomli_w.dumps(_plain(config))


def _merge(kind: type[C], base: C | None, values: Mapping[str, Any], where: str) -> C:
    """A dataclass from its base (or defaults) and a table of changes."""
    wanted = _fields(kind)
    changes: dict[str, Any] = {}
    for key, value in values.items():
        place = f"{where}.{key}" if where else key
        if key not in wanted:
            near = difflib.get_close_matches(key, wanted, 1, 0.5)
            hint = f"did you mean {where}{'.' if where else ''}{near[0]}?" if near else ""
            known = "" if near else "known here: " + ", ".join(wanted)
            raise ConfigError(f"unknown key {place}; {hint}{known}")
        inner = wanted[key]
        if dataclasses.is_dataclass(inner):
            if not isinstance(value, Mapping):
                raise ConfigError(f"{place}={value!r}: expected a table [{place}] of values")
            old = _default(kind, key) if base is None else getattr(base, key)
            changes[key] = _merge(typing.cast("type[Any]", inner), old, value, place)
        else:
            changes[key] = _value(inner, value, place)
    try:
        return kind(**changes) if base is None else dataclasses.replace(base, **changes)  # type: ignore[type-var]
    except ConfigError as error:
        text = str(error).removeprefix(f"{where.rpartition('.')[2]}: ")
        raise ConfigError(f"[{where}] {text}" if where else text) from error


def _default(kind: type[Any], key: str) -> Any:
    """What a field holds when nobody says; None if it must be given."""
    for item in dataclasses.fields(kind):
        if item.name == key:
            if item.default_factory is not dataclasses.MISSING:
                return item.default_factory()
            return None if item.default is dataclasses.MISSING else item.default
    return None


def _fields(kind: type[Any]) -> dict[str, Any]:
    hints = typing.get_type_hints(kind)
    return {item.name: hints[item.name] for item in dataclasses.fields(kind)}


def _value(wanted: Any, value: Any, place: str) -> Any:
    """The value as the type that is wanted; a whole number serves as a number, nothing else bends."""
    origin = typing.get_origin(wanted)
    if origin is tuple:
        return _tuple(wanted, value, place)
    if origin in (typing.Union, types.UnionType):
        for choice in typing.get_args(wanted):
            if choice is not type(None):
                return _value(choice, value, place)
    if wanted is float and isinstance(value, (int, float)) and not isinstance(value, bool):
        if not math.isfinite(value):
            raise ConfigError(f"{place}={value}: expected a finite number")
        return float(value)
    if type(value) is wanted:
        return value
    raise ConfigError(f"{place}={value!r}: expected {WORDS.get(wanted, wanted)}")


def _tuple(wanted: Any, value: Any, place: str) -> tuple[Any, ...]:
    if not isinstance(value, (list, tuple)):
        raise ConfigError(f"{place}={value!r}: expected a list in brackets")
    kinds = typing.get_args(wanted)
    if len(kinds) == 2 and kinds[1] is Ellipsis:
        kinds = (kinds[0],) * len(value)
    if len(kinds) != len(value):
        raise ConfigError(f"{place}={list(value)!r}: expected {len(kinds)} values in brackets")
    return tuple(
        _value(kind, item, f"{place}[{i}]")
        for i, (kind, item) in enumerate(zip(kinds, value, strict=True))
    )


def _plain(config: Any) -> Any:
    if dataclasses.is_dataclass(config) and not isinstance(config, type):
        values = {item.name: getattr(config, item.name) for item in dataclasses.fields(config)}
        return {name: _plain(value) for name, value in values.items() if value is not None}
    if isinstance(config, tuple):
        return [_plain(value) for value in config]
    return config
