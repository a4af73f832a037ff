"""What the guard is given by a planner: tracks, and the cells of what stands."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from mapping.grid.evidence import corner_m
from perception.primitives.obstacle import MOVING, Obstacle

TRACK_M = 0.015  # ours: position error of a track


def straight_tracks(tracks: Sequence[Obstacle]) -> list[Obstacle]:
    """Tracks, moving ones extrapolated straight on; field, guard and gaze add their own hypotheses.

    Args:
        tracks: Of the world model.
    """
    return [o.gone_straight() if o.moving >= MOVING else o for o in tracks]


def standing_cells(
    cells: Float[np.ndarray, "n 2"], obstacles: Sequence[Obstacle], cell_m: float
) -> Float[np.ndarray, "m 2"]:
    """Occupied cells outside all moving tracks, which the guard predicts itself.

    Args:
        cells: Middles of occupied cells, m.
        obstacles: Tracks, in the same frame.
        cell_m: Edge of a cell.
    """
    movers = [o for o in obstacles if o.moving >= MOVING]
    places = np.array([o.position for o in movers]).reshape(-1, 2)
    reach = np.array([o.radius_m for o in movers]) + (corner_m(cell_m) + TRACK_M)
    gaps = np.linalg.norm(cells[:, None] - places, axis=2)
    return cells[(gaps > reach).all(axis=1)]
