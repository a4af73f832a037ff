"""Horizontal scan of vertical surfaces: the fronts of walls and furniture at every bearing.

Of all obstacle points at one bearing, those in the densest range interval form a vertical surface. Each such
point gets the normal of the line through its neighbours. Registration compares these scans: a hundred points
instead of ten thousand, each more certain than any single one.

Source: ours; the use of lines between points: Censi, "An ICP variant using a point-to-line metric" (ICRA
2008).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..primitives.errors import InputError
from ..primitives.pose import Pose2
from . import _registration_kernels as kernels

LOWEST_M = 0.04  # ours: below, floor and wall merge
HIGHEST_M = 0.50  # seed 003: height of the robot + 0.1 m, less the noise of levelling
BEARINGS = 720  # ours: half a degree each; two columns of the time-of-flight camera
LAYER_M = 0.03  # ours: thickness of a surface with its noise, at 3 m
LEAST_POINTS = 5  # ours: fewer in a layer are flying pixels
LEAST_SHARE = 0.4  # ours: of the points of one bearing
SHARED_SIGMA_M = 0.003  # ours: error that all points of one bearing share
NEIGHBOURS_M = 0.10  # ours: a line is fitted to the points within this distance
SPACING_M = 0.02  # ours: closer points add no information
FLATNESS_M = 0.012  # ours: largest standard deviation from the line
LEAST_NEIGHBOURS = 4  # ours


@dataclass(frozen=True)
class Scan:
    """Points on vertical surfaces.

    Args:
        points: On the floor, body frame, m.
        normals: Unit vectors, towards the sensor.
        sigmas: Standard deviation along the normal, m, without the error that the whole scan shares.
    """

    points: Float[np.ndarray, "n 2"]
    normals: Float[np.ndarray, "n 2"]
    sigmas: Float[np.ndarray, "n"]

    def __len__(self) -> int:
        return len(self.points)

    def at(self, pose: Pose2) -> Scan:
        """The scan in the frame that the pose is given in."""
        return Scan(pose.apply(self.points), self.normals @ pose.rotation.T, self.sigmas)


def scan(
    points: Float[np.ndarray, "n 3"],
    sigma: Float[np.ndarray, "n"],
    sensor: Float[np.ndarray, "2"],
) -> Scan:
    """The scan of one sensor.

    Args:
        points: Static points above the floor; upright body frame, z above the floor, m.
        sigma: Standard deviation of each along its ray, m.
        sensor: Position of the sensor in the body frame, m.

    Returns:
        Points in order of bearing; an empty scan without vertical surfaces.

    Raises:
        InputError: The numbers of points and deviations differ.
    """
    if len(points) != len(sigma):
        raise InputError(f"scan: {len(points)} points but {len(sigma)} standard deviations")
    inside = (points[:, 2] > LOWEST_M) & (points[:, 2] < HIGHEST_M)
    inside &= np.isfinite(points).all(axis=1) & (sigma > 0.0) & np.isfinite(sigma)
    fronts, deviations = kernels.fronts(
        np.ascontiguousarray(points[inside, :2], np.float64),
        np.ascontiguousarray(sigma[inside], np.float64),
        np.ascontiguousarray(sensor, np.float64),
        BEARINGS,
        LAYER_M,
        LEAST_POINTS,
        LEAST_SHARE,
    )
    kept, normals = kernels.normals(
        fronts,
        np.ascontiguousarray(sensor, np.float64),
        NEIGHBOURS_M,
        SPACING_M,
        FLATNESS_M,
        LEAST_NEIGHBOURS,
    )
    return Scan(fronts[kept], normals, np.hypot(deviations[kept], SHARED_SIGMA_M))


def joined(scans: list[Scan]) -> Scan:
    """Several scans of one instant as one."""
    if not scans:
        return Scan(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0))
    return Scan(
        np.concatenate([one.points for one in scans]),
        np.concatenate([one.normals for one in scans]),
        np.concatenate([one.sigmas for one in scans]),
    )
