"""Removal of dynamic traces: map cells of obstacles that were first classified as static and then move.

The tracker classifies an obstacle as moving only after it has travelled a good part of its own width. An
obstacle at its turning point, or seen briefly, looks static for as long. Without correction, the cells
marked in that time would stay occupied until they are seen again.

Source: ours.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from perception.floor.segmented_view import MARGIN_M, MOVES
from perception.primitives.obstacle import Obstacle

CERTAIN = 0.9  # ours: probability of moving to clear cells; static poles exceed a lower one briefly
SPACING = 0.5  # ours: distance between two remembered positions, in radii of the obstacle


class DynamicTraces:
    """Positions at which each track was seen while it was classified as static."""

    def __init__(self) -> None:
        self._positions: dict[int, list[np.ndarray]] = {}

    def update(
        self, obstacles: Sequence[Obstacle], stamp_s: float
    ) -> tuple[Float[np.ndarray, "k 2"], Float[np.ndarray, "k"]]:
        """Discs to clear because their obstacle has just turned out to move.

        Args:
            obstacles: All tracks of the frame, world frame; call once a frame.
            stamp_s: Time of the frame, s.

        Returns:
            Centres, world frame, m, and radii, m.
        """
        active = {one.track for one in obstacles}
        self._positions = {k: places for k, places in self._positions.items() if k in active}
        discs: list[tuple[np.ndarray, float]] = []
        for one in obstacles:
            if one.moving > CERTAIN:
                discs += [
                    (place, one.radius_m + MARGIN_M) for place in self._positions.pop(one.track, ())
                ]
            elif one.moving <= MOVES and one.seen_s == stamp_s:
                places = self._positions.setdefault(one.track, [])
                spacing = SPACING * one.radius_m
                if all(np.hypot(*(one.position - place)) >= spacing for place in places):
                    places.append(one.position.copy())
        return (
            np.array([place for place, _ in discs]).reshape(-1, 2),
            np.array([radius for _, radius in discs]).reshape(-1),
        )
