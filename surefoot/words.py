"""Words of messages."""

from __future__ import annotations


def count_of(count: int, noun: str) -> str:
    """A number of things: "1 frame", "2 frames"."""
    return f"{count} {noun}{'' if count == 1 else 's'}"
