"""The trajectory of a freely moving camera in space: collected frame by frame, written with its covariances.

trajectory.txt holds T_map_camera as TUM text; space_covariance.csv the 6x6 covariances, see
`trajectory_uncertainty`. The map's upright axes may be found some frames after the first one, so poses are kept
in the axes in which their source measures them and transformed when they are written.

Source of the covariance after alignment: Baarda (1973) (change of gauge).
"""

from __future__ import annotations

from array import array
from collections.abc import Iterable

import numpy as np
from jaxtyping import Float

from perception.localisation.camera_pose import CameraPose
from perception.odometry.pose_uncertainty import error_transport, rigid_alignment
from perception.odometry.view_errors import view_error_covariances
from perception.primitives.pose import Pose3
from perception.smoothing.factors import turned_covariance

from .formats import TUM_HEADER
from .gauge import without_gauge
from .run_folder import SPACE_HEADER, RunFolder
from .trajectory_uncertainty import SPACE

UPPER = np.triu_indices(6)
WIDTH = 1 + 7 + len(UPPER[0])  # stamp, pose, covariance


class CameraTrajectory:
    """Poses of one camera, about 230 bytes a frame."""

    def __init__(self) -> None:
        self._rows = array("d")
        self._of_view = np.zeros((6, 6))

    def __len__(self) -> int:
        return len(self._rows) // WIDTH

    def append(self, stamp_s: float, pose: CameraPose) -> None:
        """Add the camera of one frame."""
        T = pose.T_origin_camera
        self._rows.extend((stamp_s, *T.translation, *T.quat_xyzw))
        self._rows.extend(pose.shared[UPPER].tolist())
        self._of_view = pose.of_view

    def write(self, folder: RunFolder, T_map_origin: Pose3 | None) -> None:
        """Write trajectory.txt and space_covariance.csv; nothing if there is no pose.

        Args:
            folder: Run folder.
            T_map_origin: The axes of the poses in the map frame; None leaves the poses as they are.
        """
        if not self._rows:
            return
        table = np.array(self._rows).reshape(-1, WIDTH)
        turn = T_map_origin or Pose3()
        poses = [turn @ Pose3(tuple(row[1:4]), tuple(row[4:8])) for row in table.tolist()]
        write_poses(folder, "trajectory.txt", zip(table[:, 0].tolist(), poses, strict=True))
        shared = np.array([turned_covariance(_full(row), turn.rotation) for row in table[:, 8:]])
        positions = np.array([pose.position for pose in poses])
        own = turned_covariance(self._of_view, turn.rotation)
        views = view_error_covariances(positions, np.array([p.rotation for p in poses]), own)
        start = shared + views.from_start
        aligned = (
            aligned_covariances(positions, shared) + views.aligned
            if _determines_alignment(positions)
            else shared + own
        )
        folder.write_csv(
            SPACE,
            SPACE_HEADER,
            [
                (stamp, *a[UPPER].tolist(), *b[UPPER].tolist())
                for stamp, a, b in zip(table[:, 0].tolist(), start, aligned, strict=True)
            ],
        )


def write_poses(folder: RunFolder, name: str, poses: Iterable[tuple[float, Pose3]]) -> None:
    """Write stamped poses in space as TUM text: stamp tx ty tz qx qy qz qw.

    Args:
        folder: Run folder.
        name: File name.
        poses: Stamp in s and pose, in m, of each.
    """
    lines = [f"{TUM_HEADER}\n"]
    for stamp, pose in poses:
        numbers = (stamp, *pose.translation, *pose.quat_xyzw)
        lines.append(" ".join(repr(float(number)) for number in numbers) + "\n")
    folder.write_text(name, "".join(lines))


def _determines_alignment(positions: Float[np.ndarray, "n 3"]) -> bool:
    """Whether three positions at least are not on one line."""
    return len(positions) >= 3 and bool(
        np.linalg.matrix_rank(positions - positions.mean(axis=0), 1e-9) >= 2
    )


def aligned_covariances(
    positions: Float[np.ndarray, "n 3"], shared: Float[np.ndarray, "n 6 6"]
) -> Float[np.ndarray, "n 6 6"]:
    """Covariances of accumulated errors that remain after the best rigid motion of the whole trajectory.

    Args:
        positions: Of the poses, map axes, m.
        shared: Covariances of the accumulated errors, map axes.
    """
    carry = np.stack([error_transport(position) for position in positions])
    return without_gauge(*rigid_alignment(positions), shared, carry)


def _full(upper: Float[np.ndarray, "21"]) -> Float[np.ndarray, "6 6"]:
    """The symmetric matrix of an upper triangle."""
    matrix = np.zeros((6, 6))
    matrix[UPPER] = upper
    return matrix + np.triu(matrix, 1).T
