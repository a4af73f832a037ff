"""Hills of the clearance of a map, and the saddles between them that are doorways; see `rooms`.

Source: watershed from the highest clearance downwards; joining by the height of saddles: topological persistence,
Edelsbrunner et al. 2002. The rule for doorways is ours.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import ndimage

WIDEST_M = 0.95  # ours: widest doorway; those of homes have 0.6 to 0.9 m
NARROWER = (
    0.72  # ours: largest ratio of a doorway's clearance to the smaller room's; seeds 100 to 103
)
LEAST_M2 = 1.5  # ours: least area of a room
WALL_M, WALL_SHARE = (
    0.30,
    0.65,
)  # ours: behind a jamb, this share of cells over this length is occupied
THICK_M = 0.30  # ours: largest distance from the middle of a wall to the floor beside it
PIECE_M = 0.60  # ours: free-standing pieces that are shorter are no walls
ASIDE_CELLS = (
    4  # ours: cells by which a wall may be off the line of the jambs, as door leaves hide corners
)
FACING = 0.7  # ours: least cosine between the direction to one jamb and away from the other

Saddles = dict[tuple[int, int], tuple[int, int]]
"""Two hills, the lower number first, and [row, column] of the highest saddle between them."""


def divide(
    clearance: Float[np.ndarray, "rows columns"],
    standing: Bool[np.ndarray, "rows columns"],
    cell_m: float,
) -> tuple[Int[np.ndarray, "rows columns"], Saddles]:
    """Hills of the clearance, from 1, and the highest saddle between each two that meet in a doorway."""
    rows, columns = clearance.shape
    heights = np.pad(clearance, 1).ravel().tolist()  # plain lists: cells are taken one by one
    labels = [0] * len(heights)
    wide = columns + 2
    beside = (-wide - 1, -wide, 1 - wide, -1, 1, wide - 1, wide, wide + 1)
    order = np.argsort(-clearance, axis=None, kind="stable")
    parent, peak = [0], [0.0]
    saddles: Saddles = {}

    def root(hill: int) -> int:
        while parent[hill] != hill:
            hill = parent[hill]
        return hill

    for flat in order[: np.count_nonzero(clearance > 0.0)].tolist():
        row, column = divmod(flat, columns)
        at = (row + 1) * wide + column + 1
        height = heights[at]
        around = [at + step for step in beside if labels[at + step]]
        if not around:
            labels[at] = len(parent)
            parent.append(len(parent))
            peak.append(height)
            continue
        labels[at] = labels[max(around, key=heights.__getitem__)]
        hills = {root(labels[cell]) for cell in around}
        first, *others = sorted(hills, key=lambda hill: (-peak[hill], hill))
        for other in others:
            pair = (min(first, other), max(first, other))
            if pair in saddles:
                continue
            narrow = height < NARROWER * peak[other] and 2.0 * height - cell_m <= WIDEST_M
            if narrow and _in_wall((row, column), clearance, standing, cell_m):
                saddles[pair] = (row, column)
            else:
                parent[other] = first
                saddles = _merged(saddles, other, first, clearance)
    roots = np.array([root(hill) for hill in range(len(parent))])
    numbered = np.array(labels).reshape(rows + 2, wide)[1:-1, 1:-1]
    return roots[numbered], saddles


def walls(
    standing: Bool[np.ndarray, "rows columns"], cell_m: float
) -> Bool[np.ndarray, "rows columns"]:
    """What stands without the pieces that are too short for a wall: free-standing objects, and people."""
    if not standing.any():
        return standing
    pieces, _ = ndimage.label(standing, np.ones((3, 3)))
    long = [
        max(part.stop - part.start for part in box) * cell_m >= PIECE_M
        for box in ndimage.find_objects(pieces)
    ]
    return np.array([False, *long])[pieces]


def _merged(
    saddles: Saddles, one: int, into: int, clearance: Float[np.ndarray, "rows columns"]
) -> Saddles:
    """The saddles after one hill has become part of another; into none (0), its saddles are gone."""
    moved: Saddles = {}
    for (a, b), cell in saddles.items():
        a, b = (into if a == one else a), (into if b == one else b)
        pair = (min(a, b), max(a, b))
        if a == b or 0 in pair:
            continue
        if pair not in moved or clearance[cell] > clearance[moved[pair]]:
            moved[pair] = cell
    return moved


def _in_wall(
    cell: tuple[int, int],
    clearance: Float[np.ndarray, "rows columns"],
    standing: Bool[np.ndarray, "rows columns"],
    cell_m: float,
) -> bool:
    """Whether the line across a saddle goes on in a thin wall behind both of its jambs."""
    jambs = jambs_of(cell, clearance > 0.0, cell_m)
    if jambs is None:
        return False
    apart = float(np.hypot(*(jambs[1] - jambs[0])))
    if apart * cell_m > WIDEST_M + 1e-9:
        return False
    along = (jambs[1] - jambs[0]) / apart
    across = np.array([-along[1], along[0]])
    return all(
        _is_wall(jamb, ahead, across, clearance > 0.0, standing, cell_m)
        for jamb, ahead in ((jambs[0], -along), (jambs[1], along))
    )


def _is_wall(
    jamb: Int[np.ndarray, "2"],
    ahead: Float[np.ndarray, "2"],
    across: Float[np.ndarray, "2"],
    free: Bool[np.ndarray, "rows columns"],
    standing: Bool[np.ndarray, "rows columns"],
    cell_m: float,
) -> bool:
    """Whether cells stand in a row ahead of a jamb, with floor near them on both sides."""
    length, thick = round(WALL_M / cell_m), round(THICK_M / cell_m)
    reach = ASIDE_CELLS + thick
    outward, aside = np.mgrid[:length, -reach : reach + 1]
    cells = jamb + outward[..., None] * ahead + aside[..., None] * across
    places = np.clip(np.rint(cells).astype(int), 0, np.array(standing.shape) - 1)
    rows, columns = np.moveaxis(places, -1, 0)
    shares = standing[rows, columns].mean(axis=0)[thick:-thick]
    best = int(np.argmax(shares))
    floor = free[rows, columns].any(axis=0)
    beside = (
        floor[best : best + thick].any() and floor[best + thick + 1 : best + 2 * thick + 1].any()
    )
    return bool(shares[best] >= WALL_SHARE and beside)


def joined(
    hills: Int[np.ndarray, "rows columns"],
    saddles: Saddles,
    clearance: Float[np.ndarray, "rows columns"],
    cell_m: float,
) -> tuple[Int[np.ndarray, "rows columns"], Saddles]:
    """The same without small hills: each joined with its neighbour across the highest saddle, or left out."""
    hills = hills.copy()
    areas = np.bincount(hills.ravel(), minlength=1) * cell_m**2
    areas[0] = 0.0
    while (small := np.flatnonzero((areas > 0.0) & (areas < LEAST_M2))).size:
        one = int(small[np.argmin(areas[small])])
        beside = [(clearance[cell], pair) for pair, cell in saddles.items() if one in pair]
        into = sum(max(beside)[1]) - one if beside else 0
        hills[hills == one] = into
        areas[into] += areas[one] if into else 0.0
        areas[one] = 0.0
        saddles = _merged(saddles, one, into, clearance)
    return hills, saddles


def jambs_of(
    cell: tuple[int, int], free: Bool[np.ndarray, "rows columns"], cell_m: float
) -> Int[np.ndarray, "2 2"] | None:
    """[row, column] of the nearest cells that are not free, on both sides of a saddle; None without a second."""
    reach = math.ceil(WIDEST_M / cell_m)
    low = np.maximum(np.array(cell) - reach, 0)
    part = free[low[0] : cell[0] + reach + 1, low[1] : cell[1] + reach + 1]
    there = np.argwhere(~part) + low
    away = there - np.array(cell)
    distance = np.hypot(*away.T)
    first = int(np.argmin(distance))
    across = -away @ away[first] / np.maximum(distance * distance[first], 1e-9)
    if not (across > FACING).any():
        return None
    second = int(np.argmin(np.where(across > FACING, distance, np.inf)))
    return there[[first, second]]
