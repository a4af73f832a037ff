"""What was seen of the floor near by, kept for some steps after it left the picture.

S_m of the seed remembers that something stands beside the feet, and on which side. This remembers where
things were seen to touch the floor, until floor is seen there, or for a while; and where floor was seen, so
that nobody steps back or aside to where it never was.

Source: ours; it refines seed 000, section 4.4.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from perception.primitives.errors import ConfigError

SIDE = 64  # slots to each side of the floor's memory; a cell has its numbers modulo this
FLOOR_CELL_M = 0.05  # ours: 3.2 m are remembered, of which 1 m is looked at

Seen = Callable[[Float[np.ndarray, "n 2"]], Bool[np.ndarray, "n"]]
"""Tells at which places (n, 2), world frame, m, floor is seen now."""


@dataclass(frozen=True)
class GroundMemoryConfig:
    """How much is remembered."""

    reach_m: float = 1.2  # ours: farther, half a degree of pitch is 3 cm, and there is time
    memory_s: float = 10.0  # ours: at 0.07 m/s what left the picture is then 0.5 m behind
    cell_m: float = 0.04  # ours: one place each
    floor_memory_s: float = 120.0  # ours: what stands does not come; what moves is the tracks'
    under_m: float = 0.22  # ours: nearer the robot stands, or the picture does not reach
    beside_m: float = 0.50  # ours: farther than three seconds' walk

    def __post_init__(self) -> None:
        for name in (
            "reach_m", "memory_s", "cell_m", "floor_memory_s", "under_m", "beside_m"
        ):  # fmt: skip
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"standing: {name}={value} must be positive and finite")


class GroundMemory:
    """The places, world frame; lives from picture to picture."""

    def __init__(self, config: GroundMemoryConfig) -> None:
        self._config = config
        self._cells: dict[tuple[int, int], tuple[float, float, float]] = {}  # x, y, stamp
        self._known = np.zeros((SIDE, SIDE, 2), np.int64)  # which cell each slot holds
        self._known_s = np.full((SIDE, SIDE), -np.inf)  # when floor was last seen in it

    @property
    def places(self) -> Float[np.ndarray, "n 2"]:
        """Middles of what is remembered, world frame, m, in the order they were first seen."""
        return np.array([(x, y) for x, y, _ in self._cells.values()]).reshape(-1, 2)

    def update(
        self,
        stamp_s: float,
        robot: Float[np.ndarray, "2"],
        contacts: Float[np.ndarray, "n 2"],
        floor_seen: Seen,
    ) -> None:
        """Take in one picture.

        Args:
            stamp_s: Its time.
            robot: Where it was taken, world frame, m.
            contacts: Where things touch the floor in it, world frame, m; NaN and far ones are ignored.
            floor_seen: At which places it shows floor.
        """
        config = self._config
        old = self.places
        if len(old):
            stale = floor_seen(old)
            stale |= stamp_s - np.array([s for _, _, s in self._cells.values()]) > config.memory_s
            keys = [key for key, gone in zip(self._cells, stale, strict=True) if gone]
            for key in keys:
                del self._cells[key]
        near = np.hypot(*(contacts - robot).T) < config.reach_m
        for x, y in contacts[near]:
            key = (math.floor(x / config.cell_m), math.floor(y / config.cell_m))
            self._cells[key] = (float(x), float(y), stamp_s)

        self._see_floor(stamp_s, robot, floor_seen)

    def _see_floor(self, stamp_s: float, robot: Float[np.ndarray, "2"], floor_seen: Seen) -> None:
        cells = self._around(robot, self._config.reach_m)
        seen = cells[floor_seen((cells + 0.5) * FLOOR_CELL_M)]
        slots = seen % SIDE
        self._known[slots[:, 1], slots[:, 0]] = seen
        self._known_s[slots[:, 1], slots[:, 0]] = stamp_s

    def never_seen(self, stamp_s: float, robot: Float[np.ndarray, "2"]) -> Float[np.ndarray, "k 2"]:
        """Middles of cells round the robot, world frame, m, where no floor was seen lately or ever.

        Args:
            stamp_s: Now.
            robot: World frame, m.
        """
        config = self._config
        cells = self._around(robot, config.beside_m)
        middles = (cells + 0.5) * FLOOR_CELL_M
        away = np.hypot(*(middles - robot).T)
        slots = cells % SIDE
        mine = (self._known[slots[:, 1], slots[:, 0]] == cells).all(axis=1)
        fresh = stamp_s - self._known_s[slots[:, 1], slots[:, 0]] <= config.floor_memory_s
        unknown = ~(mine & fresh) & (away > config.under_m) & (away < config.beside_m)
        return np.asarray(middles[unknown])

    @staticmethod
    def _around(robot: Float[np.ndarray, "2"], reach_m: float) -> np.ndarray:
        """Numbers (x, y) of the cells in a square about the robot."""
        reach = min(math.ceil(reach_m / FLOOR_CELL_M), SIDE // 2 - 1)
        span = np.arange(-reach, reach + 1)
        offsets = np.stack(np.meshgrid(span, span), axis=-1).reshape(-1, 2)
        return np.asarray(np.floor(robot / FLOOR_CELL_M).astype(np.int64) + offsets)

    def apart_from(
        self, centres: Float[np.ndarray, "m 2"], radii_m: Float[np.ndarray, "m"]
    ) -> Float[np.ndarray, "k 2"]:
        """The places outside all of these discs: what moves is not standing.

        Args:
            centres: World frame, m.
            radii_m: Of each.
        """
        places = self.places
        free = np.ones(len(places), dtype=bool)
        for centre, radius in zip(centres, radii_m, strict=True):
            free &= np.hypot(*(places - centre).T) > radius
        return places[free]
