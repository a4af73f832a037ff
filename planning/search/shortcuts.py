"""Shortcuts: a lattice path straightened wherever the straight line costs no more, and its corners rounded.

A corner becomes an arc of at least the radius that the gait can walk. Where no such arc fits between its
neighbours, stays clear and can be paid for, the corner is left out if the straight line past it may be
walked, else it stays: there the robot stops and turns on the spot.

Source: seed 003, section 3, "Shortcuts"; what becomes of tight corners is ours.
"""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from . import _segment_kernels as kernels

SLACK = 1e-9
"""Cells by which a shortcut may cost more than what it replaces, for rounding."""

STRAIGHT_RAD = 0.02
"""Bends below this are no corners; chords of an arc turn by ten times as much at most."""


def shortcut(
    path: Float[np.ndarray, "n 2"],
    price: Float[np.ndarray, "rows columns"],
    blocked: Bool[np.ndarray, "rows columns"],
) -> Float[np.ndarray, "m 2"]:
    """Way points left of a path after replacing stretches by straight segments.

    From each way point the farthest later one is taken whose straight segment enters no blocked cell and
    costs no more than the stretch it replaces.

    Args:
        path: (x, y) in cells, cell centres at integers.
        price: Cost per cell of way, 1 + alpha U, at the cell centres.
        blocked: Cells that must not be entered.

    Returns:
        A subsequence of the path with the same ends.
    """
    return path[kernels.shortcut(np.ascontiguousarray(path), price, blocked, SLACK)]


def begun_at(
    path: Float[np.ndarray, "n 2"],
    given: Float[np.ndarray, "2"],
    price: Float[np.ndarray, "rows columns"],
    blocked: Bool[np.ndarray, "rows columns"],
) -> Float[np.ndarray, "m 2"]:
    """The path with its first point moved to the given one, if that lies in its cell.

    Where the straight way from there to the second point is blocked the first one stays between them.

    Args: as for `shortcut`.
    """
    return np.asarray(kernels.begun_at(np.ascontiguousarray(path), given, price, blocked))


def segment_cost(
    begin: Float[np.ndarray, "2"],
    end: Float[np.ndarray, "2"],
    price: Float[np.ndarray, "rows columns"],
    blocked: Bool[np.ndarray, "rows columns"],
) -> float:
    """Line integral of the price along a segment (x, y) in cells; infinite where it enters a blocked cell."""
    ends = np.ascontiguousarray(np.stack([begin, end]))
    return float(kernels.polyline_cost(price, blocked, ends))


def polyline_cost(
    points: Float[np.ndarray, "n 2"],
    price: Float[np.ndarray, "rows columns"],
    blocked: Bool[np.ndarray, "rows columns"],
) -> float:
    """Sum of `segment_cost` over a polyline, in cells."""
    return float(kernels.polyline_cost(price, blocked, np.ascontiguousarray(points)))


def total_turning(points: Float[np.ndarray, "n 2"]) -> float:
    """Sum of the absolute changes of direction along a polyline, rad; repeated points are passed over."""
    steps = np.diff(points, axis=0)
    steps = steps[np.hypot(steps[:, 0], steps[:, 1]) > 1e-12]
    headings = np.arctan2(steps[:, 1], steps[:, 0])
    turns = (np.diff(headings) + np.pi) % (2 * np.pi) - np.pi
    return float(np.abs(turns).sum())


class Rounded(NamedTuple):
    """A way with round corners.

    Args:
        points: (m, 2), (x, y) in cells; arcs as chords that turn by 0.2 rad at most.
        arcs: How many corners became arcs.
        corners: How many stayed corners, for the robot to turn on the spot.
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
    """Replace corners by arcs that a gait with limited turn per step can walk.

    Args:
        points: Way points, (x, y) in cells.
        radius: Of the arcs: at least step length / greatest turn per step, in cells.
        price, blocked: As for `shortcut`.
        allowance: What the whole may cost more than the way points do, in cells; what the shortcuts saved.
    """
    way = _Way(radius, price, blocked, allowance)
    line = way.without_tight_corners(points)
    result, arcs, corners = [line[0]], 0, 0
    for corner, after in itertools.pairwise(line[1:]):
        before = result[-1]
        arc = way.arc(before, corner, after)
        if arc is not None:
            result.extend(arc)
            arcs += 1
        else:
            result.append(corner)
            corners += abs(_turn(before, corner, after)) >= STRAIGHT_RAD
    return Rounded(np.array([*result, line[-1]]), arcs, corners)


class _Way:
    """The ground and what is left of the allowance."""

    def __init__(
        self, radius: float, price: np.ndarray, blocked: np.ndarray, allowance: float
    ) -> None:
        self.radius, self.allowance = radius, allowance
        self._price, self._blocked = price, blocked

    def without_tight_corners(self, points: np.ndarray) -> list[np.ndarray]:
        """The way points but those corners that no arc fits and that can be left out."""
        line = list(points)
        index = 1
        while index < len(line) - 1:
            before, corner, after = line[index - 1 : index + 2]
            tight = _arc(before, corner, after, self.radius) is None
            if tight and self._paid(np.vstack([before, after]), before, corner, after):
                del line[index]
            else:
                index += 1
        return line

    def arc(self, before: np.ndarray, corner: np.ndarray, after: np.ndarray) -> np.ndarray | None:
        """The arc round a corner; None where it does not fit, is not clear, or is too dear."""
        arc = _arc(before, corner, after, self.radius)
        if arc is None or not self._paid(np.vstack([before, arc, after]), before, corner, after):
            return None
        return arc

    def _paid(self, new: np.ndarray, *old: np.ndarray) -> bool:
        more = self._cost(new) - self._cost(np.vstack(old))
        if not more <= self.allowance:  # also where either is blocked
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
    """Points on the arc that touches both segments; None where it does not fit, or nothing turns."""
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
