"""What a map says of the sureness of its way: written by `surefoot map`, read by `surefoot evaluate`.

trajectory_covariance.csv has x, y and heading, as every run has. space_covariance.csv has all six degrees of
freedom twice, upper triangles row by row of (x, y, z, rotation vector) in the map's axes, m and rad: start_ij of
the motion since the first image, aligned_ij of what is left after the best motion of the whole way.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from perception.odometry.pose_uncertainty import PoseUncertainty
from perception.primitives.gaussian import Gaussian
from perception.primitives.pose import Pose3

from .run_folder import COVARIANCE_HEADER, SPACE_HEADER, RunFolder, estimate_row
from .tables import Table

SPACE = "space_covariance.csv"
EXACT = 1e-4
"""Deviation of the start, m and rad: where the world begins is known."""


def write_claims(
    folder: RunFolder, stamps: Sequence[float], poses: Sequence[Pose3], claims: PoseUncertainty
) -> None:
    """Write both tables.

    Args:
        folder: Of the map.
        stamps: Of the images, s.
        poses: T_map_camera of each.
        claims: Of each; images with NaN are left out.
    """
    rows, planar = [], []
    upper = np.triu_indices(6)
    for stamp, pose, start, aligned in zip(
        stamps, poses, claims.from_start, claims.aligned, strict=True
    ):
        if np.isfinite(start).all():
            rows.append((stamp, *start[upper].tolist(), *aligned[upper].tolist()))
            planar.append(estimate_row(stamp, flattened(pose, start)))
    folder.write_csv(SPACE, SPACE_HEADER, rows)
    folder.write_csv("trajectory_covariance.csv", COVARIANCE_HEADER, planar)


def flattened(pose: Pose3, covariance: Float[np.ndarray, "6 6"]) -> Gaussian:
    """(x, y, heading of the optical axis) of a camera, with what remains of its covariance.

    Args:
        pose: T_map_camera, map upright.
        covariance: Of (x, y, z, rotation vector), map axes.
    """
    x, y, z = (float(v) for v in pose.rotation[:, 2])
    level = max(x * x + y * y, 1e-6)  # straight down, the heading is anything
    jacobian = np.zeros((3, 6))
    jacobian[0, 0] = jacobian[1, 1] = 1.0
    jacobian[2, 3:] = -x * z / level, -y * z / level, 1.0
    mean = np.array([*pose.position[:2], np.arctan2(y, x)])
    return Gaussian(mean, jacobian @ covariance @ jacobian.T + EXACT**2 * np.eye(3))


def aligned_claims(
    table: Table,
) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n 6 6"]]:
    """Stamps, and covariances after alignment, of space_covariance.csv."""
    numbers = table.matrix(*SPACE_HEADER)
    rows, columns = np.triu_indices(6)
    covariances = np.zeros((len(numbers), 6, 6))
    covariances[:, rows, columns] = covariances[:, columns, rows] = numbers[:, 1 + len(rows) :]
    return numbers[:, 0], covariances
