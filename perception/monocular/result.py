"""What one monocular cycle hands on: the picture in which the swarm searches, and how it came about.

A cycle has two pictures, taken at T_SS - dT and at T_SS, each with the pose its own joints gave it. Masks
are as large as the pictures (h, w), 255 where they hold and 0 elsewhere, indexed [v, u]. World frame: z up,
floor at z = 0.

Source: seed 000, section 2 and section 3, Fig. 2 and Fig. 8.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int, UInt8

from ..primitives.camera import Camera
from ..primitives.pose import Pose3


@dataclass(frozen=True, eq=False)
class Picture:
    """A colour picture and where it was taken.

    Args:
        rgb: (h, w, 3), red first.
        camera: Its pinhole; h and w are those of `rgb`.
        T_world_camera: Pose of the camera above the floor z = 0 (M_C or M_P of the seed, times R_opt).
        stamp_s: When, s.
    """

    rgb: UInt8[np.ndarray, "h w 3"]
    camera: Camera
    T_world_camera: Pose3
    stamp_s: float


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
        velocity_world: (2,), m/s, by that flow; zero if the obstacle counts as standing.
        median_velocity_world: (2,), m/s, of all its flows: the least one is biased low. Zero without flows.
        moving: Whether the speed reaches the threshold.
        predicted_world: (m, 2), contact_world after `MonocularResult.horizon_s`, m; equal to it if standing.
    """

    edge: Int[np.ndarray, "m 2"]
    contact_world: Float[np.ndarray, "m 2"]
    flow: int
    velocity_world: Float[np.ndarray, "2"]
    median_velocity_world: Float[np.ndarray, "2"]
    moving: bool
    predicted_world: Float[np.ndarray, "m 2"]


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
