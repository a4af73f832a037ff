"""Scan of the steep plane regions of a depth image: walls, furniture, and the risers of stairs at every height.

`scan` takes what stands above one floor. Over ground of several levels the regions of `terrain` say what is steep; each gives
points along its level line, which share the error of its plane.

Source: ours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ..primitives.pose import Pose3
from ..terrain.region import Region
from .scan import SHARED_SIGMA_M, Scan, joined

STEEP_RAD = math.radians(75.0)  # ours: from horizontal; a flatter one shifts with its height
SPACING_M = 0.04  # ours: closer points add no information


def plane_scan(regions: Sequence[Region], T_body_camera: Pose3) -> Scan:
    """The scan of one image.

    Args:
        regions: From `terrain.segmentation.find`, camera frame.
        T_body_camera: Pose of the camera in an upright frame of the body.

    Returns:
        Points in the body frame, m, region after region; normals towards the camera.
    """
    return joined(
        [_level_line(one, T_body_camera) for one in regions if _is_steep(one, T_body_camera)]
    )


def _is_steep(region: Region, T: Pose3) -> bool:
    return abs(float(T.rotation[2] @ region.plane.normal)) < math.cos(STEEP_RAD)


def _level_line(region: Region, T: Pose3) -> Scan:
    """Points on a region at the height of its middle."""
    plane = region.plane
    normal = (T.rotation @ plane.normal)[:2]
    normal = normal / np.linalg.norm(normal)
    along = np.array([-normal[1], normal[0]])
    middle, corners = T.apply(region.middle)[:2], T.apply(region.outline)[:, :2]
    run = (corners - middle) @ along
    count = max(round(float(np.ptp(run)) / SPACING_M), 1)
    places = run.min() + (np.arange(count) + 0.5) * float(np.ptp(run)) / count
    points = middle + np.outer(places, along)
    direction = T.rotation.T @ np.array([*along, 0.0])
    seen = region.middle + np.outer(places, direction)
    effect = np.column_stack([seen @ plane.tangents.T, np.ones(count)])
    variance = np.einsum("ni,ij,nj->n", effect, plane.covariance, effect)
    sigmas = np.sqrt(
        count * (variance + SHARED_SIGMA_M**2)
    )  # together they know as much as the plane does
    return Scan(points, np.tile(normal, (count, 1)), sigmas)
