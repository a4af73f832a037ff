"""Experiments and benchmarks by name: each is one module, imported on demand."""

from __future__ import annotations

import difflib
import importlib
from collections.abc import Mapping
from typing import Any

from perception.primitives.errors import InputError


def load(kind: str, package: str, files: Mapping[str, str], name: str) -> Any:
    """Import the module of a name and return its value `KIND` (EXPERIMENT or BENCHMARK).

    Args:
        kind: "experiment" or "benchmark".
        package: Package of the modules.
        files: Name of each experiment or benchmark, and its module.
        name: The one to load.

    Raises:
        InputError: The name is unknown; the message suggests the nearest one.
    """
    if name not in files:
        near = difflib.get_close_matches(name, files, 1)
        hint = f"did you mean {near[0]}?" if near else "known are: " + ", ".join(files)
        raise InputError(f"{kind} {name!r} is unknown; {hint}")
    return getattr(importlib.import_module(f"{package}.{files[name]}"), kind.upper())
