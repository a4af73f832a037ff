"""Poses on the floor and in space.

`Pose2` is a pose on the floor; `Pose3` is a rigid motion, stored as translation and unit quaternion, so that it can be
written to a file and read back to the same bits.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from .errors import InputError

ROTATION_TOLERANCE = 0.01
"""Ours: of R R^T; matrices that KinectFusion prints are orthogonal to 1e-3."""


def wrap_angle(angle_rad: float) -> float:
    """The same angle in [-pi, pi)."""
    turned = (angle_rad + math.pi) % (2.0 * math.pi) - math.pi
    return turned if turned < math.pi else -math.pi  # rounding may give pi


def times(
    matrix: Float[np.ndarray, "m n"], other: Float[np.ndarray, "n *p"]
) -> Float[np.ndarray, "m *p"]:
    """Product of a small matrix and a vector or matrix, by plain sums.

    `@` calls a BLAS library whose last bits depend on the processor. Contacts of a simulated body amplify them within a
    second, and a walk could not be repeated on another machine.
    """
    return np.einsum("ij,j...->i...", matrix, other)


@dataclass(frozen=True)
class Pose2:
    """Position and heading on the floor: x, y in m, yaw in rad, counter-clockwise."""

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0

    def __matmul__(self, other: Pose2) -> Pose2:
        """Compose: `T_a_c = T_a_b @ T_b_c`; the yaw stays in [-pi, pi)."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        return Pose2(
            self.x + c * other.x - s * other.y,
            self.y + s * other.x + c * other.y,
            wrap_angle(self.yaw + other.yaw),
        )

    def inverse(self) -> Pose2:
        """`T_b_a` from `T_a_b`."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        return Pose2(-c * self.x - s * self.y, s * self.x - c * self.y, wrap_angle(-self.yaw))

    def apply(self, points: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 2"]:
        """Map points (..., 2), m, from the frame of the pose to its parent frame."""
        return np.asarray(points @ self.rotation.T + np.array([self.x, self.y]))

    @property
    def rotation(self) -> Float[np.ndarray, "2 2"]:
        """Rotation matrix of the yaw."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        return np.array([[c, -s], [s, c]])

    @property
    def vector(self) -> Float[np.ndarray, "3"]:
        """(x, y, yaw) as an array, m and rad."""
        return np.array([self.x, self.y, self.yaw])

    def lifted(self) -> Pose3:
        """The same pose in space: upright, at z = 0."""
        return Pose3(
            (self.x, self.y, 0.0), (0.0, 0.0, math.sin(self.yaw / 2), math.cos(self.yaw / 2))
        )


