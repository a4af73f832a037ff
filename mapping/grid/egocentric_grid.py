"""The terrain map: a square occupancy grid that walks with the robot.

The grid keeps the world's orientation, and the robot stays in its centre cell. When a step leaves that
cell, the grid shifts by whole cells; an index offset moves, the data does not.

Floor points prove free space. A ray that ends farther away proves little about the cells below it, as this
camera looks over low boxes. Only the last part of a ray before a floor point, where the ray is lower than any
obstacle, also counts as seen floor (ours). Below a table top floor proves nothing (`hanging`, ours).

Each cell holds the occupancy probability, the time of its last update, and a surface height with its
variance.

Source: seed 003, section 3, eq. (1) and (2), Fig. 5 and 6.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Float32

from perception.primitives.errors import ConfigError
from perception.primitives.gaussian import Gaussian
from perception.primitives.plane import Plane
from perception.primitives.settings import setting

from .. import open3d_objects
from . import _evidence_kernels, _terrain_kernels, hanging
from .cell_points import check_one_a_point, gather
from .evidence import (
    OBSTACLE_POINTS,
    EvidenceConfig,
    age,
    kinds_of,
    mark_moving,
    probability_of,
    update_cells,
)
from .heights import GATE_SIGMAS, floor_form, pose_form
from .scrolling import Window

LOWEST_OBSTACLE_M = 0.03  # ours: a ray lower than this proves the floor below it free
MOST_CELLS = 2001  # ours: along a side; of 4 million cells a copy is kept per frame


@dataclass(frozen=True)
class GridConfig:
    """Extent and resolution of the terrain map, and the weight of evidence."""

    side_m: float = setting(
        3.55,
        "m",
        "side of the terrain map, an odd number of cells",
        "seed 003: 3.5; odd, so that a centre cell exists",
    )
    cell_m: float = setting(
        0.05,
        "m",
        "side of a cell of the terrain map",
        "ours: about a quarter of a foot; fine: 0.02 with side_m 3.50",
    )
    evidence: EvidenceConfig = field(default_factory=EvidenceConfig)
    literal: bool = False  # shift by eq. (2) as printed, which drops R; for comparison only
    height_sigma_m: float = 0.002  # ours: of a frame's heights, besides noise, floor and pose

    def __post_init__(self) -> None:
        if not 0.0 < self.cell_m < self.side_m:
            raise ConfigError(
                f"grid: cell_m={self.cell_m} must lie between 0 and side_m={self.side_m}"
            )
        if not self.side_m <= MOST_CELLS * self.cell_m:
            raise ConfigError(
                f"grid: side_m={self.side_m} must be at most {MOST_CELLS} cells of {self.cell_m} m, "
                f"{MOST_CELLS * self.cell_m:g} m"
            )
        exact = self.side_m / self.cell_m
        if abs(exact - self.cells) > 1e-6:
            raise ConfigError(
                f"grid: side_m={self.side_m} holds {exact:g} cells of {self.cell_m} m, expected an odd whole "
                f"number; use {self.cells * self.cell_m:g}"
            )

    @property
    def cells(self) -> int:
        """N, cells along a side: the odd number nearest to side / cell."""
        return 2 * round((self.side_m / self.cell_m - 1) / 2) + 1


class EgocentricGrid(Window):
    """Occupancy probability, time of the last update, and surface height of each cell round the robot."""

    def __init__(self, config: GridConfig, position_world: Float[np.ndarray, "2"]) -> None:
        """All cells unseen (p = 1, t = 0), the robot at the position (2,), m, in the centre of its cell."""
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
        self._hanging = np.zeros((n, n), np.bool_)  # the obstacle has room below it, see `hanging`
        unseen = {"log_odds": np.inf, "height_m": np.nan, "height_variance_m2": np.nan}
        for name, layer in self._named_layers().items():
            self._add_layer(layer, unseen.get(name, 0.0))
        self._tally = np.zeros(3 * n * n + 1, np.int32)  # of one frame, zero between frames
        self._sums = np.zeros((3 * n * n + 1, 3))

    @property
    def _counts(self) -> np.ndarray:
        """(3, n, n) view of the tally; not stored, since pickling would turn it into a separate array."""
        n = self.config.cells
        return self._tally[:-1].reshape(3, n, n)

    # Content

    @property
    def probability(self) -> Float32[np.ndarray, "rows columns"]:
        """p that an obstacle covers the cell; 1 where never seen."""
        return self.unrolled(probability_of(self._log_odds))

    @property
    def updated_s(self) -> Float[np.ndarray, "rows columns"]:
        """t, time of the cell's last update, s; 0 where never seen (see `known`)."""
        return self.unrolled(self._updated_s)

    @property
    def known(self) -> Bool[np.ndarray, "rows columns"]:
        """Whether the cell was ever seen and is not forgotten."""
        return self.unrolled(np.isfinite(self._log_odds))

    @property
    def moving(self) -> Bool[np.ndarray, "rows columns"]:
        """Whether the obstacle in the cell moves."""
        return self.unrolled(self._moving)

    @property
    def height_m(self) -> Float32[np.ndarray, "rows columns"]:
        """Mean height of the seen surface above the floor, m; NaN where not measured.

        The surface is the floor where p < 0.5, the obstacle elsewhere.
        """
        return self.unrolled(self._height_m)

    @property
    def height_variance_m2(self) -> Float32[np.ndarray, "rows columns"]:
        """Variance of `height_m`, m^2; NaN where not measured."""
        return self.unrolled(self._variance_m2)

    def to_open3d(self) -> dict[str, Any]:
        """The layers as tensors of Open3D, see `open3d_objects.layers`; `height_mesh` there draws them."""
        return open3d_objects.layers(self)

    def snapshot(self) -> dict[str, np.ndarray]:
        """State for `restored`, by name, layers in world order; see `grid_file`."""
        return {
            **self._placement(),
            "latest_s": np.array(self._latest_s),
            **{name: self.unrolled(layer) for name, layer in self._named_layers().items()},
        }

    @classmethod
    def restored(cls, config: GridConfig, content: Mapping[str, np.ndarray]) -> EgocentricGrid:
        """The grid of a snapshot; further updates give the same bits as in the original."""
        grid = cls(config, content["start"])
        grid._place(content["first"], content["rest"])
        grid._latest_s = float(content["latest_s"])
        for name, layer in grid._named_layers().items():
            layer[...] = grid.rolled(content[name])
        return grid

    def _named_layers(self) -> dict[str, np.ndarray]:
        return {
            "log_odds": self._log_odds,
            "updated_s": self._updated_s,
            "moving": self._moving,
            "height_m": self._height_m,
            "height_variance_m2": self._variance_m2,
            "raised": self._raised,
            "hanging": self._hanging,
        }

    # Updates

    def update(
        self,
        points: Float[np.ndarray, "n 2"] | Float[np.ndarray, "n 3"],
        is_obstacle: Bool[np.ndarray, "n"],
        stamp_s: float,
        sensor_xy: Float[np.ndarray, "2"],
        is_moving: Bool[np.ndarray, "n"] | None = None,
        sensor_height_m: float | None = None,
        sigma_m: Float[np.ndarray, "n"] | None = None,
        floor: Plane | None = None,
        pose: Gaussian | None = None,
        sees_through: hanging.SeesThrough | None = None,
    ) -> None:
        """Update the map by one frame; each cell changes at most once.

        Args:
            points: Floor and obstacle points, world frame, m: x, y and optionally the height above the
                floor. NaN and points outside the grid are ignored.
            is_obstacle: Whether each point is above (or below) the floor.
            stamp_s: Time of the frame, s.
            sensor_xy: Position of the camera on the floor plane, world frame, m.
            is_moving: Whether each obstacle point belongs to a moving obstacle; None: none does.
            sensor_height_m: Height of the camera above the floor. With it, cells in front of a floor point
                are cleared where the ray is lower than `LOWEST_OBSTACLE_M`.
            sigma_m: Standard deviation of each height by depth noise, m; None: from the scatter in a cell.
            floor: The floor in the world frame, for its covariance; None: without error.
            pose: (x, y, yaw) of the body, world frame; None: without error.
            sees_through: Which places the frame sees through, for what hangs above the floor (see `hanging`); None, or
                points without heights: nothing is known to hang.

        Raises:
            InputError: The number of flags or sigmas differs from the number of points.

        Source: seed 003, section 3, "Update of p"; rays, moving obstacles and heights are ours.
        """
        check_one_a_point("grid", points, is_obstacle, is_moving, sigma_m)
        self._count(points, is_obstacle, is_moving, sigma_m)
        origin = self.origin
        if sensor_height_m is not None and sensor_height_m > 0.0:
            sensor = (sensor_xy - origin) / self.cell_m
            share = min(1.0, LOWEST_OBSTACLE_M / sensor_height_m)
            _terrain_kernels.clear_before_floor(self._counts, sensor, share)
        corner = int(self._corner[1]), int(self._corner[0])
        place = _terrain_kernels.Placement(*corner, float(origin[0]), float(origin[1]), self.cell_m)
        if sees_through is not None and points.shape[1] == 3:
            layers = self._hanging, self._height_m, self._log_odds
            below = hanging.note(self._counts, self._sums, *layers, place, sees_through)
            self._log_odds[below] = np.inf
        evidence = self._log_odds, self._updated_s, self._moving
        update_cells(self._counts, evidence, corner, stamp_s, self.config.evidence)
        _terrain_kernels.fuse_heights(
            self._counts,
            self._sums,
            self._log_odds,
            self._height_m,
            self._variance_m2,
            self._raised,
            place,
            floor_form(floor),
            pose_form(pose),
            _terrain_kernels.HeightRule(
                points.shape[1] == 3, OBSTACLE_POINTS, self.config.height_sigma_m**2, GATE_SIGMAS**2
            ),
        )
        self._tally[-1] = 0
        self._hanging &= (self._log_odds > 0.0) & ~self._moving
        self._latest_s = stamp_s

    def _count(
        self,
        points: np.ndarray,
        is_obstacle: np.ndarray,
        is_moving: np.ndarray | None,
        sigma_m: np.ndarray | None,
    ) -> None:
        """Count the points of each kind in each cell, and sum their heights if they have any."""
        n, per_m = self.config.cells, 1.0 / self.cell_m
        if points.shape[1] == 2:
            kinds = kinds_of(is_obstacle, is_moving)
            flat = np.ascontiguousarray(points)
            _evidence_kernels.count_points(
                flat, kinds, self._anchor, per_m, self._first, n, n, self._tally
            )
            return
        gather(
            points,
            is_obstacle,
            is_moving,
            sigma_m,
            self._anchor,
            per_m,
            self._first,
            (n, n),
            self._tally,
            self._sums,
        )

    def age(self, seconds: float) -> None:
        """Fade moving obstacles that the latest frame did not see; seconds since the last call."""
        away = self._updated_s < self._latest_s
        age(self._log_odds, self._moving, away, seconds)
        forgotten = np.isinf(self._log_odds)
        self._updated_s[forgotten] = 0.0
        self._forget_heights(forgotten)

    def mark_moving(
        self, centres: Float[np.ndarray, "k 2"], radii_m: Float[np.ndarray, "k"]
    ) -> None:
        """Reclassify the obstacles in these discs as moving: one floor observation or time clears them.

        Args:
            centres: World frame, m.
            radii_m: Radius of each disc.

        Source: ours.
        """
        for centre, radius_m in zip(centres, radii_m, strict=True):
            inside = np.sum((self.centres() - centre) ** 2, axis=-1) <= float(radius_m) ** 2
            mark_moving(self._log_odds, self._moving, self.rolled(inside))
        self._hanging &= ~self._moving

    def _forget_heights(self, cells: np.ndarray) -> None:
        self._height_m[cells] = np.nan
        self._variance_m2[cells] = np.nan
        self._raised[cells] = False
