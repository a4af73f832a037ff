"""Values: a plane region of the terrain, and its edges.

Errors of the regions of one view are not independent: the distortion of depth is the same field for all. A region holds
what each coefficient of that field does to its plane (`shared`), so that heights and distances between regions get the
covariance that they have, not that of two independent planes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from jaxtyping import Bool, Float, Int

from ..primitives.camera import Camera
from ..primitives.plane import Plane
from . import _border_kernels as borders


class EdgeKind(IntEnum):
    """What is beyond an edge of a region."""

    CONVEX = borders.CONVEX
    """A region that falls away from it: a nosing with its riser below."""
    CONCAVE = borders.CONCAVE
    """A region that rises from it: the foot of a riser, wall or box."""
    OCCLUDING = borders.OCCLUDING
    """Something farther away: the region ends, as at a step down or the edge of a hole."""


@dataclass(frozen=True)
class Edge:
    """A straight edge of a region.

    Args:
        kind: What is beyond.
        ends: (2, 3), first and last seen point, camera frame, m; both on the plane of the region.
        covariance: (2, 2) of (angle about the normal of the plane, rad; offset of the middle along normal x
            `along`, m), given the plane.
        shared_m: Standard deviation of an outward shift, in pixels the same for all edges of a view, m.
        other: Index of the region beyond; -1 if there is none.
    """

    kind: EdgeKind
    ends: Float[np.ndarray, "2 3"]
    covariance: Float[np.ndarray, "2 2"]
    shared_m: float
    other: int

    @property
    def middle(self) -> Float[np.ndarray, "3"]:
        """Middle of the ends, camera frame, m."""
        return np.asarray(self.ends.mean(axis=0))

    @property
    def along(self) -> Float[np.ndarray, "3"]:
        """Unit vector from the first to the last end."""
        step = self.ends[1] - self.ends[0]
        return np.asarray(step / np.linalg.norm(step))

    @property
    def length_m(self) -> float:
        """Distance of the ends."""
        return float(np.linalg.norm(self.ends[1] - self.ends[0]))

    @property
    def sigma_m(self) -> float:
        """Standard deviation of the position across the edge, within the plane."""
        return math.sqrt(float(self.covariance[1, 1]) + self.shared_m**2)


@dataclass(frozen=True)
class Region:
    """A plane surface in one depth image.

    Args:
        plane: Camera frame, the camera on its positive side, with covariance.
        own: Covariance of `plane` without the smooth distortion of the view.
        shared: Errors of `plane` by one standard deviation of each coefficient of the distortion, which are
            those of every region of the view.
        pixels: Flat indices of its pixels, row * width + column.
        middle: Mean of its points, on the plane, camera frame, m.
        outline: Corners of the convex hull of its points, on the plane, camera frame, m.
        area_m2: Of what is seen of it.
        edges: Its straight edges.
        noise_m: Median standard deviation of its points, across the plane.
        detail_m: Size of what the image still resolves there, across the line of sight.
    """

    plane: Plane
    own: Float[np.ndarray, "3 3"]
    shared: Float[np.ndarray, "3 k"]
    pixels: Int[np.ndarray, "n"]
    middle: Float[np.ndarray, "3"]
    outline: Float[np.ndarray, "m 3"]
    area_m2: float
    edges: tuple[Edge, ...] = ()
    noise_m: float = 0.0
    detail_m: float = 0.0

    def slope_rad(self, up: Float[np.ndarray, "3"]) -> float:
        """Angle between the plane and the horizontal, given the unit vector up in the camera frame."""
        return math.acos(min(1.0, abs(float(self.plane.normal @ up))))

    def mask(self, camera: Camera) -> Bool[np.ndarray, "h w"]:
        """Its pixels in the image."""
        found = np.zeros(camera.height * camera.width, np.bool_)
        found[self.pixels] = True
        return found.reshape(camera.height, camera.width)
