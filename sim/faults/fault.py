"""What a fault is."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from perception.primitives.frame import Frame


@runtime_checkable
class Fault(Protocol):
    """Changes the frames of a run while it is active; it sees all of them, so that it knows those before."""

    def apply(self, frame: Frame, active: bool) -> Frame | None:
        """The frame as the stack receives it; None if it never arrives."""
        ...
