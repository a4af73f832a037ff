"""A door through which files of others enter."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Door:
    """One kind of input.

    Args:
        make: Writes good files into an empty folder.
        read: Reads all of them; may raise errors of the project, and nothing else.
        slow: Takes a tenth of a second or more: gets a twentieth of the inputs.
    """

    make: Callable[[Path], object]
    read: Callable[[Path], object]
    slow: bool = False
