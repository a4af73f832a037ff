"""A plane `n.p + rho = 0` with its covariance."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Float

from .pose import Pose3


@dataclass(frozen=True)
class Plane:
    """Unit normal and offset, with the covariance of (two tilts, offset).

    For a floor in the camera frame, the normal points up, from the floor to the camera, and the offset is the height
    of the camera above it.

    Args:
        normal: n, (3,), unit length.
        offset_m: rho in n.p + rho = 0, m.
        covariance: (3, 3) of (tilt about `tangents[0]` and `tangents[1]` in rad, offset in m): the true
            normal is n + a t0 + b t1 to first order, the true offset rho + c, for an error (a, b, c).

    Source: seed 003, section 3.
    """

    normal: Float[np.ndarray, "3"]
    offset_m: float
    covariance: Float[np.ndarray, "3 3"] = field(default_factory=lambda: np.zeros((3, 3)))

    @cached_property
    def tangents(self) -> Float[np.ndarray, "2 3"]:
        """Two unit vectors that form a right-handed frame with the normal; a function of n alone."""
        x, y, z = (float(v) for v in self.normal)
        least = min(range(3), key=lambda i: abs((x, y, z)[i]))
        a, b, c = ((0.0, z, -y), (-z, 0.0, x), (y, -x, 0.0))[least]  # n x axis of the least entry
        length = math.sqrt(a * a + b * b + c * c)
        a, b, c = a / length, b / length, c / length
        return np.array([[a, b, c], [y * c - z * b, z * a - x * c, x * b - y * a]])

    def distance(self, points: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n"]:
        """Signed distance of points (..., 3), m; positive on the side of the normal."""
        return np.asarray(points @ self.normal + self.offset_m)

    def angle_to(self, other: Plane) -> float:
        """Angle between the normals, rad."""
        return math.atan2(
            float(np.linalg.norm(np.cross(self.normal, other.normal))),
            float(self.normal @ other.normal),
        )

    def error_to(self, other: Plane) -> Float[np.ndarray, "3"]:
        """Error (a, b, c), as in `covariance`, from this plane to the other: rad, rad, m."""
        tilt = self.tangents @ other.normal / max(float(self.normal @ other.normal), 1e-9)
        return np.array([tilt[0], tilt[1], other.offset_m - self.offset_m])

    def moved(self, T_to_from: Pose3) -> Plane:
        """The same plane with its covariance in another frame."""
        normal = T_to_from.rotation @ self.normal
        offset = self.offset_m - float(normal @ T_to_from.position)
        moved = Plane(normal, offset)
        jacobian = np.zeros((3, 3))  # from old (a, b, c) to new
        turned = T_to_from.rotation @ self.tangents.T  # (3, 2) old tangents in the new frame
        jacobian[:2, :2] = moved.tangents @ turned
        jacobian[2, :2] = -T_to_from.position @ turned
        jacobian[2, 2] = 1.0
        return Plane(normal, offset, jacobian @ self.covariance @ jacobian.T)
