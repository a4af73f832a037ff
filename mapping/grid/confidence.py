"""The confidence layer: how fresh each cell of the terrain map is.

Confidence is 1 where the camera looks now and runs down at a fixed rate where it does not; the gaze
looks again at what has become stale.

Source: seed 001, section 3, eq. (1).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32

from perception.floor.segmented_view import SegmentedView
from perception.primitives.errors import ConfigError, InputError

from .egocentric_grid import EgocentricGrid


@dataclass(frozen=True)
class ConfidenceConfig:
    """How fast a cell becomes stale."""

    loss_per_s: float = 0.03  # seed 001: xi_lm = -0.001 per cycle of 30 Hz; 5 s from 1 to 0.85
    stale_below: float = 0.85  # seed 001: lambda_cf

    def __post_init__(self) -> None:
        if not self.loss_per_s >= 0.0:
            raise ConfigError(
                f"confidence: loss_per_s={self.loss_per_s} must not be negative; it is the amount lost"
            )
        if not 0.0 < self.stale_below <= 1.0:
            raise ConfigError(f"confidence: stale_below={self.stale_below} must lie in (0, 1]")


class ConfidenceLayer:
    """C of seed 001 for every cell of a terrain map; scrolls with it."""

    def __init__(self, grid: EgocentricGrid, config: ConfidenceConfig | None = None) -> None:
        """Nothing seen yet: C = 0 everywhere, and in every cell that enters later."""
        self.config = config or ConfidenceConfig()
        self._grid = grid
        self._values = grid.new_layer(0.0)

    @property
    def values(self) -> Float32[np.ndarray, "rows columns"]:
        """C in [0, 1], indexed like the grid's probability."""
        return self._grid.unrolled(self._values)

    @property
    def stale(self) -> Bool[np.ndarray, "rows columns"]:
        """Cells worth another look: C < lambda_cf."""
        return np.asarray(self.values < self.config.stale_below)

    def see(
        self, visible: Bool[np.ndarray, "rows columns"] | Float[np.ndarray, "corners 2"]
    ) -> None:
        """Set C = 1 where the camera looks now (R_g of the seed).

        Args:
            visible: Either a mask indexed like the grid's probability, or the corners, in order, of the
                region seen on the floor, world frame, m; then every cell whose middle it holds.

        Raises:
            InputError: A mask of another shape, or fewer than three finite corners.
        """
        n = len(self._values)
        if visible.dtype != np.bool_:
            visible = in_polygon(self._grid.centres(), visible)
        elif visible.shape != (n, n):
            raise InputError(f"confidence: mask of shape {visible.shape}, expected ({n}, {n})")
        self._values[self._grid.rolled(visible)] = 1.0

    def restore(self, values: Float32[np.ndarray, "rows columns"]) -> None:
        """Take the values of a saved map, indexed like the grid's probability."""
        n = len(self._values)
        if values.shape != (n, n):
            raise InputError(f"confidence: values of shape {values.shape}, expected ({n}, {n})")
        self._values[...] = self._grid.rolled(values)

    def decay(self, seconds: float) -> None:
        """Let confidence run down for a time, s; call before `see`, so that what is in view stays at 1."""
        np.maximum(
            self._values - np.float32(self.config.loss_per_s * seconds), 0.0, out=self._values
        )


def in_polygon(
    points: Float[np.ndarray, "*n 2"], corners: Float[np.ndarray, "corners 2"]
) -> Bool[np.ndarray, "*n"]:
    """Whether points are inside a simple polygon (either sense of rotation), by counting crossings.

    Raises:
        InputError: Fewer than three corners, or one that is not finite.
    """
    if len(corners) < 3 or not np.isfinite(corners).all():
        raise InputError(
            f"region with corners {corners.tolist()}: expected at least three finite ones; "
            "cut the field of view at a finite distance"
        )
    inside = np.zeros(points.shape[:-1], np.bool_)
    x, y = points[..., 0], points[..., 1]
    for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if y0 == y1:
            continue
        crosses = (y0 > y) != (y1 > y)
        inside ^= crosses & (x < x0 + (y - y0) * (x1 - x0) / (y1 - y0))
    return inside


def looked_at(
    view: SegmentedView, grid: EgocentricGrid, farthest_m: float
) -> Bool[np.ndarray, "n n"]:
    """R_g of seed 001: cells whose middle, on the floor, is inside the view."""
    centres = grid.centres()
    floor_points = np.concatenate([centres, np.zeros((*centres.shape[:2], 1))], axis=-1)
    camera_points = view.T_map_camera.inverse().apply(floor_points)
    inside = view.depth.camera.contains(view.depth.camera.project(camera_points))
    return inside & (camera_points[..., 2] < farthest_m)
