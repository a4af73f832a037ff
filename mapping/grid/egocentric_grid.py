"""The terrain map: a square occupancy grid that walks with the robot.

The grid keeps the world's orientation, and the robot stays in its centre cell. When a step leaves that
cell, the grid shifts by whole cells; an index offset moves, the data does not.

Free space is what the floor was seen on. A ray that ends further away proves little about what is under
it: this camera looks over low boxes. Only the last stretch before a seen floor point, where the ray is
lower than any obstacle worth the name, counts as seen floor too (ours).

Beside probability and time, a cell holds the height of what was seen on it, and how sure we are of that.

Source: seed 003, section 3, eq. (1) and (2), Fig. 5 and 6.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float, Float32

from perception.primitives.errors import ConfigError, InputError
from perception.primitives.gaussian import Gaussian
from perception.primitives.plane import Plane

from . import _evidence_kernels, _terrain_kernels
from .evidence import EvidenceConfig, age, kinds_of, mark_moving, probability_of, update_cells
from .heights import HeightConfig, floor_form, pose_form
from .scrolling import Window


@dataclass(frozen=True)
class GridConfig:
    """Extent and grain of the terrain map, and the weight of evidence."""

    side_m: float = 3.55  # seed 003: 3.5; odd number of cells, so that a centre cell exists
    cell_m: float = 0.05  # ours: about a quarter of a foot; fine: 0.02 with side 3.50
    lowest_obstacle_m: float = 0.03  # ours: rays below this height prove the floor under them free
    literal: bool = False  # shift by eq. (2) as printed, which forgets R; for comparison only
    evidence: EvidenceConfig = field(default_factory=EvidenceConfig)
    heights: HeightConfig = field(default_factory=HeightConfig)

    def __post_init__(self) -> None:
        if not 0.0 < self.cell_m < self.side_m:
            raise ConfigError(
                f"grid: cell_m={self.cell_m} must lie between 0 and side_m={self.side_m}"
            )
        exact = self.side_m / self.cell_m
        if abs(exact - self.cells) > 1e-6:
            raise ConfigError(
                f"grid: side_m={self.side_m} holds {exact:g} cells of {self.cell_m} m, expected an odd whole "
                f"number; use {self.cells * self.cell_m:g}"
            )
        if not self.lowest_obstacle_m >= 0.0:
            raise ConfigError(
                f"grid: lowest_obstacle_m={self.lowest_obstacle_m} must not be negative"
            )

    @property
    def cells(self) -> int:
        """N, cells along a side: the odd number nearest to side / cell."""
        return 2 * round((self.side_m / self.cell_m - 1) / 2) + 1


class EgocentricGrid(Window):
    """Probability, time of the last update, and height for each cell round the robot."""

    def __init__(self, config: GridConfig, position_world: Float[np.ndarray, "2"]) -> None:
        """Nothing seen yet (p = 1, t = 0), the robot at the position (2,), m, in the middle of its cell."""
        super().__init__(config.cells, config.cell_m, position_world, config.literal)
        n = config.cells
        self.config = config
        self._latest_s = -np.inf
        self._log_odds = np.full((n, n), np.inf, np.float32)
        self._updated_s = np.zeros((n, n))
        self._moving = np.zeros((n, n), np.bool_)
        self._height_m = np.full((n, n), np.nan, np.float32)
        self._variance_m2 = np.full((n, n), np.nan, np.float32)
        self._raised = np.zeros((n, n), np.bool_)  # the height is that of an obstacle
        unseen = {"log_odds": np.inf, "height_m": np.nan, "height_variance_m2": np.nan}
        for name, layer in self._named_layers().items():
            self._add_layer(layer, unseen.get(name, 0.0))
        self._tally = np.zeros(3 * n * n + 1, np.int32)  # of one frame, zero between frames
        self._sums = np.zeros((3 * n * n + 1, 3))

    @property
    def _counts(self) -> np.ndarray:
        """(3, n, n) view of the tally; made anew, since a pickled view would become an array of its own."""
        n = self.config.cells
        return self._tally[:-1].reshape(3, n, n)

    # What it holds

    @property
    def probability(self) -> Float32[np.ndarray, "rows columns"]:
        """p that an obstacle covers the cell; 1 where never seen."""
        return self._unrolled(probability_of(self._log_odds))

    @property
    def updated_s(self) -> Float[np.ndarray, "rows columns"]:
        """t, stamp of the cell's last update, s; 0 where never seen (`known` tells the two apart)."""
        return self._unrolled(self._updated_s)

    @property
    def known(self) -> Bool[np.ndarray, "rows columns"]:
        """Whether the cell was ever seen and is not forgotten."""
        return self._unrolled(np.isfinite(self._log_odds))

    @property
    def moving(self) -> Bool[np.ndarray, "rows columns"]:
        """Whether the obstacle in the cell is part of something that moves."""
        return self._unrolled(self._moving)

    @property
    def height_m(self) -> Float32[np.ndarray, "rows columns"]:
        """Mean height over the floor of what was last seen on the cell, m; NaN where not measured.

        That of the floor itself where p < 0.5, that of the obstacle's seen surface elsewhere.
        """
        return self._unrolled(self._height_m)

    @property
    def height_variance_m2(self) -> Float32[np.ndarray, "rows columns"]:
        """How sure the height is: variance of the mean, m^2; NaN where not measured."""
        return self._unrolled(self._variance_m2)

    def snapshot(self) -> dict[str, np.ndarray]:
        """Everything that `restored` needs, by name, layers in world order; see `grid_file`."""
        return {
            **self._whereabouts(),
            "latest_s": np.array(self._latest_s),
            **{name: self._unrolled(layer) for name, layer in self._named_layers().items()},
        }

    @classmethod
    def restored(cls, config: GridConfig, content: Mapping[str, np.ndarray]) -> EgocentricGrid:
        """The grid of a snapshot; it goes on to the same bits."""
        grid = cls(config, content["start"])
        grid._place(content["first"], content["rest"])
        grid._latest_s = float(content["latest_s"])
        for name, layer in grid._named_layers().items():
            layer[...] = np.roll(content[name], (grid._corner[1], grid._corner[0]), (0, 1))
        return grid

    def _named_layers(self) -> dict[str, np.ndarray]:
        return {
            "log_odds": self._log_odds,
            "updated_s": self._updated_s,
            "moving": self._moving,
            "height_m": self._height_m,
            "height_variance_m2": self._variance_m2,
            "raised": self._raised,
        }

    # What changes it

    def update(
        self,
        points: Float[np.ndarray, "n 2"] | Float[np.ndarray, "n 3"],
        is_obstacle: Bool[np.ndarray, "n"],
        stamp_s: float,
        sensor_xy: Float[np.ndarray, "2"],
        ray_clearing: bool = True,
        is_moving: Bool[np.ndarray, "n"] | None = None,
        sensor_height_m: float | None = None,
        sigma_m: Float[np.ndarray, "n"] | None = None,
        floor: Plane | None = None,
        pose: Gaussian | None = None,
    ) -> None:
        """Remember what one frame showed; each cell changes at most once.

        Args:
            points: Floor and obstacle points, world frame, m: x, y, and the height over the floor, without
                which heights stay as they are. NaN and points outside the grid are passed over.
            is_obstacle: Whether each rises above (or falls below) the floor.
            stamp_s: Time of the frame, s.
            sensor_xy: The camera on the floor plane, world frame, m.
            ray_clearing: Also free the cells just before a seen floor point, where the ray is lower than
                `lowest_obstacle_m`; needs the sensor's height.
            is_moving: Whether each obstacle point belongs to something that moves; None: none does.
            sensor_height_m: Of the camera above the floor; None: no ray evidence.
            sigma_m: Deviation of each height by depth noise, m; None: as the points of a cell scatter.
            floor: The floor in the world frame, for its covariance; None: without error.
            pose: Over (x, y, yaw) of the body, world frame; None: without error.

        Raises:
            InputError: Not one flag or sigma a point.

        Source: seed 003, section 3, "Update of p"; rays, movers and heights are ours.
        """
        given = {"flags": is_obstacle, "movers": is_moving, "sigmas": sigma_m}
        for name, values in given.items():
            if values is not None and len(values) != len(points):
                raise InputError(
                    f"grid update: {len(points)} points but {len(values)} {name}; give one a point"
                )
        self._count(points, is_obstacle, is_moving, sigma_m)
        origin = self.origin
        if ray_clearing and sensor_height_m is not None and sensor_height_m > 0.0:
            sensor = (sensor_xy - origin) / self.cell_m
            share = min(1.0, self.config.lowest_obstacle_m / sensor_height_m)
            _terrain_kernels.clear_before_floor(self._counts, sensor, share)
        corner = int(self._corner[1]), int(self._corner[0])
        layers = self._log_odds, self._updated_s, self._moving
        update_cells(self._counts, layers, corner, stamp_s, self.config.evidence)
        _terrain_kernels.fuse_heights(
            self._counts,
            self._sums,
            self._log_odds,
            self._height_m,
            self._variance_m2,
            self._raised,
            corner,
            (float(origin[0]), float(origin[1]), self.cell_m),
            floor_form(floor),
            pose_form(pose),
            points.shape[1] == 3,
            self.config.evidence.obstacle_points,
            self.config.heights.sigma_m**2,
            self.config.heights.gate_sigmas**2,
        )
        self._tally[-1] = 0
        self._latest_s = stamp_s

    def _count(
        self,
        points: np.ndarray,
        is_obstacle: np.ndarray,
        is_moving: np.ndarray | None,
        sigma_m: np.ndarray | None,
    ) -> None:
        """The points of each kind in each cell, and sums of their heights where they have any."""
        n, per_m = self.config.cells, 1.0 / self.cell_m
        if points.shape[1] == 2:
            kinds = kinds_of(is_obstacle, is_moving)
            flat = np.ascontiguousarray(points)
            _evidence_kernels.count_points(
                flat, kinds, self._anchor, per_m, self._first, n, n, self._tally
            )
            return
        _terrain_kernels.gather(
            np.ascontiguousarray(points, np.float64).reshape(-1),
            np.ascontiguousarray(is_obstacle).view(np.uint8),
            np.zeros(0, np.uint8)
            if is_moving is None
            else np.ascontiguousarray(is_moving).view(np.uint8),
            np.zeros(0) if sigma_m is None else np.ascontiguousarray(sigma_m, np.float64),
            self._anchor,
            per_m,
            self._first,
            n,
            self._tally,
            self._sums,
        )

    def age(self, seconds: float) -> None:
        """Let what moves fade where the latest frame did not see it; seconds since the last call."""
        away = self._updated_s < self._latest_s
        age(self._log_odds, self._moving, away, seconds, self.config.evidence)
        forgotten = np.isinf(self._log_odds)
        self._updated_s[forgotten] = 0.0
        self._forget_heights(forgotten)

    def mark_moving(
        self, centres: Float[np.ndarray, "k 2"], radii_m: Float[np.ndarray, "k"]
    ) -> None:
        """What was marked in these discs has turned out to move: one floor sighting frees it, or time.

        Args:
            centres: World frame, m.
            radii_m: One to each.

        Source: ours.
        """
        for centre, radius_m in zip(centres, radii_m, strict=True):
            mark_moving(
                self._log_odds,
                self._moving,
                self.rolled(self._within(centre, float(radius_m))),
                self.config.evidence,
            )

    def _within(self, centre: Float[np.ndarray, "2"], radius_m: float) -> np.ndarray:
        return np.asarray(np.sum((self.centres() - centre) ** 2, axis=-1) <= radius_m**2)

    def _forget_heights(self, cells: np.ndarray) -> None:
        self._height_m[cells] = np.nan
        self._variance_m2[cells] = np.nan
        self._raised[cells] = False
