"""Covariances of a camera trajectory in space: tables that `surefoot evaluate` reads.

trajectory_covariance.csv has x, y and heading, as for every run. space_covariance.csv has two 6x6 covariances per
pose, as upper triangles row by row, over (x, y, z, rotation vector) in map axes, m and rad: start_ij is that of
the pose relative to the first image, aligned_ij that of the error left after rigid alignment of the trajectory.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from perception.odometry.pose_uncertainty import PoseUncertainty, planar_gaussian
from perception.primitives.pose import Pose3

from .run_folder import COVARIANCE_HEADER, SPACE_HEADER, RunFolder, estimate_row
from .tables import Table

SPACE = "space_covariance.csv"


def write_covariances(
    folder: RunFolder, stamps: Sequence[float], poses: Sequence[Pose3], claims: PoseUncertainty
) -> None:
    """Write both tables.

    Args:
        folder: Run folder.
        stamps: Stamps of the images, s.
        poses: T_map_camera of each image.
        claims: Covariances of each image; images with NaN are left out.
    """
    rows, planar = [], []
    upper = np.triu_indices(6)
    for stamp, pose, start, aligned in zip(
        stamps, poses, claims.from_start, claims.aligned, strict=True
    ):
        if np.isfinite(start).all():
            rows.append((stamp, *start[upper].tolist(), *aligned[upper].tolist()))
            planar.append(estimate_row(stamp, planar_gaussian(pose, start)))
    folder.write_csv(SPACE, SPACE_HEADER, rows)
    folder.write_csv("trajectory_covariance.csv", COVARIANCE_HEADER, planar)


def read_aligned_covariances(
    table: Table,
) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n 6 6"]]:
    """Stamps and aligned covariances of space_covariance.csv."""
    numbers = table.matrix(*SPACE_HEADER)
    rows, columns = np.triu_indices(6)
    covariances = np.zeros((len(numbers), 6, 6))
    covariances[:, rows, columns] = covariances[:, columns, rows] = numbers[:, 1 + len(rows) :]
    return numbers[:, 0], covariances
