"""The outline of a surface: the contour of its seen cells, with its straight sides in place of the ragged ones near them.

A hole within is cut open, away from the robot, so that one polygon without holes says where a foot may stand.

Source: contours after Suzuki and Abe 1985, corners after Douglas and Peucker 1973 (OpenCV); the rest ours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import binary_opening

from .measured import Side
from .seen_cells import CELL_M, SeenCells

MARGIN = 8  # ours: cells added round the raster, which sides may fill
FILLED_M = 0.05  # ours: within this distance inside a side, gaps of the cells are filled
CLEARED_M = 0.06  # ours: within this distance outside a side, stray cells are removed
CLAIMED = 0.5  # ours: a side with a larger share of seen cells beyond it is wrong
OPEN_M, OPEN = 0.3, 0.9
"""Ours: an opening in a side is this wide, a foot's length, and this share of the cells beyond it was seen."""
ROUND_CELLS = 1.0  # ours: largest error of the simplified contour
NEAR_M = 0.035  # ours: a part of the contour belongs to a side if its mean distance is less
SLANT = 0.5  # ours: and if the sine of its angle to the side is less
CORNER_M = 0.12  # ours: sides are prolonged by this at most to meet in a corner
OUTVOTED, SHARED, ALONG = 4, 0.5, math.cos(math.radians(15.0))
"""Ours: a side is dropped beside one of at least `OUTVOTED` times as many images, which covers `SHARED` of its length and
has its direction (cosine `ALONG`)."""
SMALL_M2 = 0.004  # ours: specks and holes below half a foot's width squared
SUBPIXEL = 4  # bits


class Outline:
    """A polygon: corners counterclockwise, and the side that each stretch lies on, -1 if none."""

    def __init__(self, corners: Float[np.ndarray, "n 2"], sides: Int[np.ndarray, "n"]) -> None:
        self.corners, self.sides = corners, sides


def outlines(
    cells: SeenCells, sides: Sequence[Side], body: Float[np.ndarray, "2"]
) -> list[Outline]:
    """Polygons of the seen cells, the largest first; more than one if parts are not connected.

    Args:
        cells: Of the surface.
        sides: Its straight sides.
        body: (x, y) of the robot, m.
    """
    mask, first = cells.mask(MARGIN)
    for low, high, value in ((-FILLED_M, 0.0, 1), (0.0, CLEARED_M, 0)):
        for one in sides:
            _paint(mask, first, one, low, high, value)
    contours, parents = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    found = []
    for number, contour in enumerate(contours):
        if parents[0][number][3] >= 0 or cv2.contourArea(contour) * CELL_M**2 < SMALL_M2:
            continue
        corners = _corners(contour, first)
        if len(corners) < 3:
            continue
        outline = _straightened(corners, list(enumerate(sides)))
        for hole, inner in enumerate(contours):
            if parents[0][hole][3] == number and cv2.contourArea(inner) * CELL_M**2 > SMALL_M2:
                cut = _corners(inner, first)
                if len(cut) >= 3:
                    inside = _straightened(cut[::-1], list(enumerate(sides)))
                    outline = _cut(outline, inside, body)
        if len(outline.corners) >= 3:
            found.append(outline)
    return sorted(found, key=lambda one: -_area(one.corners))


def believed(cells: SeenCells, sides: Sequence[Side]) -> list[Side]:
    """The sides without the parts beyond which the surface was seen to go on.

    A line may be prolonged past the end of its edge, over an opening; only that part is removed. Of two sides so close
    beside each other that cells do not tell them apart, the one that more images showed remains.
    """
    if not sides:
        return []
    mask, first = cells.mask(MARGIN)
    single = [one for one in sides if not any(_outvotes(other, one) for other in sides)]
    return [part for one in single for part in _stretches(mask, first, one)]


def _outvotes(side: Side, other: Side) -> bool:
    """Whether a side runs along most of another, which far fewer images showed."""
    if side.views < OUTVOTED * other.views or float(side.outward @ other.outward) < ALONG:
        return False
    away = float(np.abs(side.across(other.ends)).max())
    runs = np.clip(side.run(other.ends), *side.reach)
    shared = float(np.ptp(runs)) > SHARED * (other.reach[1] - other.reach[0])
    return away < 2.0 * CLEARED_M and shared


def _stretches(mask: np.ndarray, first: Float[np.ndarray, "2"], side: Side) -> list[Side]:
    """The parts of a side: none if cells beyond most of it were seen, else all but its wide openings."""
    low, high = side.reach
    runs = np.arange(low + CELL_M / 2, high, CELL_M)
    outs = np.arange(CELL_M, OPEN_M, CELL_M)
    grid = side.place + runs[:, None, None] * side.along + outs[:, None] * side.outward
    column, row = np.round((grid - first) / CELL_M).astype(int).transpose(2, 0, 1)
    inside = (row >= 0) & (row < mask.shape[0]) & (column >= 0) & (column < mask.shape[1])
    seen = np.zeros(row.shape)
    seen[inside] = mask[row[inside], column[inside]]
    beyond = (outs > CLEARED_M - CELL_M / 2) & (outs < 2.0 * CLEARED_M - CELL_M / 2)
    if not len(runs) or seen[:, beyond].mean() > CLAIMED:
        return []
    kept = ~binary_opening(seen.mean(axis=1) >= OPEN, np.ones(round(OPEN_M / CELL_M), np.bool_))
    turns = np.flatnonzero(np.diff(kept.astype(np.int8), prepend=0, append=0))
    found = []
    for begin, end in turns.reshape(-1, 2).tolist():
        reach = (low + begin * CELL_M, high if end == len(runs) else low + end * CELL_M)
        found.append(replace(side, reach=reach))
    return found


