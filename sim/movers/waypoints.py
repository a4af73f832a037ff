"""Movers that walk to places: random ones with pauses, long pauses, or from side to side in a stream."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from ..scene import Place
from .ground import Ground
from .law import Mover, Velocity

PAUSE_S = (0.0, 10.0)  # ours
MINUTE_S = (40.0, 80.0)  # ours: somebody who stands and then walks
PASSING_S = (0.0, 1.0)  # ours: at the end of a stream
PATIENCE_S = (1.0, 4.0)  # ours: waits before somebody in the way, then chooses another place
_SIDE = 0.2  # ours: part of the floor on which a stream turns


class Route:
    """Walks along a way at a speed.

    Args:
        ground: Where it may be.
    """

    def __init__(self, ground: Ground) -> None:
        self._ground = ground
        self._way: list[Place] = []

    def lead(self, at: Place, target: Place) -> None:
        """Choose the way to a target."""
        self._way = self._ground.way(at, target)

    def velocity(self, at: Place, speed_mps: float, tick_s: float) -> Velocity | None:
        """The velocity towards the next corner; None at the end."""
        while self._way and math.dist(at, self._way[0]) < 0.5 * speed_mps * tick_s + 1e-6:
            self._way.pop(0)
        if not self._way:
            return None
        if not self._ground.sees(at, self._way[0]):
            self.lead(at, self._way[-1])
            if not self._way:
                return None
        away = math.dist(at, self._way[0])
        share = min(speed_mps, away / tick_s) / away
        return (self._way[0][0] - at[0]) * share, (self._way[0][1] - at[1]) * share


class Waypoints:
    """Walks to one place after the other and pauses at each.

    Args:
        ground: Where it may be.
        speed_mps: While it walks.
        tick_s: Of the traffic.
        pause_s: Least and greatest pause.
        rng: Draws places and pauses.
        target: Draws the next place; None: anywhere.
        pauses_first: Whether it begins with a pause.
    """

    sidesteps = True

    def __init__(
        self,
        ground: Ground,
        speed_mps: float,
        tick_s: float,
        pause_s: tuple[float, float],
        rng: np.random.Generator,
        target: Callable[[], Place] | None = None,
        pauses_first: bool = False,
    ) -> None:
        self._ground, self._route = ground, Route(ground)
        self._speed_mps, self._tick_s, self._pause_s, self._rng = speed_mps, tick_s, pause_s, rng
        self._target = target or (lambda: ground.place(rng))
        self._waits_until_s: float | None = float(rng.uniform(*pause_s)) if pauses_first else 0.0

    def velocity(
        self, stamp_s: float, me: Mover, movers: Sequence[Mover], robot: Mover | None
    ) -> Velocity:
        """Along the way, or none during a pause."""
        at = (me.x, me.y)
        if self._waits_until_s is not None:
            if stamp_s < self._waits_until_s:
                return 0.0, 0.0
            self._waits_until_s = None
            self._route.lead(at, self._target())
        wanted = self._route.velocity(at, self._speed_mps, self._tick_s)
        if wanted is None:
            self._waits_until_s = stamp_s + float(self._rng.uniform(*self._pause_s))
            return 0.0, 0.0
        return wanted

    def blocked(self, stamp_s: float) -> None:
        """Waits a moment, then chooses another place."""
        self._waits_until_s = stamp_s + float(self._rng.uniform(*PATIENCE_S))


def sides(ground: Ground, along_x: bool, rng: np.random.Generator) -> Callable[[], Place]:
    """Draws places on one side of the floor and on the other in turn."""
    axis = 0 if along_x else 1
    far = bool(rng.integers(2))

    def target() -> Place:
        nonlocal far
        far = not far
        within = ground.extent
        depth = _SIDE * float(within[axis + 2] - within[axis])
        if far:
            within[axis] = within[axis + 2] - depth
        else:
            within[axis + 2] = within[axis] + depth
        return ground.place(rng, within)

    return target
