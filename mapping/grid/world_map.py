"""The world map: the occupancy and the height of everything a run saw, on a fixed grid that grows.

A frame looks at a cell once, whatever the number of its rays there: errors of pose, floor and sensor are common
to all of them. A look shows an obstacle or floor. Errors that last from frame to frame also last over all looks, so
looks are no independent evidence either. A cell therefore has a share of obstacle looks of its own, which is
beta-distributed, high in occupied cells and low in free ones; the looks of a cell are beta-binomial, and a thousand
looks say little more than a hundred.

Doubts of a look: depth noise carries points into the next cell (`_look_kernels.judge`); the pose error moves all
points of a frame, which blurs its verdicts (`blurred`). Doubt of the threshold: the surface of a cell has a height
with a variance, and may be lower or higher than the lowest obstacle.

The corners of the cells are multiples of the cell size in the world frame, so that maps of several runs align. Cells
are kept in tiles: memory grows with the area that was seen, and the time of a frame depends on its own view alone.

Source: ours; beta-binomial after Skellam 1948; observations of seed 003, section 3.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Int32
from scipy.special import ndtr

from perception.primitives.errors import ConfigError
from perception.primitives.gaussian import Gaussian
from perception.primitives.plane import Plane

from .. import open3d_objects
from . import _evidence_kernels, _look_kernels, _terrain_kernels, hanging
from ._look_kernels import LookRule, Shares
from .cell_points import check_one_a_point, gather
from .egocentric_grid import LOWEST_OBSTACLE_M
from .evidence import MOVING_LOG_ODDS, OBSTACLE_POINTS, age, mark_moving, probability_of
from .heights import GATE_SIGMAS, floor_form, pose_form
from .tiles import Key, Tiles

GROWTH = 64  # cells by which the map grows at least, so that it rarely does
SHARES = Shares(1.9, 0.17, 0.036, 0.35)
"""Ours: the most likely ones for four simulated walks (home, seeds 100 to 103) with their true maps."""
LOOKS = ("looks", "hits", "log_odds", "updated_s", "moving")
FRAMES = ("floor_frames", "obstacle_frames")
HEIGHTS = ("height_m", "variance_m2", "raised")
EMPTY: dict[str, np.generic] = {
    "looks": np.float32(0.0),
    "hits": np.float32(0.0),
    "log_odds": np.float32(np.inf),
    "updated_s": np.float64(0.0),
    "moving": np.bool_(False),
    "floor_frames": np.int32(0),
    "obstacle_frames": np.int32(0),
    "height_m": np.float32(np.nan),
    "variance_m2": np.float32(np.nan),
    "raised": np.bool_(False),  # the height is that of an obstacle
    "hanging": np.bool_(False),  # the obstacle has room below it, see `hanging`
}
HIGHEST_M = 0.5  # ours: what is higher does not block a small robot
RULE = LookRule(OBSTACLE_POINTS, 12.0, MOVING_LOG_ODDS)
"""Ours: a thing that came or went shows after seven looks; more looks make no cell surer."""


@dataclass(frozen=True)
class WorldMapConfig:
    """Resolution and largest extent of the world map."""

    cell_m: float = 0.05  # ours: as the terrain map; side of a cell of the world map
    most_cells: int = 16_000_000  # ours: 200 m x 200 m of 5 cm; points beyond are dropped
    height_sigma_m: float = 0.002  # ours: of a frame's heights, besides noise, floor and pose

    def __post_init__(self) -> None:
        if not self.cell_m > 0.0:
            raise ConfigError(f"world map: cell_m={self.cell_m} must be positive")
        if self.most_cells < GROWTH * GROWTH:
            raise ConfigError(
                f"world map: most_cells={self.most_cells} must be at least {GROWTH * GROWTH}"
            )


def low_obstacle(
    height_m: Float32[np.ndarray, "*cells"], variance_m2: Float32[np.ndarray, "*cells"]
) -> Float[np.ndarray, "*cells"]:
    """Probability that a surface of a measured height is an obstacle and not the floor; NaN without a height.

    Both are as likely beforehand, and so are all heights of an obstacle (depths of a hole) from the lowest one to
    `HIGHEST_M`.
    """
    sigma = np.sqrt(variance_m2, dtype=np.float64)
    off = np.abs(height_m) / sigma
    obstacle = ndtr(off - LOWEST_OBSTACLE_M / sigma) / (HIGHEST_M - LOWEST_OBSTACLE_M)
    floor = np.exp(-0.5 * off**2) * math.sqrt(2.0 / math.pi) / sigma
    return np.asarray(obstacle / (obstacle + floor))


class Standing(NamedTuple):
    """What stands in some cells, by the looks alone.

    Args:
        probability: That an obstacle stands there.
        known: Whether the cell was seen and does not move.
        unseen_s: Time since its last update, s; of no meaning where not known.
    """

    probability: Float32[np.ndarray, "rows columns"]
    known: Bool[np.ndarray, "rows columns"]
    unseen_s: Float[np.ndarray, "rows columns"]


class WorldMap:
    """Occupancy probability, time of the last update, and height with variance of every cell ever seen."""

    def __init__(self, config: WorldMapConfig | None = None) -> None:
        """An empty map of no cells."""
        self.config = config or WorldMapConfig()
        self.dropped = 0  # points beyond the largest extent
        self._first = np.zeros(2, np.int64)  # lattice cell (x, y) of cell [0, 0]
        self._shape = (0, 0)
        self._tiles = Tiles(EMPTY)
        self._restless: set[Key] = set()  # tiles that ageing may change
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
        """p that an obstacle stands in the cell; 0.5 where never seen.

        Either the looks show one, or the surface that they take for the floor is that of a low obstacle.
        """
        layers = self._layers("log_odds", *HEIGHTS)
        known = np.isfinite(layers["log_odds"])
        shown = np.where(known, probability_of(layers["log_odds"]), np.float32(0.5))
        low = np.where(layers["raised"], np.nan, layers["height_m"])
        missed = np.nan_to_num(low_obstacle(low, layers["variance_m2"]))
        return np.asarray(1.0 - (1.0 - shown) * (1.0 - missed), np.float32)

    @property
    def known(self) -> Bool[np.ndarray, "rows columns"]:
        """Whether the cell was ever seen and is not forgotten."""
        return np.isfinite(self._layers("log_odds")["log_odds"])

    @property
    def stay(self) -> Float[np.ndarray, "rows columns"]:
        """Share of the frames that saw the cell in which an obstacle was there; 0 where never seen.

        Of an obstacle that stood there all the time it is high: the frames that see the floor before it see it too.
        """
        floor, obstacle = self._layers(*FRAMES).values()
        return np.asarray(obstacle / np.maximum(obstacle + floor, 1))

    @property
    def updated_s(self) -> Float[np.ndarray, "rows columns"]:
        """Time of the cell's last update, s; 0 where never seen."""
        return self._layers("updated_s")["updated_s"]

    @property
    def height_m(self) -> Float32[np.ndarray, "rows columns"]:
        """Mean height of the seen surface above the floor, m; NaN where not measured.

        The surface is the floor where the looks show none, the obstacle elsewhere.
        """
        return np.where(self.known, self._layers("height_m")["height_m"], np.float32(np.nan))

    @property
    def height_variance_m2(self) -> Float32[np.ndarray, "rows columns"]:
        """Variance of `height_m`, m^2; NaN where not measured."""
        return np.where(self.known, self._layers("variance_m2")["variance_m2"], np.float32(np.nan))

    def to_open3d(self) -> dict[str, Any]:
        """The layers as tensors of Open3D, see `open3d_objects.layers`; `height_mesh` there draws them."""
        return open3d_objects.layers(self)

    def cell_of(self, xy: Float[np.ndarray, "*n 2"]) -> Int[np.ndarray, "*n 2"]:
        """Cells [row, column] of world positions, m; indices outside the shape are outside the map."""
        lattice = np.floor(xy * (1.0 / self.cell_m)).astype(np.int64)
        return (lattice - self._first)[..., ::-1]

    def standing(self, x: Float[np.ndarray, "columns"], y: Float[np.ndarray, "rows"]) -> Standing:
        """What the looks alone tell of cells at ascending x and y, m."""
        columns, rows = (np.floor(v * (1.0 / self.cell_m)).astype(np.int64) for v in (x, y))
        shape = int(rows[-1] - rows[0]) + 1, int(columns[-1] - columns[0]) + 1
        low = np.array([columns[0], rows[0]])
        layers = self._tiles.read(low, shape, ("log_odds", "moving", "updated_s"))
        places = np.ix_(rows - rows[0], columns - columns[0])
        odds, moving, seen_s = (layer[places] for layer in layers.values())
        return Standing(probability_of(odds), np.isfinite(odds) & ~moving, self._latest_s - seen_s)

    def update(
        self,
        points: Float[np.ndarray, "n 3"],
        is_obstacle: Bool[np.ndarray, "n"],
        stamp_s: float,
        camera: Float[np.ndarray, "3"],
        is_moving: Bool[np.ndarray, "n"] | None = None,
        sigma_m: Float[np.ndarray, "n"] | None = None,
        floor: Plane | None = None,
        pose: Gaussian | None = None,
        sees_through: hanging.SeesThrough | None = None,
    ) -> None:
        """Update the map by one frame; each cell changes at most once.

        Args:
            points: Floor and obstacle points, world frame, m; z is the height above the floor. NaN is ignored.
            is_obstacle: Whether each point is above (or below) the floor.
            stamp_s: Time of the frame, s.
            camera: Position of the camera, world frame, and its height above the floor, m.
            is_moving: Whether each obstacle point belongs to a moving obstacle; None: none does.
            sigma_m: Standard deviation of each point along its ray by depth noise, m; None: without noise.
            floor: The floor in the world frame, for its covariance; None: without error.
            pose: (x, y, yaw) of the body, world frame; None: without error.
            sees_through: Which places the frame sees through, for what hangs above the floor (see `hanging`); None:
                nothing is known to hang.

        Raises:
            InputError: The number of flags or sigmas differs from the number of points.
        """
        check_one_a_point("world map", points, is_obstacle, is_moving, sigma_m)
        window = self._make_room(points)
        if window is None:
            return
        low, shape = window
        counts, sums = self._count(points, is_obstacle, is_moving, sigma_m, low, shape)
        x, y = (float(v) for v in low * self.cell_m)
        place = _terrain_kernels.Placement(0, 0, x, y, self.cell_m)
        self._restless.update(self._tiles.make(low, (counts != 0).any(axis=0)))
        cells = self._tiles.read(low, shape)
        if sees_through is not None:
            layers = cells["hanging"], cells["height_m"], cells["log_odds"]
            below = hanging.note(counts, sums, *layers, place, sees_through)
            cells["looks"][below] = cells["hits"][below] = 0.0
        verdicts, weights = np.empty((2, *shape), np.float32)
        _look_kernels.judge(counts, sums, place, camera.astype(np.float64), RULE, verdicts, weights)
        looks, frames, heights = (
            tuple(cells[name] for name in names) for names in (LOOKS, FRAMES, HEIGHTS)
        )
        moved = pose_form(pose)
        _look_kernels.fold_looks(
            counts, verdicts, weights, looks, frames, place, moved, stamp_s, RULE, SHARES
        )
        base_m2 = self.config.height_sigma_m**2
        rule = _terrain_kernels.HeightRule(True, OBSTACLE_POINTS, base_m2, GATE_SIGMAS**2)
        _terrain_kernels.fuse_heights(
            counts, sums, cells["log_odds"], *heights, place, floor_form(floor), moved, rule
        )
        cells["hanging"] &= (cells["log_odds"] > 0.0) & ~cells["moving"]
        self._tiles.write(low, cells)
        self._latest_s = stamp_s

    def _count(
        self,
        points: Float[np.ndarray, "n 3"],
        is_obstacle: Bool[np.ndarray, "n"],
        is_moving: Bool[np.ndarray, "n"] | None,
        sigma_m: Float[np.ndarray, "n"] | None,
        low: Int[np.ndarray, "2"],
        shape: tuple[int, int],
    ) -> tuple[Int32[np.ndarray, "3 rows columns"], Float[np.ndarray, "t 3"]]:
        """The points of each kind in each cell of a window, and the sums of `gather`."""
        sums = np.zeros((3 * shape[0] * shape[1] + 1, 3))
        tally = np.zeros(len(sums), np.int32)
        per_m = 1.0 / self.cell_m
        gather(points, is_obstacle, is_moving, sigma_m, np.zeros(2), per_m, low, shape, tally, sums)
        return tally[:-1].reshape(3, *shape), sums

    def mark_moving(
        self, centres: Float[np.ndarray, "k 2"], radii_m: Float[np.ndarray, "k"]
    ) -> None:
        """Reclassify the obstacles in these discs as moving; world frame, m (see `EgocentricGrid`)."""
        for centre, radius_m in zip(centres, radii_m, strict=True):
            corners = self.cell_of(np.array([centre - radius_m, centre + radius_m + self.cell_m]))
            (row, column), (end, edge) = np.clip(corners, 0, self._shape).tolist()
            low, shape = np.add(self._first, [column, row]), (end - row, edge - column)
            y, x = self.cell_m * (self._first[::-1] + 0.5 + [row, column])
            along, up = (self.cell_m * np.arange(n) for n in (shape[1], shape[0]))
            near = np.hypot(x + along - centre[0], (y + up - centre[1])[:, None]) <= radius_m
            part = self._tiles.read(low, shape, ("log_odds", "moving", "looks", "hits", "hanging"))
            mark_moving(part["log_odds"], part["moving"], near)
            part["hanging"] &= ~part["moving"]
            for name in ("looks", "hits"):
                part[name][part["moving"]] = 0.0
            self._tiles.write(low, part)
            self._restless.update(self._tiles.keys_in(low, shape))

    def age(self, seconds: float) -> None:
        """Fade moving obstacles that the latest frame did not see; seconds since the last call."""
        for key in sorted(self._restless):
            tile = self._tiles[key]
            age(tile["log_odds"], tile["moving"], tile["updated_s"] < self._latest_s, seconds)
            forgotten = np.isinf(tile["log_odds"])
            tile["updated_s"][forgotten] = 0.0
            tile["height_m"][forgotten] = tile["variance_m2"][forgotten] = np.nan
            if not tile["moving"].any():
                self._restless.remove(key)

    def _layers(self, *names: str) -> dict[str, np.ndarray]:
        """Copies of some layers of the whole map."""
        return self._tiles.read(self._first, self._shape, names)

    def _make_room(
        self, points: Float[np.ndarray, "n 3"]
    ) -> tuple[Int[np.ndarray, "2"], tuple[int, int]] | None:
        """Grow so that the points fit; returns their window: its first lattice cell (x, y), rows and columns.

        If the map would exceed its largest extent, points beyond it (or beyond the median of the points, while it
        is empty) by more than may be added on all its sides are dropped and counted. None if no point is left.
        """
        per_m = 1.0 / self.cell_m
        bounds = np.array(_evidence_kernels.lattice_bounds(points, per_m))
        if not np.isfinite(bounds).all():
            return None
        low, high = bounds[:2], bounds[2:]
        if not self._fits(low, high):
            cells = np.floor(points[np.isfinite(points).all(axis=1), :2] * per_m)
            first = self._first if self._shape[0] else np.floor(np.median(cells, axis=0))
            last = first + np.maximum(self._shape[::-1], 1) - 1
            a, b = (float(v) for v in last - first + 1 + 2 * GROWTH)
            # (a + 2 reach) (b + 2 reach) = most_cells
            reach = (math.sqrt((a - b) ** 2 + 4.0 * self.config.most_cells) - a - b) / 4.0
            reach = max(math.floor(reach), 0)
            near = ((cells >= first - reach) & (cells <= last + reach)).all(axis=1)
            self.dropped += int((~near).sum())
            if not near.any():
                return None
            low, high = cells[near].min(axis=0), cells[near].max(axis=0)
        first, last = low.astype(np.int64), high.astype(np.int64)
        self._grow(first, last)
        columns, rows = (int(v) for v in last - first + 1)
        return first, (rows, columns)

    def _fits(self, low: Float[np.ndarray, "2"], high: Float[np.ndarray, "2"]) -> bool:
        if self._shape[0]:
            low = np.minimum(low, self._first)
            high = np.maximum(high, self._first + np.array(self._shape[::-1]) - 1)
        return float(np.prod(high - low + 1 + 2 * GROWTH)) <= self.config.most_cells

    def _grow(self, low: Int[np.ndarray, "2"], high: Int[np.ndarray, "2"]) -> None:
        if not self._shape[0]:
            self._first = low.copy()
        size = np.array(self._shape[::-1])
        before = np.maximum(self._first - low, 0)
        after = np.maximum(high + 1 - (self._first + size), 0)
        if not (before.any() or after.any()):
            return
        before = np.where(before > 0, np.maximum(before, GROWTH), 0)
        after = np.where(after > 0, np.maximum(after, GROWTH), 0)
        self._first = self._first - before
        columns, rows = (int(v) for v in size + before + after)
        self._shape = (rows, columns)
