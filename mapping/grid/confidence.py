"""The confidence layer: how recently each cell of the terrain map was seen.

Confidence is 1 inside the field of view and decreases at a constant rate outside it. The gaze planner looks
again at cells below a threshold.

Source: Yoo 2010 (seed 001), section 3, eq. (1).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32

from perception.floor.segmented_view import SegmentedView
from perception.primitives.errors import ConfigError, InputError
from perception.primitives.settings import setting

from .egocentric_grid import EgocentricGrid


@dataclass(frozen=True)
class ConfidenceConfig:
    """How fast a cell becomes stale."""

    loss_per_s: float = setting(
        0.03,
        "1/s",
        "rate at which confidence decreases out of view",
        "seed 001: xi_lm = -0.001 per cycle of 30 Hz; 5 s from 1 to 0.85",
    )
    stale_below: float = setting(
        0.85, "", "confidence below which the gaze looks at a cell again", "seed 001: lambda_cf"
    )

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
        """C = 0 everywhere, and in every cell that enters later."""
        self.config = config or ConfidenceConfig()
        self._grid = grid
        self._values = grid.new_layer(0.0)

    @property
    def values(self) -> Float32[np.ndarray, "rows columns"]:
        """C in [0, 1], indexed like the grid's probability."""
        return self._grid.unrolled(self._values)

    @property
    def stale(self) -> Bool[np.ndarray, "rows columns"]:
        """Cells to look at again: C < lambda_cf."""
        return np.asarray(self.values < self.config.stale_below)

    def see(self, visible: Bool[np.ndarray, "rows columns"]) -> None:
        """Set C = 1 inside the field of view (R_g of the seed).

        Args:
            visible: Mask indexed like the grid's probability.

        Raises:
            InputError: The mask has another shape.
        """
        self._check(visible)
        self._values[self._grid.rolled(visible)] = 1.0

    def restore(self, values: Float32[np.ndarray, "rows columns"]) -> None:
        """Replace the values by those of a saved map, indexed like the grid's probability."""
        self._check(values)
        self._values[...] = self._grid.rolled(values)

    def decay(self, seconds: float) -> None:
        """Decrease confidence by a time, s; call before `see`, so that cells in view stay at 1."""
        np.maximum(
            self._values - np.float32(self.config.loss_per_s * seconds), 0.0, out=self._values
        )

    def _check(self, cells: np.ndarray) -> None:
        if cells.shape != self._values.shape:
            raise InputError(
                f"confidence: array of shape {cells.shape}, expected {self._values.shape}"
            )


def looked_at(
    view: SegmentedView, grid: EgocentricGrid, farthest_m: float
) -> Bool[np.ndarray, "n n"]:
    """R_g of seed 001: cells whose centre, on the floor, is in the field of view and within range."""
    centres = grid.centres()
    floor_points = np.concatenate([centres, np.zeros((*centres.shape[:2], 1))], axis=-1)
    camera_points = view.T_map_camera.inverse().apply(floor_points)
    inside = view.depth.camera.contains(view.depth.camera.project(camera_points))
    return inside & (camera_points[..., 2] < farthest_m)
