"""Movers without a destination: smooth curves, and robots that drive like a unicycle."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from .ground import Ground
from .law import Mover, Velocity

AHEAD_S = 2.5  # ours: how far it looks for a wall
LEAST_AHEAD_M = 0.15  # ours
CURVE_M = 0.6  # ours: typical radius of a curve
SMOOTH_S = 4.0  # ours: time constant of the curvature
TURN_RADPS = 0.8  # ours: on the spot
MANOEUVRE_S = (2.0, 7.0)  # ours: a unicycle keeps speed and turning rate that long
UNICYCLE_RADPS = 0.5  # ours
GAIN_MPS2, GAIN_RADPS2 = 0.10, 1.0  # ours: of a unicycle
_LOOK_RAD = math.radians(50.0)  # ours: to both sides


class Curves:
    """Walks on at an even speed; its curvature changes smoothly, and it steers away from walls.

    The turning rate is an Ornstein-Uhlenbeck process. Source: ours.
    """

    sidesteps = False

    def __init__(
        self, ground: Ground, speed_mps: float, tick_s: float, rng: np.random.Generator
    ) -> None:
        self._ground, self._speed_mps, self._tick_s, self._rng = ground, speed_mps, tick_s, rng
        self._heading = float(rng.uniform(-math.pi, math.pi))
        self._rate = 0.0
        self._spins = 0.0  # to the left or right, on the spot

    def velocity(
        self, stamp_s: float, me: Mover, movers: Sequence[Mover], robot: Mover | None
    ) -> Velocity:
        """Ahead, or none while it turns on the spot."""
        dt, sigma = self._tick_s, self._speed_mps / CURVE_M
        self._rate += -self._rate * dt / SMOOTH_S + sigma * math.sqrt(2.0 * dt / SMOOTH_S) * float(
            self._rng.standard_normal()
        )
        turn = steering(self._ground, me, self._heading, self._speed_mps)
        if self._spins != 0.0:
            self._heading += self._spins * TURN_RADPS * dt
            self._spins = 0.0 if turn == 0.0 else self._spins
            return 0.0, 0.0
        if turn != 0.0:  # the tightest curve that fits
            self._rate = turn * self._speed_mps / (0.4 * CURVE_M)
        self._heading += self._rate * dt
        speed = self._speed_mps
        return speed * math.cos(self._heading), speed * math.sin(self._heading)

    def blocked(self, stamp_s: float) -> None:
        """Turns on the spot until the way is free."""
        self._spins = 1.0 if self._rng.integers(2) else -1.0
        self._heading += self._spins * float(self._rng.uniform(0.5, 2.0))


class Unicycle:
    """Drives at a speed and a turning rate, drawn anew every few seconds, also backwards never; turns before walls."""

    sidesteps = False

    def __init__(
        self, ground: Ground, speed_mps: float, tick_s: float, rng: np.random.Generator
    ) -> None:
        self._ground, self._most_mps, self._tick_s, self._rng = ground, speed_mps, tick_s, rng
        self._heading = float(rng.uniform(-math.pi, math.pi))
        self._speed = self._rate = 0.0
        self._wanted, self._until_s = (speed_mps, 0.0), 0.0
        self._spins = 0.0  # to the left or right, before a wall

    def velocity(
        self, stamp_s: float, me: Mover, movers: Sequence[Mover], robot: Mover | None
    ) -> Velocity:
        """Along its heading; speed and turning rate change gradually."""
        if stamp_s >= self._until_s:
            share = float(self._rng.uniform(-0.25, 1.0))  # a fifth of the time it stands or turns
            speed = self._most_mps * max(0.0, min(1.0, 1.4 * share))
            rate = float(self._rng.uniform(-UNICYCLE_RADPS, UNICYCLE_RADPS))
            self._wanted = (speed, rate)
            self._until_s = stamp_s + float(self._rng.uniform(*MANOEUVRE_S))
        speed, rate = self._wanted
        turn = steering(self._ground, me, self._heading, self._most_mps)
        self._spins = 0.0 if turn == 0.0 else self._spins or turn
        if self._spins != 0.0:
            speed, rate = 0.0, self._spins * TURN_RADPS
        self._speed = _towards(self._speed, speed, GAIN_MPS2 * self._tick_s)
        self._rate = _towards(self._rate, rate, GAIN_RADPS2 * self._tick_s)
        self._heading += self._rate * self._tick_s
        return self._speed * math.cos(self._heading), self._speed * math.sin(self._heading)

    def blocked(self, stamp_s: float) -> None:
        """Stops and turns to a side."""
        self._speed = 0.0
        side = 1.0 if self._rng.integers(2) else -1.0
        self._wanted, self._until_s = (0.0, side * TURN_RADPS), stamp_s + 2.0


def steering(ground: Ground, me: Mover, heading_rad: float, speed_mps: float) -> float:
    """0 if the way ahead is free, else the side on which it is free farther: 1 left, -1 right."""
    reach = max(LEAST_AHEAD_M, AHEAD_S * speed_mps)
    if _free_m(ground, me, heading_rad, reach) >= reach:
        return 0.0
    left = _free_m(ground, me, heading_rad + _LOOK_RAD, 2.0 * reach)
    right = _free_m(ground, me, heading_rad - _LOOK_RAD, 2.0 * reach)
    return 1.0 if left >= right else -1.0


def _free_m(ground: Ground, me: Mover, heading_rad: float, reach_m: float) -> float:
    """How far the way in a direction is free, up to a reach, m."""
    c, s = math.cos(heading_rad), math.sin(heading_rad)
    steps = math.ceil(reach_m / 0.05)
    for k in range(1, steps + 1):
        away = reach_m * k / steps
        if not ground.allows(me.x + c * away, me.y + s * away):
            return away - reach_m / steps
    return reach_m


def _towards(value: float, wanted: float, most: float) -> float:
    return value + max(-most, min(most, wanted - value))
