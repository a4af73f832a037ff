"""The world map: the occupancy of everything a run saw, on a fixed grid that grows.

It applies the evidence of the terrain map on a lattice whose cell corners are multiples of the cell size in
the world frame, so that maps of several runs align. Each cell also keeps the height of the highest static
obstacle point (ours).

Source: seed 003, section 3 (evidence).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from perception.primitives.errors import ConfigError, InputError

from . import _evidence_kernels
from .evidence import EvidenceConfig, age, kinds_of, mark_moving, probability_of, update_cells

GROWTH = 64  # cells by which the map grows at least, so that it rarely does


@dataclass(frozen=True)
class WorldMapConfig:
    """Resolution and largest extent of the world map."""

    cell_m: float = 0.05  # ours: as the terrain map; side of a cell of the world map
    most_cells: int = 16_000_000  # ours: 200 m x 200 m of 5 cm; points beyond are dropped
    tail_share: float = 0.1  # ours: in place of the terrain map's

    def __post_init__(self) -> None:
        if not self.cell_m > 0.0:
            raise ConfigError(f"world map: cell_m={self.cell_m} must be positive")
        if self.most_cells < GROWTH * GROWTH:
            raise ConfigError(
                f"world map: most_cells={self.most_cells} must be at least {GROWTH * GROWTH}"
            )


class WorldMap:
    """Occupancy probability, time of the last update and obstacle height of every cell ever seen."""

    def __init__(
        self, config: WorldMapConfig | None = None, evidence: EvidenceConfig | None = None
    ) -> None:
        """An empty map of no cells.

        Args:
            config: Resolution and extent.
            evidence: Of the terrain map; only its tail share is replaced.
        """
        self.config = config or WorldMapConfig()
        self._evidence = replace(evidence or EvidenceConfig(), tail_share=self.config.tail_share)
        self.dropped = 0  # points beyond the largest extent
        self._first = np.zeros(2, np.int64)  # lattice cell (x, y) of cell [0, 0]
        self._log_odds = np.zeros((0, 0), np.float32)
        self._updated_s = np.zeros((0, 0))
        self._moving = np.zeros((0, 0), np.bool_)
        self._height_m = np.zeros((0, 0), np.float32)
        self._latest_s = -np.inf

    @property
    def cell_m(self) -> float:
        """Side of a cell, m."""
        return self.config.cell_m

    @property
    def origin(self) -> Float[np.ndarray, "2"]:
        """Lower left corner of cell [0, 0], world frame, m; changes when the map grows."""
        return np.asarray(self._first * self.cell_m)

    @property
    def probability(self) -> Float32[np.ndarray, "rows columns"]:
        """p that an obstacle covers the cell; 0.5 where never seen."""
        return np.where(self.known, probability_of(self._log_odds), np.float32(0.5))

    @property
    def known(self) -> Bool[np.ndarray, "rows columns"]:
        """Whether the cell was ever seen and is not forgotten."""
        return np.isfinite(self._log_odds)

    @property
    def updated_s(self) -> Float[np.ndarray, "rows columns"]:
        """Time of the cell's last update, s; 0 where never seen."""
        return self._updated_s.copy()

    @property
    def height_m(self) -> Float32[np.ndarray, "rows columns"]:
        """Height of the highest obstacle point seen on the cell, m; NaN where none was or p < 0.5."""
        occupied = self.known & (self._log_odds >= 0.0)
        return np.where(occupied, self._height_m, np.float32(np.nan))

    def cell_of(self, xy: Float[np.ndarray, "*n 2"]) -> Int[np.ndarray, "*n 2"]:
        """Cells [row, column] of world positions, m; indices outside the shape are outside the map."""
        lattice = np.floor(xy * (1.0 / self.cell_m)).astype(np.int64)
        return (lattice - self._first)[..., ::-1]

    def update(
        self,
        points_xy: Float[np.ndarray, "n 2"],
        is_obstacle: Bool[np.ndarray, "n"],
        stamp_s: float,
        heights_m: Float[np.ndarray, "n"] | None = None,
        is_moving: Bool[np.ndarray, "n"] | None = None,
    ) -> None:
        """Update the map by one frame; each cell changes at most once.

        Args:
            points_xy: Floor and obstacle points on the floor plane, world frame, m; NaN is ignored.
            is_obstacle: Whether each point is above (or below) the floor.
            stamp_s: Time of the frame, s.
            heights_m: Height of each point above the floor, m; None keeps the stored heights.
            is_moving: Whether each obstacle point belongs to a moving obstacle; None: none does.

        Raises:
            InputError: The number of flags or heights differs from the number of points.
        """
        flags = len(is_obstacle) if heights_m is None else min(len(is_obstacle), len(heights_m))
        if len(points_xy) != flags:
            raise InputError(
                f"world map update: {len(points_xy)} points but {flags} flags or heights; give one a point"
            )
        points = np.ascontiguousarray(points_xy)
        window = self._make_room(points)
        if window is None:
            return
        low, high = window
        kinds = kinds_of(is_obstacle, is_moving)
        anchor, per_m = np.zeros(2), 1.0 / self.cell_m
        columns, rows = (int(v) for v in high - low + 1)
        tally = np.zeros(3 * rows * columns + 1, np.int32)
        _evidence_kernels.count_points(points, kinds, anchor, per_m, low, rows, columns, tally)
        counts = tally[:-1].reshape(3, rows, columns)
        row, column = (int(v) for v in (low - self._first)[::-1])
        layers = (self._log_odds, self._updated_s, self._moving)
        update_cells(counts, layers, (row, column), stamp_s, self._evidence)
        if heights_m is not None:
            top = self._height_m[row : row + rows, column : column + columns]
            _evidence_kernels.highest_in_cells(points, heights_m, kinds, anchor, per_m, low, top)
        self._latest_s = stamp_s

    def mark_moving(
        self, centres: Float[np.ndarray, "k 2"], radii_m: Float[np.ndarray, "k"]
    ) -> None:
        """Reclassify the obstacles in these discs as moving; world frame, m (see `EgocentricGrid`)."""
        shape = self._log_odds.shape
        for centre, radius_m in zip(centres, radii_m, strict=True):
            corners = self.cell_of(np.array([centre - radius_m, centre + radius_m + self.cell_m]))
            (row, column), (end, edge) = np.clip(corners, 0, shape).tolist()
            y, x = self.cell_m * (self._first[::-1] + 0.5 + [row, column])
            along, up = (self.cell_m * np.arange(n) for n in (edge - column, end - row))
            near = np.hypot(x + along - centre[0], (y + up - centre[1])[:, None]) <= radius_m
            part = np.s_[row:end, column:edge]
            mark_moving(self._log_odds[part], self._moving[part], near)

    def age(self, seconds: float) -> None:
        """Fade moving obstacles that the latest frame did not see; seconds since the last call."""
        away = self._updated_s < self._latest_s
        age(self._log_odds, self._moving, away, seconds)
        self._updated_s[np.isinf(self._log_odds)] = 0.0

    def _make_room(
        self, points: Float[np.ndarray, "n 2"]
    ) -> tuple[Int[np.ndarray, "2"], Int[np.ndarray, "2"]] | None:
        """Grow so that the points fit; returns the first and last lattice cell (x, y) that hold points.

        If the map would exceed its largest extent, points far from its centre (or from the median of the
        points, while it is empty) are dropped and counted. None if no point is left.
        """
        per_m = 1.0 / self.cell_m
        bounds = np.array(_evidence_kernels.lattice_bounds(points, per_m))
        if not np.isfinite(bounds).all():
            return None
        low, high = bounds[:2], bounds[2:]
        if not self._fits(low, high):
            cells = np.floor(points[np.isfinite(points).all(axis=1)] * per_m)
            middle = self._middle() if self._log_odds.size else np.median(cells, axis=0)
            reach = (int(self.config.most_cells**0.5) - 2 * GROWTH) // 2
            near = (np.abs(cells - middle) <= reach).all(axis=1)
            self.dropped += int((~near).sum())
            if not near.any():
                return None
            low, high = cells[near].min(axis=0), cells[near].max(axis=0)
        first, last = low.astype(np.int64), high.astype(np.int64)
        self._grow(first, last)
        return first, last

    def _middle(self) -> Float[np.ndarray, "2"]:
        return np.floor(self._first + np.array(self._log_odds.shape[::-1]) / 2)

    def _fits(self, low: Float[np.ndarray, "2"], high: Float[np.ndarray, "2"]) -> bool:
        if self._log_odds.size:
            low = np.minimum(low, self._first)
            high = np.maximum(high, self._first + np.array(self._log_odds.shape[::-1]) - 1)
        return float(np.prod(high - low + 1 + 2 * GROWTH)) <= self.config.most_cells

    def _grow(self, low: Int[np.ndarray, "2"], high: Int[np.ndarray, "2"]) -> None:
        if not self._log_odds.size:
            self._first = low.copy()
        size = np.array(self._log_odds.shape[::-1])
        before = np.maximum(self._first - low, 0)
        after = np.maximum(high + 1 - (self._first + size), 0)
        if not (before.any() or after.any()):
            return
        before = np.where(before > 0, np.maximum(before, GROWTH), 0)
        after = np.where(after > 0, np.maximum(after, GROWTH), 0)
        around = ((before[1], after[1]), (before[0], after[0]))
        self._first = self._first - before
        self._log_odds = np.pad(self._log_odds, around, constant_values=np.inf)
        self._updated_s = np.pad(self._updated_s, around)
        self._moving = np.pad(self._moving, around)
        self._height_m = np.pad(self._height_m, around, constant_values=np.nan)
