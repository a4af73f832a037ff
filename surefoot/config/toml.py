"""TOML to nested frozen dataclasses and back, to the same bits.

Fields made by `setting` are read and written as tables. Other fields are parameters for code: those that differ from
their defaults are written to the table `internal` under their dotted names, so that a file holds everything a run
depended on, and only there are they read. An unknown key or a value of another type is refused with its place, the
nearest known name and what was expected.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
import types
import typing
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import tomli_w

from perception.primitives import safe_input
from perception.primitives.errors import ConfigError, InputError
from perception.primitives.safe_input import UnreadableError
from perception.primitives.settings import note_of

C = TypeVar("C")
LEAST, MOST = 1e-12, 1e9  # size of a number in a configuration; anything else is a slip
INTERNAL = "internal"
RETIRED = (("floor", "refine", "depth_share"),)
"""Settings of earlier versions, whose recordings must stay readable; floor.distortion took over."""
WORDS = {bool: "true or false", int: "a whole number", float: "a number", str: "a text in quotes"}


def read(kind: type[C], path: Path, base: C | None = None, parts: Collection[str] = ()) -> C:
    """A configuration from a TOML file, of which any part may be left out.

    Args:
        kind: Class of the configuration.
        path: The file.
        base: Values where the file has none; None: the defaults.
        parts: Read only these keys and tables; empty: all.

    Raises:
        InputError: The file is missing or not TOML.
        ConfigError: A key is unknown or a value impossible; the message begins with the file.
    """
    try:
        values = safe_input.toml(safe_input.text(path))
    except UnreadableError as error:
        raise InputError(f"configuration {path} {error}; expected a TOML file") from error
    _drop_retired(values)
    if parts:
        internal = values.get(INTERNAL, {})
        kept = {name: v for name, v in internal.items() if name.partition(".")[0] in parts}
        values = {key: value for key, value in values.items() if key in parts}
        values |= {INTERNAL: kept} if kept else {}
    try:
        return _merge_all(kind, base, values, "")
    except ConfigError as error:
        raise ConfigError(f"configuration {path}: {error}") from error


def _drop_retired(values: dict[str, Any]) -> None:
    """Remove settings that earlier versions wrote beside recordings."""
    for table, part, key in RETIRED:
        inner = values.get(table, {}).get(part)
        if isinstance(inner, dict) and inner.pop(key, None) is not None and not inner:
            del values[table][part]


def parse(kind: type[C], values: Mapping[str, Any], where: str = "") -> C:
    """A configuration from nested tables; `where` is their place, for messages.

    Raises:
        ConfigError: A key is unknown or a value impossible.
    """
    return _merge_all(kind, None, values, where)


def changed(config: C, values: Mapping[str, Any]) -> C:
    """The same configuration with the values of nested tables, settings or not, all at once.

    Raises:
        ConfigError: A key is unknown or a value impossible.
    """
    return _merge(type(config), config, values, "", internal=True)


def override(config: C, assignments: Sequence[str]) -> C:
    """The same configuration with single values changed, all at once: their order does not matter.

    Args:
        config: To begin with.
        assignments: Each "section.key=value"; the value as in TOML, quotes of a text may be left out.

    Raises:
        ConfigError: An assignment is malformed, its key unknown, its value impossible.
    """
    changes: dict[str, Any] = {}
    for assignment in assignments:
        name, sign, text = assignment.partition("=")
        keys = [key.strip() for key in name.split(".")]
        if not sign or not all(keys):
            raise ConfigError(
                f"{assignment!r} sets nothing; expected KEY=VALUE, such as reach.tof.farthest_m=2.5"
            )
        try:
            value: Any = safe_input.toml(f"value = {text}")["value"]
        except UnreadableError:
            value = text.strip()
        for key in reversed(keys):
            value = {key: value}
        changes = _joined(changes, value)
    return _merge(type(config), config, changes, "")


def _joined(tables: dict[str, Any], others: dict[str, Any]) -> dict[str, Any]:
    """Nested tables of both; where both have a value, that of the others."""
    both = {
        key: _joined(tables[key], value)
        for key, value in others.items()
        if isinstance(value, dict) and isinstance(tables.get(key), dict)
    }
    return tables | others | both


def dumps(config: Any) -> str:
    """The complete configuration as TOML; reading it gives an equal one."""
    tables = _settings(config)
    internal = dict(_internal(config, type(config)(), ""))
    return tomli_w.dumps(tables | ({INTERNAL: internal} if internal else {}))


def leaves(config: Any, where: str = "") -> Iterator[tuple[str, dataclasses.Field[Any], Any]]:
    """Dotted name, field and value of everything in a configuration that is no dataclass itself."""
    for item in dataclasses.fields(config):
        value, name = getattr(config, item.name), f"{where}{item.name}"
        if dataclasses.is_dataclass(value):
            yield from leaves(value, f"{name}.")
        else:
            yield name, item, value


def _merge_all(kind: type[C], base: C | None, values: Mapping[str, Any], where: str) -> C:
    """A dataclass from its base (or defaults), tables of settings, and the table `internal`."""
    tables = {key: value for key, value in values.items() if key != INTERNAL}
    config = _merge(kind, base, tables, where)
    internal = values.get(INTERNAL, {})
    if not isinstance(internal, Mapping):
        raise ConfigError(f"{INTERNAL}={internal!r}: expected a table [{INTERNAL}] of values")
    for name, value in internal.items():
        nested: Any = value
        for key in reversed(name.split(".")):
            nested = {key: nested}
        config = _merge(kind, config, nested, "", internal=True)
    return config


def _merge(
    kind: type[C], base: C | None, values: Mapping[str, Any], where: str, internal: bool = False
) -> C:
    """A dataclass from its base (or defaults) and a table of changes."""
    wanted = _fields(kind, internal)
    changes: dict[str, Any] = {}
    for key, value in values.items():
        place = f"{where}.{key}" if where else key
        if key not in wanted:
            near = difflib.get_close_matches(key, wanted, 1, 0.5)
            if near:
                prefix = f"{where}." if where else ""
                raise ConfigError(f"unknown key {place}; did you mean {prefix}{near[0]}?")
            raise ConfigError(f"unknown key {place}; known here: {', '.join(wanted)}")
        inner = wanted[key]
        if dataclasses.is_dataclass(inner):
            if not isinstance(value, Mapping):
                raise ConfigError(f"{place}={value!r}: expected a table [{place}] of values")
            old = _default(kind, key) if base is None else getattr(base, key)
            changes[key] = _merge(typing.cast("type[Any]", inner), old, value, place, internal)
        else:
            changes[key] = _value(inner, value, place)
    try:
        return kind(**changes) if base is None else dataclasses.replace(base, **changes)  # type: ignore[type-var]
    except ConfigError as error:
        text = str(error).removeprefix(f"{where.rpartition('.')[2]}: ")
        raise ConfigError(f"[{where}] {text}" if where else text) from error


def _default(kind: type[Any], key: str) -> Any:
    """The default of a field; None if it has none."""
    for item in dataclasses.fields(kind):
        if item.name == key:
            if item.default_factory is not dataclasses.MISSING:
                return item.default_factory()
            return None if item.default is dataclasses.MISSING else item.default
    return None


def _fields(kind: type[Any], internal: bool) -> dict[str, Any]:
    """Names and types that may be set: settings and tables that hold some; with `internal` all."""
    hints = typing.get_type_hints(kind)
    return {
        item.name: hints[item.name]
        for item in dataclasses.fields(kind)
        if internal or note_of(item) is not None or _has_settings(hints[item.name])
    }


def _has_settings(kind: Any) -> bool:
    """Whether a type is a dataclass with settings in it or below it."""
    return dataclasses.is_dataclass(kind) and bool(_fields(typing.cast("type[Any]", kind), False))


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
        if isinstance(value, float) and not math.isfinite(value):
            raise ConfigError(f"{place}={value}: expected a finite number")
        if value and not LEAST <= abs(value) <= MOST:
            raise ConfigError(
                f"{place}={value}: expected 0 or a number between {LEAST:g} and {MOST:g} in size"
            )
        return float(value)
    if type(value) is wanted:
        if wanted is int and abs(value) > MOST and place != "seed":
            raise ConfigError(f"{place}={value}: expected a whole number below {MOST:g} in size")
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


def _settings(config: Any) -> dict[str, Any]:
    """The settings as nested tables; None is left out."""
    found: dict[str, Any] = {}
    for item in dataclasses.fields(config):
        value = getattr(config, item.name)
        if dataclasses.is_dataclass(value):
            inner = _settings(value)
            found |= {item.name: inner} if inner else {}
        elif note_of(item) is not None and value is not None:
            found[item.name] = _plain(value)
    return found


def _internal(config: Any, base: Any, where: str) -> Iterator[tuple[str, Any]]:
    """Dotted names and values of the fields that are no settings and differ from the defaults."""
    defaults = {name: value for name, _, value in leaves(base, where)}
    for name, item, value in leaves(config, where):
        if note_of(item) is None and value is not None and value != defaults.get(name):
            yield name, _plain(value)


def _plain(value: Any) -> Any:
    return [_plain(one) for one in value] if isinstance(value, tuple) else value
