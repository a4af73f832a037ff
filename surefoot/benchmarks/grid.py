"""Update of the terrain map from one depth image, against octomap's insertion of the same points.

Octomap is three-dimensional and clears space along rays; ours is 2.5-dimensional: probability, stamp, mean
height and its variance on the floor plane, free where the floor was seen. Both get the same points and are compared
by the same question: which columns contain an obstacle. `discretize=True` is octomap's fast mode for dense points.

The hardest peer is the same map in NumPy: points are counted and summed by `bincount`, cells are updated as arrays. It
clears no cells along rays, and knows no moving obstacles.
"""

from __future__ import annotations

import importlib
import math
from contextlib import suppress
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from mapping.grid.egocentric_grid import EgocentricGrid, GridConfig
from mapping.grid.evidence import FIRST_FLOOR, FIRST_OBSTACLE, OBSTACLE_POINTS, log_odds
from mapping.grid.heights import GATE_SIGMAS, floor_form, pose_form
from perception.primitives.camera import Camera
from perception.primitives.gaussian import Gaussian
from perception.primitives.plane import Plane
from perception.primitives.pose import Pose3, head_rotation

from .benchmark import Benchmark, Comparison, mean_ratio, race

GRIDS = ((0.05, 3.55), (0.02, 3.50))  # cell, side, m
SIZES = ((176, 144), (640, 480))  # 25k and 307k pixels
HEIGHT_M, TILT_RAD = 0.4, math.radians(32.0)
CEILING_M = 0.56  # seed 003: height of the robot plus 0.1 m
OBSTACLE_M = 0.03  # points above this belong to an obstacle


class MapInput(NamedTuple):
    """Input of the map for one frame: points, flags and standard deviations."""

    xyz: np.ndarray
    is_obstacle: np.ndarray
    is_moving: np.ndarray
    sigma_m: np.ndarray


