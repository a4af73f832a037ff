"""What the feet have just lost sight of: S_m, a counter of steps for each side of the picture.

An obstacle in a lower corner of the picture is about to leave it, and will be beside the feet while the
robot passes it. For as many steps as that takes, that half of the picture is not walked to.

Source: seed 000, section 4.4, eq. (6); one counter for each side is ours, and so is that two do not close the
whole picture: ahead between them is where the robot has just seen floor.
"""

from __future__ import annotations

import math

from perception.primitives.errors import InputError


class Corners:
    """Counts for both sides; lives from step to step."""

    def __init__(self, printed: bool = False) -> None:
        """Nothing lost yet.

        Args:
            printed: One counter, of the side seen last, and both sides may be closed.
        """
        self._printed = printed
        self.steps = (0, 0)
        """S_m of the left and of the right, steps still to go."""

    @property
    def blocked(self) -> tuple[bool, bool]:
        """Whether the left and the right half are closed, p3; with both closed neither is."""
        left, right = (count > 0 for count in self.steps)
        return (False, False) if left and right and not self._printed else (left, right)

    def update(self, seen: tuple[bool, bool], unseen_m: float, step_m: float) -> None:
        """Once per footstep.

        Args:
            seen: Whether an obstacle shows in the lower left and the lower right corner.
            unseen_m: From the body to the nearest floor that it sees (0.16 in the seed); NaN if it sees none.
            step_m: S_F.

        Raises:
            InputError: for a step that leads nowhere.
        """
        if not step_m > 0.0:
            raise InputError(f"corners: step_m={step_m} must be positive")
        fresh = max(0, math.ceil(unseen_m / step_m - 1e-9)) if math.isfinite(unseen_m) else 0
        left, right = (
            fresh if shows else max(0, count - 1)
            for shows, count in zip(seen, self.steps, strict=True)
        )
        if self._printed and any(seen) and not all(seen):  # the counter begins anew, for this side
            left, right = (left, 0) if seen[0] else (0, right)
        self.steps = (left, right)
