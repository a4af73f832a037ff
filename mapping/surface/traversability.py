"""Traversability: height, slope, step and foothold probability per cell of a mapped place.

The surface is projected into cells. Points above the headroom are removed. Each cell keeps its highest point;
its slope is that of the plane through the neighbouring heights, its step the largest height difference within
a foot's width.

Source: layers as in grid_map's traversability (Wermelinger et al. 2016); the probability is ours.
"""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Float32
from scipy import ndimage
from scipy.special import ndtr

from perception.primitives import safe_input
from perception.primitives.errors import ConfigError, InputError
from perception.primitives.safe_input import UnreadableError
from perception.primitives.settings import setting

from ..io import nav2
from ..io.atomic_write import atomic_path
from .meshes import Mesh

log = logging.getLogger(__name__)

SIGMA_M = 0.008  # ours: of a fused height, less than half a voxel of 2 cm
SIGMA_DEG = 4.0  # ours: of a slope from such heights over 12 cm
BELOW_M = 0.15  # ours: surface further below the floor is a reflection or an error
MOST_CELLS = 1 << 24  # ours: 100 by 100 m of 2.5 cm, which take 2.5 GB
AROUND_M = 50.0  # ours: along x and y from its middle, what is kept of a larger map


@dataclass(frozen=True)
class TraversabilityConfig:
    """Resolution, and limits of the robot."""

    cell_m: float = setting(
        0.025, "m", "side of a cell of the traversability map", "ours: above a voxel, no gaps"
    )
    most_step_m: float = setting(
        0.03, "m", "highest step that the robot can take", "ours: clearance of its foot"
    )
    most_slope_deg: float = setting(
        15.0, "deg", "steepest slope on which the robot can stand", "ours: limit of its balance"
    )
    headroom_m: float = 0.7  # ours: DARwIn-OP is 0.45 tall; higher surfaces are no obstacle
    foot_m: float = 0.075  # ours: width over which a step is measured

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"traversability: {name}={value} must be positive and finite")


@dataclass(frozen=True, eq=False)
class Traversability:
    """Layers over the floor; row 0 at the smallest y, column 0 at the smallest x, NaN where unseen.

    Args:
        height: Height of the highest surface below the headroom over the floor z = 0, m.
        slope: Slope of the surrounding ground, rad.
        step: Largest height difference within a foot's width, m.
        probability: Probability that a foot can stand there.
        covered: Share of the cell's area, seen from above, of surface higher than a step; 1 if only a
            vertical wall was seen.
        origin: Lower left corner of cell [0, 0], map frame, m.
        cell_m: Side of a cell, m.
    """

    height: Float32[np.ndarray, "rows columns"]
    slope: Float32[np.ndarray, "rows columns"]
    step: Float32[np.ndarray, "rows columns"]
    probability: Float32[np.ndarray, "rows columns"]
    covered: Float32[np.ndarray, "rows columns"]
    origin: Float[np.ndarray, "2"]
    cell_m: float

    @property
    def known(self) -> Bool[np.ndarray, "rows columns"]:
        """Whether each cell was seen."""
        return np.isfinite(self.height)

    @property
    def occupied(self) -> Bool[np.ndarray, "rows columns"]:
        """Footprint of obstacles: cells more than half covered. For footholds see `probability`."""
        return self.known & (self.covered > 0.5)

    @property
    def centres(self) -> Float[np.ndarray, "rows columns 2"]:
        """Centres of all cells, map frame, m."""
        rows, columns = np.indices(self.height.shape)
        places = np.stack([columns, rows], axis=-1) + 0.5
        return np.asarray(self.origin + self.cell_m * places)


def traversability(mesh: Mesh, config: TraversabilityConfig | None = None) -> Traversability:
    """Layers of a surface in an upright frame whose floor is z = 0.

    Args:
        mesh: The surface, m.
        config: Resolution and robot.

    Returns:
        Layers over the seen area, wherever it lies; without rows for an empty mesh. Of a surface too wide for
        `MOST_CELLS` only what is within `AROUND_M` of its middle; a warning says how much that leaves out.
    """
    config = config or TraversabilityConfig()
    points, area = _dense(mesh)
    near = (points[:, 2] < config.headroom_m) & (points[:, 2] > -BELOW_M)
    points, area = points[near], area[near]
    if len(points) and np.prod(np.ptp(points[:, :2], axis=0) / config.cell_m + 1.0) > MOST_CELLS:
        away = np.abs(points[:, :2] - np.median(points[:, :2], axis=0)).max(axis=1)
        middle = points[np.argmin(away), :2]
        kept = np.abs(points[:, :2] - middle).max(axis=1) < AROUND_M
        log.warning(
            "the surface is too wide for a map with cells of %g m: %.2g %% of it, further than %g m from (%.1f, %.1f) m, "
            "is left out",
            *(config.cell_m, 100.0 * (1.0 - kept.mean()), AROUND_M, *middle),
        )
        points, area = points[kept], area[kept]
    if len(points) == 0:
        nothing = np.zeros((0, 0), np.float32)
        return Traversability(
            nothing, nothing, nothing, nothing, nothing, np.zeros(2), config.cell_m
        )
    first = np.floor(points[:, :2].min(axis=0) / config.cell_m).astype(int)
    column, row = (np.floor(points[:, :2] / config.cell_m).astype(int) - first).T
    height = np.full((row.max() + 1, column.max() + 1), -np.inf, np.float32)
    np.maximum.at(height, (row, column), points[:, 2])
    height[~np.isfinite(height)] = np.nan
    rising = points[:, 2] > config.most_step_m
    high, low = (
        np.bincount(row[mask] * height.shape[1] + column[mask], area[mask], height.size).reshape(
            height.shape
        )
        for mask in (rising, ~rising)
    )
    wall = (high + low < 1e-9) & (height > config.most_step_m)
    covered = np.where(wall, 1.0, high / np.maximum(high + low, 1e-9))
    slope, step = _slope(height, config), _step(height, config)
    step_ok = ndtr((config.most_step_m - step) / (math.sqrt(2.0) * SIGMA_M))
    slope_ok = ndtr((config.most_slope_deg - np.degrees(slope)) / SIGMA_DEG)
    return Traversability(
        height,
        slope,
        step,
        (step_ok * slope_ok).astype(np.float32),
        covered.astype(np.float32),
        first * config.cell_m,
        config.cell_m,
    )


