"""Movers on a line between two places: to and fro, and with stops on the way."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ..scene import MovingObject
from .law import Mover, Velocity

GOES_S, STOPS_S = (2.0, 8.0), (1.0, 6.0)  # ours


class Line:
    """To and fro between the ends of the object's segment; it turns where something is in the way.

    Args:
        one: The object.
        stops: Whether it stops for 1 to 6 s after every 2 to 8 s.
    """

    sidesteps = False

    def __init__(self, one: MovingObject, stops: bool, rng: np.random.Generator) -> None:
        self._start, self._end, self._speed_mps = one.start, one.end, one.speed_mps
        self._stops, self._rng = stops, rng
        self._sign = 1.0 if rng.integers(2) else -1.0
        self._going, self._until_s = True, float(rng.uniform(*GOES_S))

    def velocity(
        self, stamp_s: float, me: Mover, movers: Sequence[Mover], robot: Mover | None
    ) -> Velocity:
        """Along the segment, or none during a stop."""
        if self._stops and stamp_s >= self._until_s:
            self._going = not self._going
            self._until_s = stamp_s + float(
                self._rng.uniform(*(GOES_S if self._going else STOPS_S))
            )
        if not self._going and self._stops:
            return 0.0, 0.0
        (ax, ay), (bx, by) = self._start, self._end
        length = math.hypot(bx - ax, by - ay)
        ux, uy = (bx - ax) / length, (by - ay) / length
        along = (me.x - ax) * ux + (me.y - ay) * uy
        if along >= length:
            self._sign = -1.0
        elif along <= 0.0:
            self._sign = 1.0
        speed = self._sign * self._speed_mps
        return ux * speed, uy * speed

    def blocked(self, stamp_s: float) -> None:
        """Turns round."""
        self._sign = -self._sign
