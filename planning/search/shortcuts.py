"""Shortcuts: straight segments where they cost no more than the lattice path, and rounded corners.

A corner becomes an arc with at least the turning radius of the gait. If no such arc fits between the neighbours of the
corner, is free and within the allowed cost, the corner is removed if the direct segment is free; else it stays, and the
robot stops there and turns on the spot.

Source: seed 003, section 3, "Shortcuts"; the treatment of tight corners is ours.
"""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from . import _segment_kernels as kernels

SLACK = 1e-9
"""Cost in cells by which a shortcut may exceed the part that it replaces, for rounding."""

STRAIGHT_RAD = 0.02
"""Smaller changes of direction are no corners; chords of an arc turn by at most ten times this."""


def shortcut(
    path: Float[np.ndarray, "n 2"],
    price: Float[np.ndarray, "rows columns"],
    blocked: Bool[np.ndarray, "rows columns"],
) -> Float[np.ndarray, "m 2"]:
    """Way points that remain after replacing parts of a path by straight segments.

    From each way point the segment leads to the farthest later one whose segment is free and costs no more than the part
    that it replaces.

    Args:
        path: (x, y) in cells, cell centres at integers.
        price: Cost per cell of path, 1 + alpha U, at the cell centres.
        blocked: Cells that the body cannot enter.

    Returns:
        A subsequence of the path with the same ends.
    """
    return path[kernels.shortcut(np.ascontiguousarray(path), price, blocked, SLACK)]


def start_at(
    path: Float[np.ndarray, "n 2"],
    given: Float[np.ndarray, "2"],
    price: Float[np.ndarray, "rows columns"],
    blocked: Bool[np.ndarray, "rows columns"],
) -> Float[np.ndarray, "m 2"]:
    """The path with its first point moved to the given one, if that lies in the same cell.

    If the segment to the second point is blocked, the first point stays between them.

    Args: as for `shortcut`.
    """
    return np.asarray(kernels.start_at(np.ascontiguousarray(path), given, price, blocked))


def polyline_cost(
    points: Float[np.ndarray, "n 2"],
    price: Float[np.ndarray, "rows columns"],
    blocked: Bool[np.ndarray, "rows columns"],
) -> float:
    """Line integral of the cost along a polyline (x, y) in cells; infinite if it enters a blocked cell."""
    return float(kernels.polyline_cost(price, blocked, np.ascontiguousarray(points)))


def total_turning(points: Float[np.ndarray, "n 2"]) -> float:
    """Sum of the absolute changes of direction along a polyline, rad; repeated points are skipped."""
    steps = np.diff(points, axis=0)
    steps = steps[np.hypot(steps[:, 0], steps[:, 1]) > 1e-12]
    headings = np.arctan2(steps[:, 1], steps[:, 0])
    turns = (np.diff(headings) + np.pi) % (2 * np.pi) - np.pi
    return float(np.abs(turns).sum())


class Rounded(NamedTuple):
    """A path with rounded corners.

    Args:
        points: (m, 2), (x, y) in cells; arcs as chords that turn by at most 0.2 rad.
        arcs: Number of corners that became arcs.
        corners: Number of corners at which the robot turns on the spot.
    """

    points: Float[np.ndarray, "m 2"]
    arcs: int
    corners: int


def rounded(
    points: Float[np.ndarray, "n 2"],
    radius: float,
    price: Float[np.ndarray, "rows columns"],
    blocked: Bool[np.ndarray, "rows columns"],
    allowance: float = 0.0,
) -> Rounded:
    """Replace corners by arcs that a gait with a limited turn per step can follow.

    Args:
        points: Way points, (x, y) in cells.
        radius: Of the arcs, at least step length by largest turn per step, in cells.
        price, blocked: As for `shortcut`.
        allowance: Allowed further cost of the whole path, in cells; usually what the shortcuts saved.
    """
    rounding = _Rounding(radius, price, blocked, allowance)
    line = rounding.without_tight_corners(points)
    result, arcs, corners = [line[0]], 0, 0
    for corner, after in itertools.pairwise(line[1:]):
        before = result[-1]
        arc = rounding.arc(before, corner, after)
        if arc is not None:
            result.extend(arc)
            arcs += 1
        else:
            result.append(corner)
            corners += abs(_turn(before, corner, after)) >= STRAIGHT_RAD
    return Rounded(np.array([*result, line[-1]]), arcs, corners)


class _Rounding:
    """The map and the remaining allowance."""

    def __init__(
        self, radius: float, price: np.ndarray, blocked: np.ndarray, allowance: float
    ) -> None:
        self.radius, self.allowance = radius, allowance
        self._price, self._blocked = price, blocked

    def without_tight_corners(self, points: np.ndarray) -> list[np.ndarray]:
        """The way points without the corners that fit no arc and can be removed."""
        line = list(points)
        index = 1
        while index < len(line) - 1:
            before, corner, after = line[index - 1 : index + 2]
            tight = _arc(before, corner, after, self.radius) is None
            if tight and self._affordable(np.vstack([before, after]), before, corner, after):
                del line[index]
            else:
                index += 1
        return line

    def arc(self, before: np.ndarray, corner: np.ndarray, after: np.ndarray) -> np.ndarray | None:
        """The arc at a corner; None if it does not fit, is blocked, or costs too much."""
        arc = _arc(before, corner, after, self.radius)
        if arc is None or not self._affordable(
            np.vstack([before, arc, after]), before, corner, after
        ):
            return None
        return arc

    def _affordable(self, new: np.ndarray, *old: np.ndarray) -> bool:
        more = self._cost(new) - self._cost(np.vstack(old))
        if not more <= self.allowance:  # also if either is blocked
            return False
        self.allowance -= more
        return True

    def _cost(self, points: np.ndarray) -> float:
        return polyline_cost(points, self._price, self._blocked)


def _turn(before: np.ndarray, corner: np.ndarray, after: np.ndarray) -> float:
    """Change of direction at a corner, rad; left positive."""
    come, leave = corner - before, after - corner
    return math.atan2(float(come[0] * leave[1] - come[1] * leave[0]), float(np.dot(come, leave)))


def _arc(
    before: np.ndarray, corner: np.ndarray, after: np.ndarray, radius: float
) -> np.ndarray | None:
    """Points on the arc tangent to both segments; None if it does not fit or there is no corner."""
    turn = _turn(before, corner, after)
    if abs(turn) < STRAIGHT_RAD:
        return None
    come, leave = corner - before, after - corner
    tangent = radius * math.tan(abs(turn) / 2)
    a, b = float(np.hypot(*come)), float(np.hypot(*leave))
    if tangent > min(a, b):
        return None
    come, begin = come / a, corner - come / a * tangent
    normal = np.array([-come[1], come[0]]) * math.copysign(1.0, turn)
    angles = np.linspace(0.0, abs(turn), math.ceil(abs(turn) / (10 * STRAIGHT_RAD)) + 1)
    return np.asarray(
        begin + radius * (np.sin(angles)[:, None] * come + (1 - np.cos(angles))[:, None] * normal)
    )
