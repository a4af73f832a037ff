"""Obstacles that have just left the picture beside the feet: S_m, a counter of steps for each side.

An obstacle in a lower corner of the picture is about to leave it and is then beside the feet while the robot passes. For
the number of steps that this takes, that half of the picture is closed.

Source: Han 2018 (seed 000), section 4.4, eq. (6), corrected to one counter for each side. Ours: both together close
nothing, since the robot has just seen floor ahead between them.
"""

from __future__ import annotations

import math

from perception.primitives.errors import InputError


class Corners:
    """The counters of both sides."""

    def __init__(self, version: str = "ours") -> None:
        """Both counters at 0.

        Args:
            version: "ours"; "published": both halves may be closed; "printed": also one counter, for the last side.
        """
        self._version = version
        self.steps = (0, 0)
        """S_m of the left and of the right, remaining steps."""

    @property
    def blocked(self) -> tuple[bool, bool]:
        """Whether the left and the right half are closed, p3."""
        left, right = (count > 0 for count in self.steps)
        return (False, False) if left and right and self._version == "ours" else (left, right)

    def update(self, seen: tuple[bool, bool], unseen_m: float, step_m: float) -> None:
        """Update once per footstep.

        Args:
            seen: Whether an obstacle appears in the lower left and in the lower right corner.
            unseen_m: Distance from the body to the nearest visible floor (seed 000: 0.16 m); NaN without any.
            step_m: S_F.

        Raises:
            InputError: The step has no length.
        """
        if not step_m > 0.0:
            raise InputError(f"corners: step_m={step_m} must be positive")
        fresh = max(0, math.ceil(unseen_m / step_m - 1e-9)) if math.isfinite(unseen_m) else 0
        left, right = (
            fresh if shows else max(0, count - 1)
            for shows, count in zip(seen, self.steps, strict=True)
        )
        if (
            self._version == "printed" and any(seen) and not all(seen)
        ):  # the one counter restarts for this side
            left, right = (left, 0) if seen[0] else (0, right)
        self.steps = (left, right)
