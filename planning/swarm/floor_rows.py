"""Floor geometry of the rows of a picture: for an upright camera each row is one distance ahead.

The frame has its origin on the floor under the body and its x axis along the heading of the camera, so that every row is
a line of constant x ("ahead") and every pixel of it has the same width on the floor.

Source: Han 2018 (seed 000), eq. (1) and (2), solved for points on the floor.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from perception.primitives.camera import Camera
from perception.primitives.errors import InputError
from perception.primitives.pose import Pose3

UPRIGHT_RAD = math.radians(0.05)
"""Ours: a roll that moves no pixel of 720 by more than a third of one."""
SWAY_RAD = math.radians(5.0)
"""Ours: in walking trials the trunk rolls by 2.8 deg in 1 % of the pictures."""
MOST_ROLL_RAD = math.radians(45.0)


@dataclass(frozen=True, eq=False)
class FloorRows:
    """The floor seen by a camera on the body.

    Args:
        camera: Pinhole model.
        heading_rad: Of the camera in the body frame, left positive.
        tilt_rad: Down positive.
        eye: (ahead, left, up) of the camera in the frame of this module, m.
        ahead: Distance of the floor in each row, m; NaN at and above the horizon.
        per_px: Width of a column on the floor in each row, m; NaN at and above the horizon.
        lines: (p0, p1, q0, q1): x / depth = p0 + p1 v and 1 / depth = q0 + q1 v on the floor.
    """

    camera: Camera
    heading_rad: float
    tilt_rad: float
    eye: tuple[float, float, float]
    ahead: Float[np.ndarray, "h"]
    per_px: Float[np.ndarray, "h"]
    lines: Float[np.ndarray, "4"]

    def row_of(self, ahead_m: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        """Row, with a fraction, of the floor at a distance ahead; may lie outside the picture."""
        away, up = ahead_m - self.eye[0], self.eye[2]
        c, s = math.cos(self.tilt_rad), math.sin(self.tilt_rad)
        depth = np.maximum(away * c + up * s, 1e-9)
        return np.asarray(self.camera.cy + self.camera.fy * (up * c - away * s) / depth)

    def floor_of(self, pixels: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """Floor points (x ahead, y left) in the body frame, m, of pixels (u, v); NaN above the horizon."""
        depth = 1.0 / _positive(self.lines[2] + self.lines[3] * pixels[:, 1])
        ahead = (self.lines[0] + self.lines[1] * pixels[:, 1]) * depth
        left = self.eye[1] - (pixels[:, 0] - self.camera.cx) / self.camera.fx * depth
        c, s = math.cos(self.heading_rad), math.sin(self.heading_rad)
        return np.stack([c * ahead - s * left, s * ahead + c * left], axis=1)

    @staticmethod
    def of(camera: Camera, T_body_camera: Pose3) -> FloorRows:
        """From the pose of a camera on the body; its roll is removed (`upright`).

        Raises:
            InputError: The picture is distorted, or the camera is not above the floor.
        """
        if camera.is_distorted:
            raise InputError("swarm: the picture is distorted; rectify it first")
        T_body_camera = T_body_camera @ _rolled(-roll_of(T_body_camera))
        right, axis = T_body_camera.rotation[:, 0], T_body_camera.rotation[:, 2]
        x, y, up = T_body_camera.translation
        if not up > 0.0:
            raise InputError(f"swarm: the camera is {up} m above the floor; expected more than 0")
        tilt = math.asin(max(-1.0, min(1.0, -float(axis[2]))))
        heading = math.atan2(float(right[0]), -float(right[1]))
        c, s = math.cos(heading), math.sin(heading)
        eye = (c * x + s * y, -s * x + c * y, up)
        ct, st = math.cos(tilt), math.sin(tilt)
        q1 = ct / (camera.fy * up)
        q0 = st / up - q1 * camera.cy
        p1 = eye[0] * q1 - st / camera.fy
        p0 = eye[0] * q0 + ct + st * camera.cy / camera.fy
        rows = np.arange(camera.height)
        depth = 1.0 / _positive(q0 + q1 * rows)
        return FloorRows(
            camera,
            heading,
            tilt,
            eye,
            np.asarray((p0 + p1 * rows) * depth),
            np.asarray(depth / camera.fx),
            np.array([p0, p1, q0, q1]),
        )


def roll_of(T_body_camera: Pose3) -> float:
    """Roll of the camera about its optical axis, clockwise, rad."""
    right, down = T_body_camera.rotation[2, 0], T_body_camera.rotation[2, 1]
    return math.atan2(-float(right), -float(down))


def upright(
    movable: UInt8[np.ndarray, "h w"], camera: Camera, T_body_camera: Pose3
) -> UInt8[np.ndarray, "h w"]:
    """The mask rotated to the view of an upright camera.

    The wedges from outside the picture repeat its border; as blocked pixels they would close the space before the feet at
    a degree of roll. Wedges larger than those of a walk are blocked.

    Raises:
        InputError: The camera rolls by more than 45 deg.
    """
    angle = roll_of(T_body_camera)
    if abs(angle) > MOST_ROLL_RAD:
        raise InputError(
            f"swarm: the camera rolls by {math.degrees(angle):.0f} deg, expected at most "
            f"{math.degrees(MOST_ROLL_RAD):.0f}; rotate the picture first"
        )
    if abs(angle) < UPRIGHT_RAD:
        return movable
    K = camera.matrix
    turned = K @ _rolled(-angle).rotation.T @ np.linalg.inv(K)
    size = (camera.width, camera.height)
    border = cv2.BORDER_REPLICATE if abs(angle) <= SWAY_RAD else cv2.BORDER_CONSTANT
    return np.asarray(
        cv2.warpPerspective(movable, turned, size, flags=cv2.INTER_NEAREST, borderMode=border),
        np.uint8,
    )


def _rolled(angle_rad: float) -> Pose3:
    """A rotation about the optical axis, clockwise seen from behind the camera."""
    return Pose3(quat_xyzw=(0.0, 0.0, math.sin(angle_rad / 2), math.cos(angle_rad / 2)))


def _positive(values: np.ndarray) -> np.ndarray:
    return np.where(values > 1e-9, values, np.nan)
