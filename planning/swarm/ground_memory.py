"""Memory of the ground nearby, for some steps after it left the picture.

S_m of the paper remembers that an obstacle is beside the feet, and on which side. This memory keeps the contact points of
obstacles with the floor, until floor is seen there or a time has passed, and the cells where floor was seen, so that the
robot steps back or sideways only onto known floor.

Source: ours; it refines Han 2018 (seed 000), section 4.4.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float

# lengths of a DARwIn-OP; they grow with the body
SIDE = 64  # slots to each side of the floor memory; a cell uses its indices modulo this
FLOOR_CELL_M = 0.05  # ours: 3.2 m are stored, of which 1 m is used
REACH_M = 1.2  # ours: farther away half a degree of pitch is 3 cm, and there is time
MEMORY_S = 10.0  # ours: at 0.07 m/s a point that left the picture is then 0.5 m behind
CELL_M = 0.04  # ours: one contact point each
FLOOR_MEMORY_S = 120.0  # ours: static obstacles do not come, moving ones have tracks
UNDER_M = 0.22  # ours: nearer the robot stands, or the picture does not show the floor
BESIDE_M = 0.50  # ours: three seconds of walking

Seen = Callable[[Float[np.ndarray, "n 2"]], Bool[np.ndarray, "n"]]
"""At which points (n, 2), world frame, m, floor is visible."""


class GroundMemory:
    """Contact points and seen floor, world frame.

    Args:
        breadth: Of the robot, see `RobotModel.breadth`.
    """

    def __init__(self, breadth: float = 1.0) -> None:
        self._reach_m, self._under_m = breadth * REACH_M, breadth * UNDER_M
        self._beside_m, self._floor_cell_m = breadth * BESIDE_M, breadth * FLOOR_CELL_M
        self._cells: dict[tuple[int, int], tuple[float, float, float]] = {}  # x, y, stamp
        self._known = np.zeros((SIDE, SIDE, 2), np.int64)  # cell of each slot
        self._known_s = np.full((SIDE, SIDE), -np.inf)  # stamp of the last sight of floor in it

    @property
    def places(self) -> Float[np.ndarray, "n 2"]:
        """Remembered contact points, world frame, m, in the order of their first sight."""
        return np.array([(x, y) for x, y, _ in self._cells.values()]).reshape(-1, 2)

    def update(
        self,
        stamp_s: float,
        robot: Float[np.ndarray, "2"],
        contacts: Float[np.ndarray, "n 2"],
        floor_seen: Seen,
    ) -> None:
        """Update from one picture.

        Args:
            stamp_s: Time of the picture.
            robot: Position of the robot, world frame, m.
            contacts: Contact points of obstacles with the floor, world frame, m; NaN and distant ones are ignored.
            floor_seen: At which points the picture shows floor.
        """
        old = self.places
        if len(old):
            stale = floor_seen(old)
            stale |= stamp_s - np.array([s for _, _, s in self._cells.values()]) > MEMORY_S
            keys = [key for key, gone in zip(self._cells, stale, strict=True) if gone]
            for key in keys:
                del self._cells[key]
        near = np.hypot(*(contacts - robot).T) < self._reach_m
        for x, y in contacts[near]:
            key = (math.floor(x / CELL_M), math.floor(y / CELL_M))
            self._cells[key] = (float(x), float(y), stamp_s)

        self._see_floor(stamp_s, robot, floor_seen)

    def _see_floor(self, stamp_s: float, robot: Float[np.ndarray, "2"], floor_seen: Seen) -> None:
        cells = self._around(robot, self._reach_m)
        seen = cells[floor_seen((cells + 0.5) * self._floor_cell_m)]
        slots = seen % SIDE
        self._known[slots[:, 1], slots[:, 0]] = seen
        self._known_s[slots[:, 1], slots[:, 0]] = stamp_s

    def never_seen(self, stamp_s: float, robot: Float[np.ndarray, "2"]) -> Float[np.ndarray, "k 2"]:
        """Middles of the cells round the robot without recently seen floor, world frame, m.

        Args:
            stamp_s: Present time.
            robot: Position, world frame, m.
        """
        cells = self._around(robot, self._beside_m)
        middles = (cells + 0.5) * self._floor_cell_m
        away = np.hypot(*(middles - robot).T)
        slots = cells % SIDE
        mine = (self._known[slots[:, 1], slots[:, 0]] == cells).all(axis=1)
        fresh = stamp_s - self._known_s[slots[:, 1], slots[:, 0]] <= FLOOR_MEMORY_S
        unknown = ~(mine & fresh) & (away > self._under_m) & (away < self._beside_m)
        return np.asarray(middles[unknown])

    def _around(self, robot: Float[np.ndarray, "2"], reach_m: float) -> np.ndarray:
        """Indices (x, y) of the cells in a square round the robot."""
        reach = min(math.ceil(reach_m / self._floor_cell_m), SIDE // 2 - 1)
        span = np.arange(-reach, reach + 1)
        offsets = np.stack(np.meshgrid(span, span), axis=-1).reshape(-1, 2)
        return np.asarray(np.floor(robot / self._floor_cell_m).astype(np.int64) + offsets)

    def apart_from(
        self, centres: Float[np.ndarray, "m 2"], radii_m: Float[np.ndarray, "m"]
    ) -> Float[np.ndarray, "k 2"]:
        """The contact points outside all of these discs of moving obstacles.

        Args:
            centres: World frame, m.
            radii_m: Of each.
        """
        places = self.places
        free = np.ones(len(places), dtype=bool)
        for centre, radius in zip(centres, radii_m, strict=True):
            free &= np.hypot(*(places - centre).T) > radius
        return places[free]