def _paint(
    mask: np.ndarray,
    first: Float[np.ndarray, "2"],
    side: Side,
    low: float,
    high: float,
    value: int,
) -> None:
    """Set a strip along a side, between two distances outwards."""
    a, b = side.ends
    corners = np.array(
        [a + low * side.outward, b + low * side.outward, b + high * side.outward,
         a + high * side.outward]
    )  # fmt: skip
    pixels = np.round((corners - first) / CELL_M * 2**SUBPIXEL).astype(np.int32)
    cv2.fillConvexPoly(mask, pixels, value, cv2.LINE_8, SUBPIXEL)


def _corners(contour: np.ndarray, first: Float[np.ndarray, "2"]) -> Float[np.ndarray, "n 2"]:
    """Simplified contour, counterclockwise."""
    corners = cv2.approxPolyDP(contour, ROUND_CELLS, True)[:, 0] * CELL_M + first
    return corners if _area(corners) > 0.0 else corners[::-1]


def _area(corners: Float[np.ndarray, "n 2"]) -> float:
    """Signed area, positive if counterclockwise."""
    x, y = corners.T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2.0


def _straightened(corners: Float[np.ndarray, "n 2"], sides: Sequence[tuple[int, Side]]) -> Outline:
    """The polygon with its stretches near sides on them."""
    ends = np.roll(corners, -1, axis=0)
    way = ends - corners
    length = np.maximum(np.linalg.norm(way, axis=1), 1e-9)
    owner, best = np.full(len(corners), -1), np.full(len(corners), np.inf)
    for number, side in sides:
        both = np.abs([side.across(corners), side.across(ends)])
        away = np.where(both.max(axis=0) < CLEARED_M, both.mean(axis=0), np.inf)
        run = (side.run(corners) + side.run(ends)) / 2.0
        slant = np.abs(way @ side.outward) / length
        on = (away < NEAR_M) & (slant < SLANT) & (away < best)
        on &= (run > side.reach[0] - NEAR_M) & (run < side.reach[1] + NEAR_M)
        owner[on], best[on] = number, away[on]
    if (owner < 0).all():
        return Outline(corners, owner)
    by_number = dict(sides)
    points, owners = [], []
    for k in range(len(corners)):
        before, after = int(owner[k - 1]), int(owner[k])
        if before == after and after >= 0:
            continue  # within a side
        for point, number in _joint(corners[k], before, after, by_number):
            points.append(point)
            owners.append(number)
    return Outline(np.array(points).reshape(-1, 2), np.array(owners, int))


def _joint(
    corner: Float[np.ndarray, "2"], before: int, after: int, sides: dict[int, Side]
) -> list[tuple[Float[np.ndarray, "2"], int]]:
    """Corners between two stretches, each with the side that follows it."""
    feet = [
        corner - float(sides[k].across(corner)) * sides[k].outward
        for k in (before, after)
        if k >= 0
    ]
    if len(feet) == 2:
        A = np.stack([sides[before].outward, sides[after].outward])
        if abs(np.linalg.det(A)) > SLANT:
            b = np.array([sides[k].outward @ sides[k].place for k in (before, after)])
            meet = np.linalg.solve(A, b)
            if np.linalg.norm(meet - corner) < CORNER_M:
                return [(meet, after)]
        return [(feet[0], -1), (feet[1], after)]
    return [(feet[0] if feet else corner, after)]


def _cut(outer: Outline, hole: Outline, body: Float[np.ndarray, "2"]) -> Outline:
    """A polygon with a hole as one polygon: joined by a slit on the side away from the robot."""
    i = int(np.argmax(np.linalg.norm(hole.corners - body, axis=1)))
    away = hole.corners[i] - body
    away = away / max(float(np.linalg.norm(away)), 1e-9)
    way = outer.corners - hole.corners[i]
    cost = np.linalg.norm(way, axis=1) - 0.5 * way @ away
    j = int(np.argmin(cost))
    corners = np.concatenate(
        [outer.corners[: j + 1], np.roll(hole.corners, -i, axis=0), hole.corners[i : i + 1],
         outer.corners[j:]]
    )  # fmt: skip
    sides = np.concatenate(
        [outer.sides[:j], [-1], np.roll(hole.sides, -i), [-1], outer.sides[j:]]
    )  # fmt: skip
    return Outline(corners, sides)
