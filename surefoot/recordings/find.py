"""Recordings below folders."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from .open import holds_recording


def below(place: Path) -> Iterator[Path]:
    """The recordings in a folder or its subfolders, in order; hidden ones, and links to folders, are left out."""
    if holds_recording(place):
        yield place
        return
    try:
        children = sorted(place.iterdir()) if place.is_dir() else []
    except OSError:  # a folder that may not be looked into
        return
    for child in children:
        linked = child.is_symlink() and not holds_recording(child)  # links may go in circles
        if not child.name.startswith(".") and not linked:
            yield from below(child)
