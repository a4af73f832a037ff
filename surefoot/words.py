"""Words of messages."""

from __future__ import annotations


def count_of(count: int, noun: str) -> str:
    """A number of things: "1 frame", "2 frames"."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def printable(text: str) -> str:
    """Text that UTF-8 can hold: bytes of a file name that are none are written as `\\udce9`, as the ledger of a batch does."""
    return text.encode(errors="backslashreplace").decode()
