"""Where a scan fits the map, when the pose is too uncertain to pair its points with their neighbours.

The poses of a raster over three standard deviations are compared: by how many points of the scan lie on a surface of the
map that faces the same way, and by the prior. The scan is found if nearly all of the probability is near one pose, and
the prior expects the robot there rather than in view of what the map lacks, which may look the same by chance. Along
a wall, where every place fits alike, the prior decides.

Source: Olson, "Real-time correlative scan matching" (ICRA 2009); surfaces by direction, and the tests for a second
place, are ours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from ..primitives.gaussian import Gaussian
from ..primitives.pose import Pose2, wrap_angle
from . import _registration_kernels as kernels
from .scan import Scan, joined

SIGMAS = 3.0  # ours: half width of the raster, in standard deviations
CELL_M = 0.06  # ours: of the raster; registration goes on from there
MOST_CELLS = 30  # ours: from the middle of the raster to its edge; a wider one has larger cells
ARM_M = 0.7  # ours: a turn by one step moves a point at this distance by a cell
NEAR_CELLS = 2.4  # ours: a point farther from a surface does not lie on it
SECTORS = 12  # ours: directions of surfaces, 30 deg each
POINTS = 60  # ours: of the scan, which are compared
EVIDENCE = 25.0  # ours: number of independent points as which a scan counts
LEAST_NEARNESS = 0.4  # ours: mean over the points; lower in a place that the map lacks
KNOWN_SHARE = 0.5
"""Ours: least share of the points in known cells; with fewer the place is not in the map."""
SAME_CELLS = np.array([6.0, 6.0, 3.0])
"""Ours: from poses as near as this, in x, y and turn, registration comes to the same."""
ALIKE = 0.3  # ours: a place that the map lacks looks like one of it by chance; per what it is less likely to fit here
SURE = 0.95  # ours: probability near the best pose from which on there is no second one


def find(scan: Scan, views: Sequence[tuple[Pose2, Scan]], prior: Gaussian) -> Pose2 | None:
    """The pose from which the scan was taken, to within a cell.

    Args:
        scan: Sensor frame.
        views: The map: scans of other frames, and where they were taken, world frame.
        prior: Over (x, y, yaw) of the sensor, m and rad, world frame.

    Returns:
        None if too few points fit anywhere, or two places may fit alike.
    """
    if len(scan) == 0 or not views:
        return None
    reach = SIGMAS * np.sqrt(np.diag(prior.covariance))
    cell = max(CELL_M, float(reach[:2].max()) / MOST_CELLS)
    along, across = (cell * _steps(float(r) / cell) for r in reach[:2])
    turns = cell / ARM_M * _steps(min(float(reach[2]), math.pi) * ARM_M / cell)
    moves = np.stack(np.meshgrid(along, across, indexing="ij"), axis=-1).reshape(-1, 2)
    offsets = np.column_stack([np.tile(moves, (len(turns), 1)), np.repeat(turns, len(moves))])
    raster = _Raster.of(views, cell)
    thin = slice(None, None, math.ceil(len(scan) / POINTS))
    x, y, yaw = prior.mean.tolist()
    fits = [raster.fit(scan.at(Pose2(x, y, yaw + turn)), thin, moves) for turn in turns.tolist()]
    nearness, known = np.concatenate(fits, axis=1)
    expected = -0.5 * np.sum(offsets * np.linalg.solve(prior.covariance, offsets.T).T, axis=1)
    log = EVIDENCE * nearness + expected
    best = int(np.argmax(log))
    away = offsets - offsets[best]
    away[:, 2] = np.remainder(away[:, 2] + math.pi, 2.0 * math.pi) - math.pi  # either way
    same = (np.abs(away) / cell * [1.0, 1.0, ARM_M] <= SAME_CELLS).all(axis=1)
    likely, before = np.exp(log - log[best]), np.exp(expected)
    if (
        nearness[best] < LEAST_NEARNESS
        or likely[same].sum() < SURE * likely.sum()
        or before[same].sum() < ALIKE * before[known < KNOWN_SHARE].sum()
    ):
        return None
    x, y, yaw = (prior.mean + offsets[best]).tolist()
    return Pose2(x, y, wrap_angle(yaw))


def _steps(most: float) -> Int[np.ndarray, "n"]:
    """Whole numbers around 0, up to at least this."""
    last = math.ceil(most)
    return np.arange(-last, last + 1)


@dataclass(frozen=True)
class _Raster:
    """The map in cells.

    Args:
        near: By direction of the surface, how near each cell is to one: 1 on it, 0 far from it.
        known: Whether each cell was in view.
        corner: Middle of the first cell, m.
        cell: Side of a cell, m.
    """

    near: Float32[np.ndarray, "s h w"]
    known: Bool[np.ndarray, "h w"]
    corner: Float[np.ndarray, "2"]
    cell: float

    @classmethod
    def of(cls, views: Sequence[tuple[Pose2, Scan]], cell: float) -> _Raster:
        """Draw the scans."""
        surfaces = joined([scan.at(pose) for pose, scan in views])
        eyes = np.array([[pose.x, pose.y] for pose, _ in views])
        every = np.concatenate([surfaces.points, eyes])
        margin = math.ceil(NEAR_CELLS) + 1
        corner = every.min(axis=0) - margin * cell
        where = np.rint((surfaces.points - corner) / cell).astype(int)
        shape = tuple(
            (np.rint((every.max(axis=0) - corner) / cell).astype(int) + 1 + margin).tolist()
        )
        near = np.zeros((SECTORS, *shape), np.float32)
        sector = _direction(surfaces.normals)
        for k in range(SECTORS):
            off = np.abs((sector - k + SECTORS / 2) % SECTORS - SECTORS / 2)
            chosen = where[off <= 1.0]
            if len(chosen):
                empty = np.ones(shape, np.uint8)
                empty[chosen[:, 0], chosen[:, 1]] = 0
                away = cv2.distanceTransform(empty, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
                near[k] = np.maximum(1.0 - away / NEAR_CELLS, 0.0)
        seen = np.asarray(np.any(near > 0.0, axis=0), np.uint8)
        for (pose, scan), eye in zip(views, eyes, strict=True):
            order = np.argsort(np.arctan2(scan.points[:, 1], scan.points[:, 0]))
            outline = np.concatenate([eye[None], pose.apply(scan.points[order])])
            cells = np.rint((outline - corner) / cell).astype(np.int32)
            cv2.fillPoly(seen, [np.ascontiguousarray(cells[:, ::-1])], (1,))
        return cls(near, np.asarray(seen > 0), corner, cell)

    def fit(
        self, level: Scan, thin: slice, moves: Float[np.ndarray, "m 2"]
    ) -> Float[np.ndarray, "2 m"]:
        """Mean nearness of the points to surfaces, and the share of them in known cells, after each of the moves."""
        sector = np.rint(_direction(level.normals[thin])).astype(np.int64) % SECTORS
        places = (level.points[thin] - self.corner) / self.cell
        found = np.empty((2, len(moves)))
        kernels.nearness(places, sector, moves / self.cell, self.near, self.known, *found)
        return found


def _direction(normals: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n"]:
    """Direction of each normal, in sectors."""
    return np.asarray(np.arctan2(normals[:, 1], normals[:, 0]) * SECTORS / (2.0 * math.pi))
