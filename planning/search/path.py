"""A map prepared for the search, and the resulting path.

The curve, costs and clearance of a path are computed on demand; a walking robot needs only the next way point.

Source: seed 003, section 3.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from .shortcuts import Rounded, polyline_cost, rounded


@dataclass(frozen=True)
class Terrain:
    """A map prepared for the search; its methods take world coordinates, its arrays are in cells.

    Args:
        price: 1 + alpha U, cost per cell of path.
        blocked: Cells that the middle of the body cannot enter.
        hard: Solid cells.
        origin: Lower left corner of cell [0, 0], world frame, m.
        cell_m: Side of a cell.
    """

    price: Float[np.ndarray, "rows columns"]
    blocked: Bool[np.ndarray, "rows columns"]
    hard: Bool[np.ndarray, "rows columns"]
    origin: Float[np.ndarray, "2"]
    cell_m: float

    @cached_property
    def solid(self) -> Float[np.ndarray, "k 2"]:
        """Centres of the solid cells, (x, y) in cells."""
        return np.argwhere(self.hard)[:, ::-1].astype(np.float64)

    def to_cells(self, xy: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 2"]:
        """(x, y) in cells, centres at integers, of points in the world, m."""
        return np.asarray((xy - self.origin) / self.cell_m - 0.5)

    def to_world(self, cells: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 2"]:
        """Points in the world, m, of (x, y) in cells."""
        return np.asarray((cells + 0.5) * self.cell_m + self.origin)

    def cost_m(self, points: Float[np.ndarray, "n 2"]) -> float:
        """Length plus weighted potential along a polyline in the world; infinite if it is blocked."""
        return polyline_cost(self.to_cells(points), self.price, self.blocked) * self.cell_m


@dataclass(frozen=True)
class Path:
    """A path over the map.

    Args:
        ground: The map.
        cells: [row, column] of the lattice path before shortcuts.
        line: (x, y) in cells: the lattice path, with start and goal as its ends if they lie in its cells.
        kept: (x, y) in cells: the line after the shortcuts.
        goal: World frame, m.
        turn_radius_m: Of the arcs of the curve.
    """

    ground: Terrain = field(repr=False)
    cells: Int[np.ndarray, "n 2"]
    line: Float[np.ndarray, "p 2"] = field(repr=False)
    kept: Float[np.ndarray, "m 2"] = field(repr=False)
    goal: Float[np.ndarray, "2"]
    turn_radius_m: float

    @cached_property
    def waypoints(self) -> Float[np.ndarray, "m 2"]:
        """(x, y), world frame, m; from the start, or the nearest free node, to the goal, or the edge of the map."""
        return self.ground.to_world(self.kept)

    @property
    def curve(self) -> Float[np.ndarray, "r 2"]:
        """(x, y), world frame, m: the way points with corners rounded for the gait."""
        return self.ground.to_world(self._rounded.points)

    @property
    def corners(self) -> int:
        """Corners of the curve at which the robot turns on the spot."""
        return self._rounded.corners

    @property
    def cost_m(self) -> float:
        """E of the lattice path: length plus alpha times the integrated potential."""
        return lattice_cost(self.cells, self.ground.price) * self.ground.cell_m

    @property
    def length_m(self) -> float:
        """Length of the way points."""
        return float(np.hypot(*np.diff(self.waypoints, axis=0).T).sum())

    @property
    def clearance_m(self) -> float:
        """Least distance of the way points and their segments to the centre of a solid cell; infinite without any."""
        return clearance(self.kept, self.ground.solid) * self.ground.cell_m

    @cached_property
    def _rounded(self) -> Rounded:
        ground, radius = self.ground, self.turn_radius_m / self.ground.cell_m
        saved = self._cost(self.line) - self._cost(self.kept)
        return rounded(self.kept, radius, ground.price, ground.blocked, saved)

    def _cost(self, points: np.ndarray) -> float:
        return polyline_cost(points, self.ground.price, self.ground.blocked)


def lattice_cost(cells: Int[np.ndarray, "n 2"], price: Float[np.ndarray, "rows columns"]) -> float:
    """E of a lattice path in cells: the sum over edges of their length times the mean cost of their ends."""
    prices = price[cells[:, 0], cells[:, 1]]
    lengths = np.hypot(*np.diff(cells, axis=0).T)
    return float(np.sum(lengths * (prices[1:] + prices[:-1]) / 2))


def clearance(points: Float[np.ndarray, "n 2"], solid: Float[np.ndarray, "k 2"]) -> float:
    """Least distance of a polyline to points, in the same unit; infinite without points."""
    if not len(solid):
        return math.inf
    least = math.inf
    for begin, end in itertools.pairwise(points):
        way = end - begin
        share = (solid - begin) @ way / max(float(way @ way), 1e-12)
        foot = begin + np.clip(share, 0.0, 1.0)[:, None] * way
        least = min(least, float(np.hypot(*(solid - foot).T).min()))
    return least