@dataclass(frozen=True)
class Pose3:
    """A rigid motion: translation in m, unit quaternion in the order x, y, z, w.

    The quaternion is normalised only in the rotation matrix, so that writing and reading keep its bits.
    """

    translation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    quat_xyzw: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)

    @staticmethod
    def from_matrix(matrix: Float[np.ndarray, "4 4"] | Sequence[Sequence[float]]) -> Pose3:
        """From a homogeneous matrix.

        Raises:
            InputError: The matrix is not (4, 4) numbers, one is not finite, or it is not a rigid motion.
        """
        try:
            matrix = np.asarray(matrix, np.float64)
        except (TypeError, ValueError) as error:
            raise InputError(
                f"matrix of a pose is no array of numbers ({error}); expected (4, 4)"
            ) from error
        if matrix.shape != (4, 4):
            raise InputError(
                f"matrix of a pose has shape {matrix.shape}; expected (4, 4); from a rotation and a translation: "
                "Pose3.from_rotation(R, t)"
            )
        rotation = matrix[:3, :3]
        if not np.isfinite(matrix).all():
            raise InputError("pose has a value that is not finite")
        fault = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
        if fault > ROTATION_TOLERANCE:
            raise InputError(f"pose is invalid: R R^T differs from 1 by {fault:.2f}")
        if np.linalg.det(rotation) < 0.0:
            raise InputError("pose is invalid: its determinant is -1 (a reflection)")
        if np.abs(matrix[3] - [0.0, 0.0, 0.0, 1.0]).max() > 1e-6:
            raise InputError("pose is invalid: its last row is not 0 0 0 1")
        return Pose3.from_rotation(rotation, matrix[:3, 3])

    @staticmethod
    def from_rotation(
        rotation: Float[np.ndarray, "3 3"], translation: Float[np.ndarray, "3"]
    ) -> Pose3:
        """From a rotation matrix and a translation in m."""
        tx, ty, tz = (float(v) for v in translation)
        return Pose3((tx, ty, tz), _quaternion(rotation))

    @cached_property
    def rotation(self) -> Float[np.ndarray, "3 3"]:
        """Rotation matrix."""
        x, y, z, w = np.array(self.quat_xyzw) / math.sqrt(sum(q * q for q in self.quat_xyzw))
        return np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
            ]
        )

    @cached_property
    def position(self) -> Float[np.ndarray, "3"]:
        """Translation as an array, m."""
        return np.array(self.translation)

    @property
    def matrix(self) -> Float[np.ndarray, "4 4"]:
        """Homogeneous matrix."""
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = self.rotation, self.position
        return matrix

    def __matmul__(self, other: Pose3) -> Pose3:
        """Compose: `T_a_c = T_a_b @ T_b_c`."""
        return Pose3.from_rotation(
            times(self.rotation, other.rotation),
            times(self.rotation, other.position) + self.position,
        )

    def inverse(self) -> Pose3:
        """`T_b_a` from `T_a_b`."""
        return Pose3.from_rotation(self.rotation.T, -times(self.rotation.T, self.position))

    def apply(self, points: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """Map points (..., 3), m, from the frame of the pose to its parent frame."""
        return np.asarray(points @ self.rotation.T + self.position)

    def flattened(self) -> Pose2:
        """Projection on the floor: x, y and the heading of the x axis."""
        return Pose2(
            self.translation[0],
            self.translation[1],
            math.atan2(self.rotation[1, 0], self.rotation[0, 0]),
        )


CAMERA_IN_BODY_AXES = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""R_opt of seed 000: camera axes (right, down, ahead) in body axes (ahead, left, up)."""


def head_rotation(pan_rad: float, tilt_rad: float) -> Float[np.ndarray, "3 3"]:
    """Camera axes in body axes for a head panned left and tilted down, rad."""
    c, s = math.cos(pan_rad), math.sin(pan_rad)
    yaw = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    c, s = math.cos(tilt_rad), math.sin(tilt_rad)
    pitch = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    return times(times(yaw, pitch), CAMERA_IN_BODY_AXES)


def _quaternion(rotation: Float[np.ndarray, "3 3"]) -> tuple[float, float, float, float]:
    """Unit quaternion (x, y, z, w) of a rotation matrix, from its largest component (Shepperd 1978)."""
    r = rotation
    squares = np.array(
        [
            1 + r[0, 0] - r[1, 1] - r[2, 2],
            1 - r[0, 0] + r[1, 1] - r[2, 2],
            1 - r[0, 0] - r[1, 1] + r[2, 2],
            1 + r[0, 0] + r[1, 1] + r[2, 2],
        ]
    )
    largest = int(np.argmax(squares))
    products = np.array(
        [
            [squares[0], r[0, 1] + r[1, 0], r[0, 2] + r[2, 0], r[2, 1] - r[1, 2]],
            [r[0, 1] + r[1, 0], squares[1], r[1, 2] + r[2, 1], r[0, 2] - r[2, 0]],
            [r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], squares[2], r[1, 0] - r[0, 1]],
            [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], squares[3]],
        ]
    )[largest]
    x, y, z, w = (float(v) for v in products / math.hypot(*products))
    return x, y, z, w
