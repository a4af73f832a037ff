"""Implementations by name, or by `package.module:Class` for a user's own."""

from __future__ import annotations

import difflib
import importlib
import os
import sys
from collections.abc import Mapping
from typing import Any

from .errors import InputError

_GIVEN: dict[str, Any] = {}
"""Classes that a program handed over itself, by reference."""


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


def check(name: str, known: Mapping[str, str], what: str) -> str | None:
    """What is wrong with a name; None if it is known or a reference."""
    if name in known or is_reference(name):
        return None
    near = difflib.get_close_matches(name, known, 1)
    hint = f"did you mean {near[0]!r}? " if near else ""
    return f"{what} {name!r} is unknown; {hint}choose {', '.join(known)}, or package.module:Class"


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
    own = name not in known
    module, _, attribute = known.get(name, name).partition(":")
    here = os.getcwd()
    if own and here not in sys.path:
        sys.path.append(here)
    try:
        found = _GIVEN.get(name) or getattr(importlib.import_module(module), attribute)
    except ImportError as error:
        raise InputError(
            f"{what} {name!r}: module {module!r} cannot be imported ({error}); "
            "check the name, or run from the folder that holds it"
        ) from error
    except AttributeError as error:
        raise InputError(f"{what} {name!r}: module {module!r} has no {attribute!r}") from error
    missing = [member for member in members if not hasattr(found, member)]
    if missing:
        raise InputError(
            f"{what} {name!r} lacks {', '.join(missing)}; see the protocol of a {what}"
        )
    return found
