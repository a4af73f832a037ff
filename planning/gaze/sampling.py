"""Points relative to body and camera, and the ground cells whose confidence the gaze considers.

Source: seed 001, section 3, eq. (1).
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float, Float32, Int

from mapping.grid.confidence import ConfidenceLayer
from mapping.grid.egocentric_grid import EgocentricGrid
from perception.primitives.gaussian import Gaussian

from . import _gaze_kernels
from .selection import GazeMapConfig


def in_body(pose: Gaussian, places: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
    """World points, m, in the body frame at the mean of a pose over (x, y, yaw)."""
    c, s = math.cos(pose.mean[2]), math.sin(pose.mean[2])
    return np.asarray((places - pose.mean[:2]) @ np.array([[c, -s], [s, c]]))


def in_world(pose: Gaussian, place: Float[np.ndarray, "2"]) -> Float[np.ndarray, "2"]:
    """The inverse of `in_body`: a point (x ahead, y left), m, in the world frame."""
    c, s = math.cos(pose.mean[2]), math.sin(pose.mean[2])
    return np.asarray(pose.mean[:2] + np.array([[c, -s], [s, c]]) @ place)


def from_camera(
    pose: Gaussian,
    places: Float[np.ndarray, "n 2"],
    eye_m: float,
    heights: Float[np.ndarray, "n"] | None = None,
) -> Float[np.ndarray, "n 3"]:
    """World points relative to the camera, body axes, m.

    Args:
        pose: Over (x, y, yaw), world frame.
        places: World frame, m.
        eye_m: Height of the camera.
        heights: Of the points, m; None: on the floor.
    """
    seen = np.empty((len(places), 3))
    seen[:, :2] = in_body(pose, places)
    seen[:, 2] = -eye_m if heights is None else heights - eye_m
    return seen


def region(
    grid: EgocentricGrid, pose: Gaussian, config: GazeMapConfig, farthest_m: float
) -> Int[np.ndarray, "n"]:
    """R_s of `sample_region` as flat indices of the cells of the map."""
    x, y, yaw = pose.mean.tolist()
    return np.asarray(
        _gaze_kernels.sector(
            grid.centres().reshape(-1, 2),
            *(x, y, math.cos(yaw), math.sin(yaw)),
            *(config.evaluation.nearest_m, farthest_m, math.cos(math.radians(config.head.pan_deg))),
        )
    )


def sample_region(
    grid: EgocentricGrid,
    confidence: ConfidenceLayer,
    pose: Gaussian,
    config: GazeMapConfig,
) -> tuple[Float[np.ndarray, "n 2"], Float32[np.ndarray, "n"]]:
    """R_s: middles of the cells between d_nm and d_fm within the range of the neck, and their confidence.

    Args:
        grid: The terrain map; its window should reach d_fm round the robot.
        confidence: Of its cells.
        pose: Over (x, y, yaw), world frame.
        config: d_nm, d_fm and the range of the neck.

    Returns:
        Points in the world frame, m, and C in [0, 1].

    Source: seed 001, section 3, eq. (1).
    """
    cells = region(grid, pose, config, config.evaluation.farthest_m)
    return grid.centres().reshape(-1, 2)[cells], confidence.values.ravel()[cells]
