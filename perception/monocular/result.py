"""Result of one monocular cycle: the image of free floor in which the swarm searches, and all stages before it.

A cycle uses two pictures, taken at T_SS - dT and at T_SS, each with its own camera pose. Masks have the size of the
pictures (h, w), values 255 and 0, and are indexed [v, u]. World frame: z up, floor at z = 0.

Source: seed 000, section 2 and section 3, Fig. 2 and Fig. 8.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int, UInt8

from ..primitives.camera import Camera
from ..primitives.errors import InputError
from ..primitives.pose import Pose3

MIN_SIDE_PX = 16  # ours: smaller pictures have no patch of floor and no edge of five columns
OVERTURNED = 1e-6  # ours: rounding error of a camera that looks straight down


@dataclass(frozen=True, eq=False)
class Picture:
    """A colour picture with its camera pose.

    Args:
        rgb: (h, w, 3), red first.
        camera: Intrinsics, for the size of `rgb`.
        T_world_camera: Pose of the camera above the floor z = 0 (M_C or M_P of seed 000, times R_opt).
        stamp_s: Time of the picture, s.

    Raises:
        InputError: The image is not (h, w, 3) of uint8, is too small, or has another size than its camera; the
            pose is not finite, below the floor, or that of a camera held upside down.
    """

    rgb: UInt8[np.ndarray, "h w 3"]
    camera: Camera
    T_world_camera: Pose3
    stamp_s: float

    def __post_init__(self) -> None:
        self._check_image()
        self._check_pose()

    def _check_image(self) -> None:
        rgb, camera = self.rgb, self.camera
        if rgb.ndim != 3 or rgb.shape[2] != 3 or rgb.dtype != np.uint8:
            raise InputError(
                f"picture: an image of shape {rgb.shape} and type {rgb.dtype}; expected (h, w, 3) of uint8, red first; "
                "convert it"
            )
        height, width = rgb.shape[:2]
        if (width, height) != (camera.width, camera.height):
            raise InputError(
                f"picture: the image has {width}x{height} px, its camera {camera.width}x{camera.height}; "
                "give the intrinsics of that image"
            )
        if min(width, height) < MIN_SIDE_PX:
            raise InputError(
                f"picture: the image has {width}x{height} px; both sides must have at least {MIN_SIDE_PX}"
            )

    def _check_pose(self) -> None:
        pose = self.T_world_camera
        norm = math.hypot(*pose.quat_xyzw)
        if (
            not all(map(math.isfinite, (*pose.translation, self.stamp_s)))
            or not 0.0 < norm < math.inf
        ):
            raise InputError(
                f"picture: its pose {pose.translation} m, {pose.quat_xyzw} at {self.stamp_s} s must be finite; "
                "skip such a frame"
            )
        if not pose.translation[2] > 0.0:
            raise InputError(
                f"picture: the camera at z={pose.translation[2]} m must be above the floor z = 0; check the pose"
            )
        if pose.rotation[2, 1] > OVERTURNED:
            raise InputError(
                f"picture: the camera is upside down (its y axis points up, {pose.rotation[2, 1]:+.2f}); "
                "rotate image and pose by 180 deg"
            )


@dataclass(frozen=True, eq=False)
class Flows:
    """Corners tracked from the previous to the current picture, I_of.

    Args:
        previous: (n, 2), pixels (u, v) in the previous picture.
        current: (n, 2), pixels (u, v) in the current picture.
        covariance: (n, 2, 2), of the motion from pixel to pixel, px^2.
        obstacle: (n,), index into `MonocularResult.obstacles`, -1 for none.
        velocity_world: (n, 2), velocity of the corner as if it lay on the floor, m/s; NaN if one of its pixels
            has no floor point.
    """

    previous: Float[np.ndarray, "n 2"]
    current: Float[np.ndarray, "n 2"]
    covariance: Float[np.ndarray, "n 2 2"]
    obstacle: Int[np.ndarray, "n"]
    velocity_world: Float[np.ndarray, "n 2"]

    def __len__(self) -> int:
        return len(self.obstacle)


@dataclass(frozen=True, eq=False)
class SeenObstacle:
    """One obstacle, by its contact edge.

    Args:
        edge: (m, 2), lowest pixel (u, v) of the obstacle in each of its columns, ascending; the pixel below is ground.
        contact_world: (m, 2), floor points of the edge, m; NaN beyond `MonocularConfig.farthest_m`.
        flow: Index into `Flows` of the flow of smallest speed, I_of^min; -1 without plausible flow.
        velocity_world: (2,), velocity of that flow, m/s; zero if the obstacle counts as static.
        moving: Whether the speed reaches the threshold, and is no error of its flows by their covariance.
        predicted_world: (m, 2), contact points after `MonocularResult.horizon_s`, m.
        contact_covariance: (m, 2, 2), of each contact point, m^2; errors of the camera pose are common to all.
        velocity_covariance: (2, 2), (m/s)^2; for a static obstacle it includes the measured speed.
        predicted_covariance: (m, 2, 2), of each predicted point, m^2.
    """

    edge: Int[np.ndarray, "m 2"]
    contact_world: Float[np.ndarray, "m 2"]
    flow: int
    velocity_world: Float[np.ndarray, "2"]
    moving: bool
    predicted_world: Float[np.ndarray, "m 2"]
    contact_covariance: Float[np.ndarray, "m 2 2"]
    velocity_covariance: Float[np.ndarray, "2 2"]
    predicted_covariance: Float[np.ndarray, "m 2 2"]


@dataclass(frozen=True, eq=False)
class MonocularResult:
    """Stages and result of one cycle.

    The swarm needs `movable`, `current.camera` and `current.T_world_camera`.

    Args:
        previous: Picture at T_SS - dT; None in a cycle without optical flow (then all obstacles are static).
        current: Picture at T_SS; all masks belong to it.
        ground: I_g, the floor by colour.
        edges: I_E, pixels that are not ground above a pixel that is.
        flows: I_of.
        obstacles: From left to right by the mean column of their edges.
        predicted: Ground that moving obstacles cover or sweep until the horizon.
        movable: I_r, ground that is not predicted to be occupied.
        horizon_s: Time from `current` to the prediction, T_DS + T_SS, s.
        nearest_m: Horizontal distance from the camera to the nearest floor in view, in the middle of the lowest row;
            NaN if the lowest row shows no floor.
        corners_blocked: Whether the lower left and the lower right corner of `movable` show an obstacle; for the
            counters S_m.
    """

    previous: Picture | None
    current: Picture
    ground: UInt8[np.ndarray, "h w"]
    edges: UInt8[np.ndarray, "h w"]
    flows: Flows
    obstacles: tuple[SeenObstacle, ...]
    predicted: UInt8[np.ndarray, "h w"]
    movable: UInt8[np.ndarray, "h w"]
    horizon_s: float
    nearest_m: float
    corners_blocked: tuple[bool, bool]
