"""Traces of what was taken to stand and turns out to move: the map is told where it has been.

A mover is known as one only after it has gone a good part of its own width, and one that comes to its turning
point or is seen for moments only looks like a post for as long. What the map holds from that time would
stand there for ever if nobody looks again.

Source: ours.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from perception.floor.segmented_view import MARGIN_M, MOVES
from perception.primitives.obstacle import Obstacle

SURELY = 0.9  # ours: from which what it drew is taken back; posts may look moving for moments
APART = 0.5  # ours: share of its radius that a thing goes between two remembered places


class DynamicTraces:
    """Where each track was seen while it seemed to stand."""

    def __init__(self) -> None:
        self._places: dict[int, list[np.ndarray]] = {}

    def update(
        self, obstacles: Sequence[Obstacle], stamp_s: float
    ) -> tuple[Float[np.ndarray, "k 2"], Float[np.ndarray, "k"]]:
        """Discs that have just turned out to be traces of something that moves.

        Args:
            obstacles: All tracks, world frame; to be told once a frame.
            stamp_s: Of the frame.

        Returns:
            Middles, world frame, m, and radii, m.
        """
        followed = {one.track for one in obstacles}
        self._places = {k: places for k, places in self._places.items() if k in followed}
        discs: list[tuple[np.ndarray, float]] = []
        for one in obstacles:
            if one.moving > SURELY:
                discs += [
                    (place, one.radius_m + MARGIN_M) for place in self._places.pop(one.track, ())
                ]
            elif one.moving <= MOVES and one.seen_s == stamp_s:
                places = self._places.setdefault(one.track, [])
                far = APART * one.radius_m
                if all(np.hypot(*(one.position - place)) >= far for place in places):
                    places.append(one.position.copy())
        return (
            np.array([place for place, _ in discs]).reshape(-1, 2),
            np.array([radius for _, radius in discs]).reshape(-1),
        )
