"""One file per experiment or benchmark, loaded when it is asked for by name."""

from __future__ import annotations

import difflib
import importlib
from collections.abc import Mapping
from typing import Any

from perception.primitives.errors import InputError


def load(kind: str, package: str, files: Mapping[str, str], name: str) -> Any:
    """The value `KIND` of the file that belongs to a name.

    Args:
        kind: "experiment" or "benchmark".
        package: Where the files are.
        files: Name to file.
        name: Which one.

    Raises:
        InputError: No such name; the message has the nearest one.
    """
    if name not in files:
        near = difflib.get_close_matches(name, files, 1)
        hint = f"did you mean {near[0]}?" if near else "known are: " + ", ".join(files)
        raise InputError(f"{kind} {name!r} is unknown; {hint}")
    return getattr(importlib.import_module(f"{package}.{files[name]}"), kind.upper())