def map_input(width: int, height: int, rng: np.random.Generator) -> MapInput:
    """A floor with five boxes and a wall, seen from the head of a small robot, with depth noise."""
    camera = Camera.from_view(width, height, math.radians(60.0), math.radians(47.0))
    rays = camera.rays @ head_rotation(0.0, TILT_RAD).T
    with np.errstate(divide="ignore"):
        z = np.where(rays[..., 2] < -1e-3, -HEIGHT_M / rays[..., 2], np.inf)
        z = np.minimum(z, 2.4 / rays[..., 0])  # a wall at 2.4 m
    for _ in range(5):
        u, v = rng.integers(0, width * 5 // 6), rng.integers(height // 5, height * 3 // 5)
        box = np.s_[v : v + height // 5, u : u + width // 6]
        z[box] = np.minimum(z[box], rng.uniform(0.6, 1.5))
    sigma = 0.0012 + 0.0019 * (z - 0.4) ** 2
    noisy = (z + sigma * rng.standard_normal(z.shape))[..., None]
    T_map_camera = Pose3.from_rotation(head_rotation(0.0, TILT_RAD), np.array([0.0, 0.0, HEIGHT_M]))
    xyz = T_map_camera.apply((camera.rays * noisy).reshape(-1, 3))
    used = np.isfinite(xyz).all(axis=1) & (xyz[:, 2] < CEILING_M)
    xyz = np.ascontiguousarray(xyz[used])
    drop = np.abs(xyz[:, 2] - HEIGHT_M) / noisy.ravel()[used]
    flags = xyz[:, 2] > OBSTACLE_M
    return MapInput(xyz, flags, np.zeros(len(xyz), np.bool_), sigma.ravel()[used] * drop)


FLOOR = Plane(np.array([0.0, 0.0, 1.0]), 0.0, np.diag([1e-6, 1e-6, 1e-6]))
POSE = Gaussian(np.zeros(3), np.diag([1e-4, 1e-4, 1e-4]))


class NumpyGrid:
    """Log-odds, time of the update, mean height and its variance of every cell, [row, column]."""

    def __init__(self, grid: EgocentricGrid) -> None:
        n, self._config = grid.config.cells, grid.config
        self._low, self._shape = grid.origin, (n, n)
        self.log_odds, self.stamp_s = np.full(n * n, np.inf), np.zeros(n * n)
        self.height, self.variance = np.full(n * n, np.nan), np.full(n * n, np.nan)
        self._raised = np.zeros(n * n, np.bool_)
        x, y = self._low[:, None] + (np.arange(n) + 0.5) * grid.cell_m
        place = np.stack([*np.meshgrid(x, y), np.ones((n, n))], axis=-1).reshape(-1, 3)
        self._floor, self._pose = (
            np.einsum("ni,ij,nj->n", place, form, place)
            for form in (floor_form(FLOOR), pose_form(POSE))
        )

    def update(self, seen: MapInput, stamp_s: float) -> None:
        """Update all cells by one frame."""
        n, cells = self._shape[0], self.log_odds.size
        column, row = np.floor((seen.xyz[:, :2] - self._low) / self._config.cell_m).T
        inside = (column >= 0) & (column < n) & (row >= 0) & (row < n)
        kind = np.where(inside, row * n + column + cells * seen.is_obstacle, 2 * cells).astype(int)
        z = seen.xyz[:, 2]
        size = 2 * cells + 1
        count = np.bincount(kind, minlength=size)[:-1].reshape(2, cells)
        total, squares, noise = (
            np.bincount(kind, weights, size)[:-1].reshape(2, cells)
            for weights in (z, z * z, seen.sigma_m**2)
        )
        rising = count[1] >= OBSTACLE_POINTS
        touched = np.flatnonzero(rising | (count[0] > 0))
        which = rising[touched].astype(int)
        old, weights = self.log_odds[touched], self._config.evidence
        unseen = np.isinf(old)
        up = np.where(
            unseen, log_odds(FIRST_OBSTACLE), np.minimum(old + weights.obstacle, weights.limit)
        )
        down = np.where(
            unseen, log_odds(FIRST_FLOOR), np.maximum(old + weights.floor, -weights.limit)
        )
        self.log_odds[touched] = odds = np.where(which, up, down)
        self.stamp_s[touched] = stamp_s
        gone = touched[self._raised[touched] != (odds > 0.0)]
        self.height[gone], self.variance[gone] = np.nan, np.nan
        self._raised[touched] = odds > 0.0
        measured = which == (odds > 0.0)
        self._fuse(
            touched[measured], [s[which, touched][measured] for s in (count, total, squares, noise)]
        )

    def _fuse(self, at: np.ndarray, sums: list[np.ndarray]) -> None:
        """Fuse the heights of these cells: count, sums of heights, of their squares and of the variances."""
        count, total, squares, noise = sums
        mean = total / count
        spread = np.maximum(0.0, squares / count - mean * mean)
        each = np.maximum(spread * count / np.maximum(1, count - 1), noise / count)
        shared = self._floor[at] + 12.0 * spread / self._config.cell_m**2 * self._pose[at]
        new = each / count + self._config.height_sigma_m**2 + shared
        height, variance = self.height[at], self.variance[at]
        gain = variance / (variance + new)
        known = (mean - height) ** 2 <= GATE_SIGMAS**2 * (variance + new)
        fused = np.maximum((1.0 - gain) * variance, np.minimum(shared, variance))
        self.height[at] = np.where(known, height + gain * (mean - height), mean)
        self.variance[at] = np.where(known, fused, new)


def updater(grid: EgocentricGrid, seen: MapInput) -> partial[None]:
    """Update of the grid, as the pipeline calls it."""
    return partial(
        grid.update,
        seen.xyz,
        seen.is_obstacle,
        1.0,
        np.zeros(2),
        is_moving=seen.is_moving,
        sensor_height_m=HEIGHT_M,
        sigma_m=seen.sigma_m,
        floor=FLOOR,
        pose=POSE,
    )


def run() -> Comparison:
    """Two image sizes and two cell sizes; the ratio is the geometric mean of the four."""
    octomap: Any = None
    with suppress(ImportError):
        octomap = importlib.import_module("octomap")
    times: dict[str, float] = {}
    ratios: dict[str, list[float]] = {}
    accuracy = {"wrong_above_octomap_share": 0.0, "numpy_height_apart_m": 0.0}
    for cell_m, side_m in GRIDS:
        for width, height in SIZES:
            seen = map_input(width, height, np.random.default_rng(0))
            grid = EgocentricGrid(GridConfig(side_m=side_m, cell_m=cell_m), np.zeros(2))
            plain = NumpyGrid(grid)
            candidates: dict[str, Any] = {
                "ours": updater(grid, seen),
                "numpy": partial(plain.update, seen, 1.0),
            }
            apart = _apart(grid, plain, candidates)
            accuracy["numpy_height_apart_m"] = max(accuracy["numpy_height_apart_m"], apart)
            if octomap is not None:
                tree = octomap.OcTree(cell_m)
                camera = np.array([0.0, 0.0, HEIGHT_M])
                candidates["octomap"] = partial(
                    tree.insertPointCloud, seen.xyz, camera, discretize=True
                )
            name = f"{width}x{height}_{round(1e3 * cell_m)}mm"
            taken = race(candidates, rounds=11)
            times.update({f"{who}_{name}_ms": value for who, value in taken.items()})
            for who in taken.keys() - {"ours"}:
                ratios.setdefault(f"ratio_{who}", []).append(taken[who] / taken["ours"])
                accuracy[f"ratio_{who}_{name}"] = ratios[f"ratio_{who}"][-1]
            if octomap is not None and cell_m == GRIDS[0][0]:
                ours, theirs = _right(grid, tree, seen)
                accuracy[f"ours_right_{name}"], accuracy[f"octomap_right_{name}"] = ours, theirs
                worse = max(accuracy["wrong_above_octomap_share"], theirs - ours)
                accuracy["wrong_above_octomap_share"] = worse
    means = {name: mean_ratio(values) for name, values in sorted(ratios.items())}
    fair = {"the same map in NumPy by bincount": means["ratio_numpy"]}
    return Comparison(times, means, accuracy, fair, [] if octomap else ["octomap-python"])


def _apart(grid: EgocentricGrid, plain: NumpyGrid, candidates: dict[str, Any]) -> float:
    """Largest difference of the heights of both maps after three frames, m; all must be where one has any."""
    for _ in range(3):
        candidates["ours"]()
        candidates["numpy"]()
    ours, theirs = grid.height_m, plain.height.reshape(grid.height_m.shape)
    assert np.array_equal(np.isnan(ours), np.isnan(theirs)), "both measure the same cells"
    return float(np.nanmax(np.abs(ours - theirs)))


def _right(grid: EgocentricGrid, tree: Any, seen: MapInput) -> tuple[float, float]:
    """Share of the observed columns that each map classifies correctly."""
    n = grid.config.cells
    cells = grid.cell_of(seen.xyz[:, :2])
    inside = ((cells >= 0) & (cells < n)).all(axis=1)
    rising = seen.is_obstacle & (seen.xyz[:, 2] > 2 * grid.cell_m)  # above the voxels of the floor
    tally = np.zeros((2, n, n), int)
    np.add.at(tally, (rising[inside].astype(int), *cells[inside].T), 1)
    judged = np.argwhere(tally.sum(axis=0) >= 5)
    true = tally[1][tuple(judged.T)] >= 3
    ours = (grid.known & (grid.probability > 0.5))[tuple(judged.T)]
    levels = np.arange(2 * grid.cell_m + 0.5 * grid.cell_m, CEILING_M, grid.cell_m)
    theirs = []
    for row, column in judged:
        x, y = grid.centre_of(row, column)
        nodes = [tree.search(np.array([x, y, z])) for z in levels]
        theirs.append(any(_occupied(tree, node) for node in nodes))
    return float(np.mean(ours == true)), float(np.mean(np.array(theirs) == true))


def _occupied(tree: Any, node: Any) -> bool:
    try:
        return bool(tree.isNodeOccupied(node))
    except Exception:  # the binding's exception for an absent voxel
        return False


BENCHMARK = Benchmark(
    "grid",
    "Terrain map (2.5-D) updated from 25k and 307k points, against octomap (3-D)",
    run,
    {"ratio_octomap": 30.0},
    {"wrong_above_octomap_share": 0.0, "numpy_height_apart_m": 1e-5},
)
