"""What one monocular cycle hands on: the picture in which the swarm searches, and how it came about.

A cycle has two pictures, taken at T_SS - dT and at T_SS, each with the pose its own joints gave it. Masks
are as large as the pictures (h, w), 255 where they hold and 0 elsewhere, indexed [v, u]. World frame: z up,
floor at z = 0.

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

LEAST_PX = 16  # ours: a side; fewer show neither a patch of floor nor an edge of five columns
OVERTURNED = 1e-6  # ours: rounding of a camera that looks straight down


@dataclass(frozen=True, eq=False)
class Picture:
    """A colour picture and where it was taken.

    Args:
        rgb: (h, w, 3), red first.
        camera: Its pinhole; h and w are those of `rgb`.
        T_world_camera: Pose of the camera above the floor z = 0 (M_C or M_P of the seed, times R_opt).
        stamp_s: When, s.

    Raises:
        InputError: The image is no (h, w, 3) of whole numbers to 255, too small, or not of its camera's size;
            the pose is not finite, below the floor, or of a camera held upside down.
    """

    rgb: UInt8[np.ndarray, "h w 3"]
    camera: Camera
    T_world_camera: Pose3
    stamp_s: float

    def __post_init__(self) -> None:
        self._check_image()
        self._check_place()

    def _check_image(self) -> None:
        rgb, camera = self.rgb, self.camera
        if rgb.ndim != 3 or rgb.shape[2] != 3 or rgb.dtype != np.uint8:
            raise InputError(
                f"picture: an image of shape {rgb.shape} and {rgb.dtype} must be (h, w, 3) of uint8, red first; "
                "convert it"
            )
        height, width = rgb.shape[:2]
        if (width, height) != (camera.width, camera.height):
            raise InputError(
                f"picture: the image is {width}x{height} px, its camera {camera.width}x{camera.height}; "
                "give the camera of that image"
            )
        if min(width, height) < LEAST_PX:
            raise InputError(
                f"picture: the image is {width}x{height} px; both sides must be at least {LEAST_PX}"
            )

    def _check_place(self) -> None:
        pose = self.T_world_camera
        turn = math.hypot(*pose.quat_xyzw)
        if (
            not all(map(math.isfinite, (*pose.translation, self.stamp_s)))
            or not 0.0 < turn < math.inf
        ):
            raise InputError(
                f"picture: its pose {pose.translation} m, {pose.quat_xyzw} at {self.stamp_s} s must be finite; "
                "leave such a frame out"
            )
        if not pose.translation[2] > 0.0:
            raise InputError(
                f"picture: its camera at z={pose.translation[2]} m must be above the floor z = 0; check the pose"
            )
        if pose.rotation[2, 1] > OVERTURNED:
            raise InputError(
                f"picture: its camera is held upside down (world z is {pose.rotation[2, 1]:+.2f} along its "
                "downward axis); turn the image and the pose by half a turn"
            )


@dataclass(frozen=True, eq=False)
class Flows:
    """Corners followed from the previous to the current picture, I_of.

    Args:
        previous: (n, 2), pixels (u, v) in the previous picture.
        current: (n, 2), pixels (u, v) in the current picture.
        obstacle: (n,), index into `MonocularResult.obstacles`, -1 for none.
        velocity_world: (n, 2), m/s on the floor, as if the corner lay on it; NaN where one of its pixels
            does not look at the floor.
    """

    previous: Float[np.ndarray, "n 2"]
    current: Float[np.ndarray, "n 2"]
    obstacle: Int[np.ndarray, "n"]
    velocity_world: Float[np.ndarray, "n 2"]

    def __len__(self) -> int:
        return len(self.obstacle)


@dataclass(frozen=True, eq=False)
class SeenObstacle:
    """One obstacle as its edge on the floor shows it.

    Args:
        edge: (m, 2), the lowest pixel (u, v) of the obstacle in each of its columns: the pixel below is
            ground. Columns rise by one or more.
        contact_world: (m, 2), the same on the floor, m; NaN beyond `MonocularConfig.farthest_m`.
        flow: Index into `Flows` of the flow of least speed, I_of^min; -1 if no corner was followed.
        contact_covariance: (m, 2, 2), of each of these, m^2; the eye's share is one for all.
        velocity_world: (2,), m/s, by that flow; zero if the obstacle counts as standing.
        velocity_covariance: (2, 2), (m/s)^2; of what counts as standing it holds the speed that was not believed.
        median_velocity_world: (2,), m/s, of all its flows: the least one is biased low. Zero without flows.
        moving: Whether the speed reaches the threshold.
        predicted_world: (m, 2), contact_world after `MonocularResult.horizon_s`, m; equal to it if standing.
        predicted_covariance: (m, 2, 2), of each of these, m^2.
    """

    edge: Int[np.ndarray, "m 2"]
    contact_world: Float[np.ndarray, "m 2"]
    flow: int
    velocity_world: Float[np.ndarray, "2"]
    median_velocity_world: Float[np.ndarray, "2"]
    moving: bool
    predicted_world: Float[np.ndarray, "m 2"]
    contact_covariance: Float[np.ndarray, "m 2 2"]
    velocity_covariance: Float[np.ndarray, "2 2"]
    predicted_covariance: Float[np.ndarray, "m 2 2"]


@dataclass(frozen=True, eq=False)
class MonocularResult:
    """One cycle.

    Everything the swarm needs is `movable` with `current.camera` and `current.T_world_camera`:
    `back_projection.floor_points` turns a pixel into the point it stands for, `project` the other way.

    Args:
        previous: Picture at T_SS - dT; None in a cycle that had no partner (then nothing moves).
        current: Picture at T_SS; all masks belong to it.
        ground: I_g, the floor by colour as it is seen now.
        static: What is no ground now, seen or not: 255 - ground.
        edges: I_E, the pixel is no ground and the pixel below it is.
        flows: I_of.
        obstacles: Left to right by the middle of their edges.
        predicted: Ground that the moving obstacles will have taken or swept at the horizon.
        movable: I_r, ground and not predicted.
        horizon_s: How far ahead the prediction looks, T_DS + T_SS, s.
        nearest_m: Distance on the floor from below the camera to the middle of the lowest row: what is
            nearer is not seen (0.16 m in the seed); NaN if the lowest row does not look at the floor.
        corners_blocked: Whether (left, right) lower corner of `movable` shows an obstacle; feeds the
            counters S_m.
    """

    previous: Picture | None
    current: Picture
    ground: UInt8[np.ndarray, "h w"]
    static: UInt8[np.ndarray, "h w"]
    edges: UInt8[np.ndarray, "h w"]
    flows: Flows
    obstacles: tuple[SeenObstacle, ...]
    predicted: UInt8[np.ndarray, "h w"]
    movable: UInt8[np.ndarray, "h w"]
    horizon_s: float
    nearest_m: float
    corners_blocked: tuple[bool, bool]
