"""Implementations by name, or by `package.module:Class` for a user's own."""

from __future__ import annotations

import difflib
import importlib
import os
import sys
from collections.abc import Mapping
from types import ModuleType
from typing import Any

from .errors import InputError

_GIVEN: dict[str, Any] = {}
"""Classes that a program handed over itself, by reference."""


_FILES: dict[str, str] = {}
"""Source file of every plug-in that was loaded, with its kind and name."""


def reference(found: Any) -> str:
    """`package.module:Class` of a class of the user's own.

    In this process `load` gives back this very class, so that it may also come from a script, a notebook or a
    function.
    """
    name = f"{found.__module__}:{found.__name__}"
    _GIVEN[name] = found
    return name


def name_of(found: str | type) -> str:
    """The name of an implementation, given as such or as a class."""
    return found if isinstance(found, str) else reference(found)


def is_reference(name: str) -> bool:
    """Whether a name has the form `package.module:Class`."""
    module, colon, attribute = name.partition(":")
    dotted = all(part.isidentifier() for part in module.split("."))
    return bool(colon) and dotted and attribute.isidentifier()


def label(name: str) -> str:
    """A name for tables: that of the class, without its module."""
    return name.rpartition(":")[2]


def check(name: str, known: Mapping[str, str], what: str) -> str | None:
    """What is wrong with a name; None if it is known or a reference."""
    if name in known or is_reference(name):
        return None
    near = difflib.get_close_matches(name, known, 1)
    hint = f"did you mean {near[0]!r}? " if near else ""
    choices = ", ".join([*known, "or package.module:Class"])
    return f"{what} {name!r} is unknown; {hint}choose {choices}"


def load(name: str, known: Mapping[str, str], what: str, members: tuple[str, ...] = ()) -> Any:
    """The class or function of that name.

    A reference of the user's is also looked for in the working directory.

    Args:
        name: One of `known`, or `package.module:Class`.
        known: Name to reference.
        what: For messages, such as "planner".
        members: What the class must have.

    Raises:
        InputError: The name is unknown, its module cannot be imported, or the class lacks a member.
    """
    problem = check(name, known, what)
    if problem is not None:
        raise InputError(problem)
    module, _, attribute = known.get(name, name).partition(":")
    found = _GIVEN.get(name)
    if found is None:
        imported = _imported(name, module, what, name not in known)
        found = getattr(imported, attribute, None)
        if found is None:
            raise InputError(f"{what} {name!r}: module {module!r} has no {attribute!r}")
    missing = [member for member in members if not hasattr(found, member)]
    if missing:
        raise InputError(
            f"{what} {name!r} lacks {', '.join(missing)}; see the protocol of a {what}"
        )
    return found


def _imported(name: str, module: str, what: str, own: bool) -> ModuleType:
    """A module; a user's own is also looked for in the working directory."""
    if not own:
        return importlib.import_module(module)
    here = os.getcwd()
    if here not in sys.path:
        sys.path.append(here)
    try:
        found = importlib.import_module(module)
    except ModuleNotFoundError as error:
        raise InputError(
            f"{what} {name!r}: module {module!r} cannot be imported ({error}); "
            "check the name, or run from the folder that holds it"
        ) from error
    except Exception as error:  # a user's module can raise anything
        raise InputError(
            f"{what} {name!r}: its module {module!r} raises {type(error).__name__}: {error}"
        ) from error
    if found.__file__ is not None:
        _FILES[found.__file__] = f"{what} {name!r}"
    return found


def files() -> list[str]:
    """Source files of the plug-ins that were loaded."""
    return sorted(_FILES)


def holds(module: str) -> bool:
    """Whether a plug-in that was loaded lies in a module of that name."""
    found = sys.modules.get(module)
    given = any(name.partition(":")[0] == module for name in _GIVEN)
    return given or (found is not None and getattr(found, "__file__", None) in _FILES)


def fault(error: BaseException) -> str | None:
    """Which plug-in an exception comes from, and where, as one line; None if from none."""
    place, trace = None, error.__traceback__
    while trace is not None:
        file = trace.tb_frame.f_code.co_filename
        if file in _FILES:
            place = f"{_FILES[file]} raises {type(error).__name__}: {error} ({file}, line {trace.tb_lineno})"
        trace = trace.tb_next
    return place