def save_nav2(folder: str | Path, name: str, layers: Traversability) -> Path:
    """Write the map for Nav2: occupied where a foot cannot stand, free where it can; returns the yaml path."""
    blocked = 1.0 - np.nan_to_num(layers.probability, nan=0.5)
    blocked[layers.occupied] = 1.0  # a table top is flat, but no floor
    return nav2.save(
        folder, name, blocked.astype(np.float32), layers.known, layers.origin, layers.cell_m
    )


SHOWN = ("elevation", "slope", "traversability")  # layers of the report, names of grid_map


def save_layers(path: str | Path, layers: Traversability) -> None:
    """Write all layers as .npz, with the names of grid_map: elevation, slope, step, traversability.

    `resolution` is the side of a cell and `origin` the lower left corner of cell [0, 0], m.

    Raises:
        OutputError: The file cannot be written.
    """
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(
            file,
            elevation=layers.height,
            slope=layers.slope,
            step=layers.step,
            traversability=layers.probability,
            covered=layers.covered,
            resolution=np.array(layers.cell_m),
            origin=layers.origin,
        )


def load_layers(path: str | Path) -> dict[str, np.ndarray]:
    """The arrays that `save_layers` wrote, by name.

    Raises:
        InputError: The file is damaged, or lacks a layer, or they are not of one shape.
    """
    try:
        found = safe_input.arrays(path)
    except UnreadableError as error:
        raise InputError(f"layers {path} {error}; map the recording again") from error
    shapes = {found[name].shape if name in found else () for name in SHOWN}
    placed = [found[name].shape if name in found else None for name in ("origin", "resolution")]
    flat = len(shapes) == 1 and len(shapes.pop()) == 2 and placed == [(2,), ()]
    if not (flat and all(one.dtype.kind in "fb" for one in found.values())):
        raise InputError(
            f"layers {path}: expected layers.npz of `surefoot map`; map the recording again"
        )
    if not (found["resolution"] > 0.0 and np.isfinite(found["origin"]).all()):
        raise InputError(f"layers {path}: impossible resolution or origin; map the recording again")
    return found


def _dense(mesh: Mesh) -> tuple[Float32[np.ndarray, "n 3"], Float32[np.ndarray, "n"]]:
    """Samples of a mesh denser than the cells, with the area of their triangles seen from above, m^2.

    The samples are the corners, the centres of the edges and the centre of each triangle.
    """
    a, b, c = (mesh.vertices[mesh.triangles[:, n]] for n in range(3))
    middles = ((a + b) / 2, (b + c) / 2, (c + a) / 2, (a + b + c) / 3)
    area = 0.5 * np.abs(_cross(b - a, c - a))
    points = np.concatenate([a, b, c, *middles]).astype(np.float32)
    return points, np.tile(area, 7).astype(np.float32)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross product of the vectors projected on the floor plane."""
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


def _slope(
    height: Float32[np.ndarray, "rows columns"], config: TraversabilityConfig
) -> Float32[np.ndarray, "rows columns"]:
    """Slope of the least-squares plane through the known cells of 5x5, rad; 0 if it is undetermined."""
    known = np.isfinite(height)
    z = np.where(known, height, 0.0).astype(np.float64)
    w = known.astype(np.float64)
    v, u = (g.astype(np.float64) for g in np.mgrid[-2:3, -2:3])

    def total(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
        return np.asarray(ndimage.correlate(values, weights, mode="constant"))

    n = np.maximum(total(w, np.ones((5, 5))), 1.0)
    su, sv, sz = total(w, u), total(w, v), total(z, np.ones((5, 5)))
    suu, suv = total(w, u * u) - su * su / n, total(w, u * v) - su * sv / n
    svv = total(w, v * v) - sv * sv / n
    suz, svz = total(z, u) - su * sz / n, total(z, v) - sv * sz / n
    det = suu * svv - suv * suv
    good = det > 1.0
    det = np.where(good, det, 1.0)
    a, b = (suz * svv - svz * suv) / det, (svz * suu - suz * suv) / det
    slope = np.where(good, np.arctan(np.hypot(a, b) / config.cell_m), 0.0)
    return np.where(known, slope, np.nan).astype(np.float32)


def _step(
    height: Float32[np.ndarray, "rows columns"], config: TraversabilityConfig
) -> Float32[np.ndarray, "rows columns"]:
    """Height difference of the known cells within a foot's width, m."""
    size = max(3, round(config.foot_m / config.cell_m) | 1)
    known = np.isfinite(height)
    highest = ndimage.maximum_filter(np.where(known, height, -np.inf), size)
    lowest = ndimage.minimum_filter(np.where(known, height, np.inf), size)
    with np.errstate(invalid="ignore"):
        return np.where(known, highest - lowest, np.nan).astype(np.float32)
