"""Ground beyond the local map: what the world map remembers.

The local map walks with the robot and forgets what leaves it. A wall longer than the local map would look open at each
end from the other one, and the robot would turn between them for ever. So would chairs and desks. What is small enough
to go away, a person or a chair, is remembered for a minute: then the robot has to look again.

Source: ours.
"""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Bool, Float

from mapping.grid.evidence import OCCUPIED
from mapping.grid.world_map import WorldMap

REACH_M = 5.0  # ours: of memory beyond the local map; walls up to 13 m, a search within 10 ms
LASTING_M = 1.0
"""Ours: what is shorter, a person or a chair, may be gone after `SHORT_S` without a sighting."""
SHORT_S = 60.0  # ours: time to walk past the local map

Ground = tuple[
    Float[np.ndarray, "rows columns"], Bool[np.ndarray, "rows columns"], Float[np.ndarray, "2"]
]
"""Probability, unseen cells, and lower left corner, world frame, m."""
Grown = tuple[Float[np.ndarray, "high wide"], Bool[np.ndarray, "high wide"], Float[np.ndarray, "2"]]
"""The same, larger."""


def with_memory(ground: Ground, cell_m: float, world_map: WorldMap) -> Grown:
    """The local ground, grown to what stands within reach; the world map fills cells that the local map has not seen.

    Not remembered is what moved when it was seen, and what is shorter than `LASTING_M` once it was not seen for `SHORT_S`.

    Args:
        ground: The local map.
        cell_m: Side of a cell.
        world_map: In the same frame; its cells may be of another size.

    Returns:
        The local map within a larger one that ends where nothing remembered stands.
    """
    probability, unknown, origin = ground
    reach = round(REACH_M / cell_m)
    corner = origin - reach * cell_m
    y, x = (cell_m * (np.arange(n + 2 * reach) + 0.5) for n in probability.shape)
    remembered, known, unseen_s = world_map.standing(corner[0] + x, corner[1] + y)
    inside = np.s_[reach:-reach, reach:-reach]
    unseen = np.ones(known.shape, np.bool_)
    unseen[inside] = unknown
    occupied = known & (remembered >= OCCUPIED)
    stays = _lasting(occupied, cell_m) | (unseen_s < SHORT_S)
    filled = known & unseen & (stays | ~occupied)
    needed = filled & occupied
    needed[inside] = True
    part = tuple(slice(*(np.flatnonzero(needed.any(axis))[[0, -1]] + [0, 1])) for axis in (1, 0))
    wide = np.ones(known.shape, probability.dtype)
    wide[inside] = probability
    wide = np.where(filled, remembered, wide)
    low = np.array([part[1].start, part[0].start])
    return wide[part], (unseen & ~filled)[part], corner + low * cell_m


def _lasting(
    occupied: Bool[np.ndarray, "rows columns"], cell_m: float
) -> Bool[np.ndarray, "rows columns"]:
    """The occupied cells of things that are long enough to stay."""
    _, labels, boxes, _ = cv2.connectedComponentsWithStats(occupied.view(np.uint8), connectivity=8)
    sides = boxes[:, [cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]].max(axis=1) * cell_m
    return np.asarray((sides >= LASTING_M)[labels] & occupied)
