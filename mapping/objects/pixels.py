"""Outlines as pixels of about a centimetre: what lies inside, what is left without free cells, and back to corners.

A cell of the map is a whole number of pixels, so that no pixel is partly free.

Source: ours; straight sides after Douglas and Peucker 1973.
"""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from .free_cells import FreeCells, Ring, area

STRAIGHT_M = 0.015  # ours: an outline is straightened by less
LEAST_AREA_M2 = 4e-4  # ours: a column of the cloud; smaller pieces are none


def filled(
    ring: Ring, free: FreeCells
) -> tuple[UInt8[np.ndarray, "rows columns"], Float[np.ndarray, "2"]]:
    """Pixels whose centre lies inside an outline, and the lower left corner of pixel [0, 0]."""
    first, pixel = free.corner(ring.min(axis=0)), free.pixel_m
    size = np.ceil((ring.max(axis=0) - first) / pixel).astype(int) + 1
    x, y = np.meshgrid(np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5)
    return inside(ring, np.stack([x, y], axis=-1) * pixel + first).astype(np.uint8), first


def inside(ring: Ring, places: Float[np.ndarray, "*n 2"]) -> Bool[np.ndarray, "*n"]:
    """Whether places lie inside an outline, by the number of its sides to their right."""
    x, y = places[..., 0], places[..., 1]
    odd = np.zeros(x.shape, np.bool_)
    for (ax, ay), (bx, by) in zip(ring, np.roll(ring, -1, axis=0), strict=True):
        if ay == by:
            continue
        between = (ay > y) != (by > y)
        odd ^= between & (x < (bx - ax) * (y - ay) / (by - ay) + ax)
    return odd


def without_free(
    mask: UInt8[np.ndarray, "rows columns"], first: Float[np.ndarray, "2"], free: FreeCells
) -> list[Ring]:
    """Outlines of pixels without the free cells, largest first; holes are filled unless floor was seen in them."""
    rows, columns = mask.shape
    x, y = np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5)
    over = free.at(np.stack([x, y], axis=-1) * free.pixel_m + first)
    left = np.where(over, 0, mask).astype(np.uint8)
    rings = []
    count, label = cv2.connectedComponents(left, connectivity=4)
    for number in range(1, count):
        piece = np.pad(label == number, 1)
        _, background = cv2.connectedComponents((~piece).astype(np.uint8), connectivity=8)
        holes = ~piece & (background != background[0, 0])
        piece = _opened(piece, holes, np.pad(over, 1))
        ring = _straightened((_border(piece) - 1.0) * free.pixel_m + first, free)
        if area(ring) >= LEAST_AREA_M2:
            rings.append(ring)
    return sorted(rings, key=lambda ring: (-area(ring), *ring[0].tolist()))


def _opened(
    piece: Bool[np.ndarray, "rows columns"],
    holes: Bool[np.ndarray, "rows columns"],
    over: Bool[np.ndarray, "rows columns"],
) -> Bool[np.ndarray, "rows columns"]:
    """Holes filled; one with floor in it is opened to the nearest border by a slit of one pixel instead."""
    piece = piece.copy()
    count, label = cv2.connectedComponents(holes.astype(np.uint8), connectivity=8)
    for number in range(1, count):
        hole = label == number
        if not (hole & over).any():
            piece |= hole
            continue
        row, column = np.argwhere(hole & over)[0]
        hole_rows = np.flatnonzero(hole[:, column])
        hole_columns = np.flatnonzero(hole[row])
        slits = [
            np.s_[row, int(hole_columns.max()) :],
            np.s_[row, : int(hole_columns.min())],
            np.s_[int(hole_rows.max()) :, column],
            np.s_[: int(hole_rows.min()), column],
        ]
        piece[min(slits, key=lambda slit: int(piece[slit].sum()))] = False
    return piece


def _border(piece: Bool[np.ndarray, "rows columns"]) -> Float[np.ndarray, "k 2"]:
    """Corners (column, row) of the border of the largest piece of pixels, counter-clockwise, along their edges."""
    count, label, stats, _ = cv2.connectedComponentsWithStats(
        piece.astype(np.uint8), connectivity=4
    )
    if count < 2:
        return np.zeros((0, 2))
    piece = label == 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    steps: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for row, column in np.argwhere(piece).tolist():
        for beside, start, end in (
            ((row - 1, column), (column, row), (column + 1, row)),
            ((row, column + 1), (column + 1, row), (column + 1, row + 1)),
            ((row + 1, column), (column + 1, row + 1), (column, row + 1)),
            ((row, column - 1), (column, row + 1), (column, row)),
        ):
            if not piece[beside]:
                steps.setdefault(start, []).append(end)
    start = min(steps)
    ring, here, heading = [start], start, (0, 0)
    while True:
        options = steps[here]
        # where two pixels touch at a corner, turn left: the outline does not cross itself
        left = (here[0] - heading[1], here[1] + heading[0])
        there = left if left in options else options[0]
        options.remove(there)
        heading = (there[0] - here[0], there[1] - here[1])
        here = there
        if here == start:
            break
        ring.append(here)
    corners = np.array(ring, np.float64)
    before, after = np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0)
    bends = np.abs(corners - before - (after - corners)).sum(axis=1) > 0
    return corners[bends]


def _straightened(ring: Ring, free: FreeCells) -> Ring:
    """The outline with fewer corners: straight sides close to it that cross no free cell."""
    if len(ring) < 4:
        return ring
    far = int(np.argmax(np.linalg.norm(ring - ring[0], axis=1)))
    closed = np.concatenate([ring, ring[:1]])
    kept = _chain(closed[: far + 1], free)[:-1] + _chain(closed[far:], free)[:-1]
    found = np.array(kept)
    return found if len(found) >= 3 and area(found) > 0.0 else ring


def _chain(line: Float[np.ndarray, "k 2"], free: FreeCells) -> list[Float[np.ndarray, "2"]]:
    if len(line) < 3:
        return list(line)
    a, b = line[0], line[-1]
    step = b - a
    length = float(np.linalg.norm(step))
    off = (
        np.linalg.norm(line - a, axis=1)
        if length < 1e-9
        else np.abs(step[0] * (line - a)[:, 1] - step[1] * (line - a)[:, 0]) / length
    )
    worst = int(np.argmax(off))
    if off[worst] <= STRAIGHT_M and length > 1e-9 and not free.crosses(a, b):
        return [a, b]
    if worst in (0, len(line) - 1):
        worst = len(line) // 2
    return _chain(line[: worst + 1], free)[:-1] + _chain(line[worst:], free)
