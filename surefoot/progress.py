"""Lines of progress."""

from __future__ import annotations

from collections.abc import Callable

Say = Callable[[str], None]
"""Takes one line of progress."""


def silent(text: str) -> None:
    """Nobody listens."""
