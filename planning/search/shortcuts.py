"""Shortcuts: a lattice path straightened wherever the straight line costs no more.

Source: seed 003, section 3, "Shortcuts".
"""

from __future__ import annotations

import itertools
import math

import numpy as np
from jaxtyping import Bool, Float

from . import _kernels


def shortcut(
    path: Float[np.ndarray, "n 2"],
    price: Float[np.ndarray, "rows columns"],
    blocked: Bool[np.ndarray, "rows columns"],
) -> Float[np.ndarray, "m 2"]:
    """Way points left of a path after replacing stretches by straight segments.

    From each way point the farthest later one is taken whose straight segment has no blocked cell and
    costs no more than the stretch it replaces.

    Args:
        path: (x, y) in cells, cell centres at integers.
        price: Cost per cell of way, 1 + alpha U, at the cell centres.
        blocked: Cells that must not be entered.

    Returns:
        A subsequence of the path with the same ends.
    """
    along = np.zeros(len(path))
    for i in range(1, len(path)):
        along[i] = along[i - 1] + segment_cost(path[i - 1], path[i], price, blocked)
    kept, here = [0], 0
    while here < len(path) - 1:
        for there in range(len(path) - 1, here, -1):
            direct = segment_cost(path[here], path[there], price, blocked)
            if there == here + 1 or direct <= along[there] - along[here] + 1e-9:
                break
        kept.append(there)
        here = there
    return path[kept]


def segment_cost(
    begin: Float[np.ndarray, "2"],
    end: Float[np.ndarray, "2"],
    price: Float[np.ndarray, "rows columns"],
    blocked: Bool[np.ndarray, "rows columns"],
) -> float:
    """Line integral of the price along a segment (x, y) in cells; infinite where it enters a blocked cell."""
    return float(_kernels.segment_cost(price, blocked, begin, end))


def polyline_cost(
    points: Float[np.ndarray, "n 2"],
    price: Float[np.ndarray, "rows columns"],
    blocked: Bool[np.ndarray, "rows columns"],
) -> float:
    """Sum of `segment_cost` over a polyline, in cells."""
    return math.fsum(
        segment_cost(begin, end, price, blocked) for begin, end in itertools.pairwise(points)
    )


def total_turning(points: Float[np.ndarray, "n 2"]) -> float:
    """Sum of the absolute changes of direction along a polyline, rad; repeated points are passed over."""
    steps = np.diff(points, axis=0)
    steps = steps[np.hypot(steps[:, 0], steps[:, 1]) > 1e-12]
    headings = np.arctan2(steps[:, 1], steps[:, 0])
    turns = (np.diff(headings) + np.pi) % (2 * np.pi) - np.pi
    return float(np.abs(turns).sum())


def rounded(
    points: Float[np.ndarray, "n 2"],
    radius: float,
    price: Float[np.ndarray, "rows columns"],
    blocked: Bool[np.ndarray, "rows columns"],
    pieces: int = 4,
) -> Float[np.ndarray, "m 2"]:
    """Replace corners by arcs of a radius, in cells, that a gait with limited turn per step can walk.

    An arc starts and ends at most halfway along its two segments, so a corner between short segments gets
    the largest radius that fits. A corner whose arc would enter a blocked cell stays as it is.

    Args:
        points: Way points, (x, y) in cells.
        radius: At least step length / greatest turn per step, in cells.
        price, blocked: As for `shortcut`.
        pieces: Chords per arc.
    """
    result = [points[0]]
    for before, corner, after in zip(points[:-2], points[1:-1], points[2:], strict=True):
        arc = _arc(before, corner, after, radius, pieces)
        clear = math.isfinite(polyline_cost(np.vstack([result[-1], arc]), price, blocked))
        result.extend(arc if clear else [corner])
    result.append(points[-1])
    return np.array(result)


def _arc(
    before: np.ndarray, corner: np.ndarray, after: np.ndarray, radius: float, pieces: int
) -> np.ndarray:
    """Points on the arc that touches both segments; the corner itself where it hardly turns."""
    come, leave = corner - before, after - corner
    a, b = float(np.hypot(*come)), float(np.hypot(*leave))
    turn = math.atan2(float(come[0] * leave[1] - come[1] * leave[0]), float(np.dot(come, leave)))
    if abs(turn) < 0.02 or abs(turn) > math.radians(170.0):
        return corner[None]
    tangent = min(radius * math.tan(abs(turn) / 2), a / 2, b / 2)
    radius = tangent / math.tan(abs(turn) / 2)
    come, begin = come / a, corner - come / a * tangent
    normal = np.array([-come[1], come[0]]) * math.copysign(1.0, turn)
    angles = np.linspace(0.0, abs(turn), pieces + 1)
    return np.asarray(
        begin + radius * (np.sin(angles)[:, None] * come + (1 - np.cos(angles))[:, None] * normal)
    )
