"""Where things were seen to touch the floor, kept for a few steps after they left the picture.

S_m of the seed remembers that something stands beside the feet, and on which side; this remembers where.
A place is forgotten when floor is seen there, or after a while.

Source: ours; it refines seed 000, section 4.4.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from perception.primitives.errors import ConfigError

Seen = Callable[[Float[np.ndarray, "n 2"]], Bool[np.ndarray, "n"]]
"""Tells at which places (n, 2), world frame, m, floor is seen now."""


@dataclass(frozen=True)
class StandingConfig:
    """How much is remembered."""

    reach_m: float = 1.2  # ours: farther, half a degree of pitch is 3 cm, and there is time
    memory_s: float = 10.0  # ours: at 0.07 m/s what left the picture is then 0.5 m behind
    cell_m: float = 0.04  # ours: one place each

    def __post_init__(self) -> None:
        for name in ("reach_m", "memory_s", "cell_m"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"standing: {name}={value} must be positive and finite")


class Standing:
    """The places, world frame; lives from picture to picture."""

    def __init__(self, config: StandingConfig) -> None:
        self._config = config
        self._cells: dict[tuple[int, int], tuple[float, float, float]] = {}  # x, y, stamp

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
