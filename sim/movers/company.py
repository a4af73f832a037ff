"""Movers that walk with another one: behind it, or beside it in a group."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

import numpy as np

from ..scene import Place
from .ground import Ground
from .law import Mover, Velocity
from .waypoints import PATIENCE_S, Route

BEHIND_M = 0.30  # ours: gap to the leader
BESIDE_M = 0.12  # ours: gap in a group
HURRY = 1.3  # ours: greatest speed over its own while it catches up
_TURN_S = 2.0  # ours: a group turns with its leader after that time
_TRAIL_M = 0.05  # ours: between places of the leader that are remembered


class Company:
    """Walks with a leader.

    Args:
        ground: Where it may be.
        speed_mps: Its usual speed.
        tick_s: Of the traffic.
        leader: Index of the leader among the movers.
        beside: 0 behind the leader in its track, 1 and -1 beside it to the left and to the right.
        rng: Draws how long it waits when it is blocked.
    """

    sidesteps = True

    def __init__(
        self,
        ground: Ground,
        speed_mps: float,
        tick_s: float,
        leader: int,
        beside: int,
        rng: np.random.Generator,
    ) -> None:
        self._ground, self._route = ground, Route(ground)
        self._speed_mps, self._tick_s, self._rng = speed_mps, tick_s, rng
        self._leader, self._beside = leader, beside
        self._trail: deque[Place] = deque(maxlen=200)
        self._heading: float | None = None
        self._waits_until_s = 0.0
        self._led_to: Place | None = None

    def velocity(
        self, stamp_s: float, me: Mover, movers: Sequence[Mover], robot: Mover | None
    ) -> Velocity:
        """Towards its place behind or beside the leader."""
        leader = movers[self._leader]
        self._watch(leader)
        if stamp_s < self._waits_until_s:
            return 0.0, 0.0
        slot = self._slot(me, leader)
        away = math.dist((me.x, me.y), slot)
        if away < _TRAIL_M:
            return 0.0, 0.0
        if self._led_to is None or math.dist(slot, self._led_to) > max(_TRAIL_M, away / 5.0):
            self._route.lead((me.x, me.y), slot)
            self._led_to = slot
        most = HURRY * self._speed_mps
        led = math.hypot(leader.vx, leader.vy)
        return self._route.velocity((me.x, me.y), min(most, led + away / 2.0), self._tick_s) or (
            0.0,
            0.0,
        )

    def blocked(self, stamp_s: float) -> None:
        """Waits a moment."""
        self._waits_until_s = stamp_s + float(self._rng.uniform(*PATIENCE_S)) / 4.0

    def _watch(self, leader: Mover) -> None:
        place = (leader.x, leader.y)
        if not self._trail or math.dist(place, self._trail[-1]) >= _TRAIL_M:
            self._trail.append(place)
        if self._heading is None:
            self._heading = leader.heading_rad
        off = math.remainder(leader.heading_rad - self._heading, 2.0 * math.pi)
        self._heading += off * self._tick_s / _TURN_S

    def _slot(self, me: Mover, leader: Mover) -> Place:
        if self._beside:
            side = (self._heading or 0.0) + self._beside * math.pi / 2.0
            apart = me.radius_m + leader.radius_m + BESIDE_M
            place = (leader.x + apart * math.cos(side), leader.y + apart * math.sin(side))
            if self._ground.allows(*place):
                return place
        apart = me.radius_m + leader.radius_m + BEHIND_M
        for place in reversed(self._trail):
            if math.dist(place, (leader.x, leader.y)) >= apart and self._ground.allows(*place):
                return place
        return me.x, me.y
