"""Values: a surface of the ground, with what ends it, in the frame of the body.

The map is egocentric, as the occupancy grid is: every surface stands in the body frame of the latest frame, and its
covariance is that of its place relative to the body. So a step of the robot adds the error of one step, and the
steps planned next meet no error of the whole walk.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from jaxtyping import Bool, Float, Int


class Border(IntEnum):
    """What is beyond a side of a surface."""

    UNSEEN = 0
    """Nothing was seen there; the surface may go on."""
    DROP = 1
    """The surface ends and lower ground, or nothing, follows: a nosing, a kerb, the edge of a hole."""
    RISE = 2
    """Something higher begins: a riser, a wall, a thing that stands there."""


@dataclass(frozen=True, eq=False)
class Surface:
    """A plane surface that a foot may stand on.

    Args:
        origin: (x, y) about which its height is stated, body frame, m.
        height: (z, dz/dx, dz/dy) at the origin: m, and slopes; z is 0 where the robot stands.
        covariance: (3, 3) of `height`, m and slopes.
        outline: Corners of its seen part, counterclockwise, not necessarily convex, body frame, m.
        borders: What is beyond the side from each corner to the next, values of `Border`.
        sigma_m: Standard deviation of each side across its direction, m.
        shared_m: Standard deviation of a shift across, of which all sides have the same, m; part of `sigma_m`.
        views: Number of images that showed it.
    """

    origin: Float[np.ndarray, "2"]
    height: Float[np.ndarray, "3"]
    covariance: Float[np.ndarray, "3 3"]
    outline: Float[np.ndarray, "n 2"]
    borders: Int[np.ndarray, "n"]
    sigma_m: Float[np.ndarray, "n"]
    shared_m: float = 0.0
    views: int = 1

    def height_at(
        self, points: Float[np.ndarray, "*m 2"]
    ) -> tuple[Float[np.ndarray, "*m"], Float[np.ndarray, "*m"]]:
        """Height of its plane at (x, y) and the standard deviation of that, m."""
        away = points - self.origin
        basis = np.concatenate([np.ones((*away.shape[:-1], 1)), away], axis=-1)
        variance = np.einsum("...i,ij,...j->...", basis, self.covariance, basis)
        return np.asarray(basis @ self.height), np.asarray(np.sqrt(np.maximum(variance, 0.0)))

    def contains(self, points: Float[np.ndarray, "*m 2"]) -> Bool[np.ndarray, "*m"]:
        """Whether (x, y) is within the outline."""
        start, end = self.outline, np.roll(self.outline, -1, axis=0)
        x, y = points[..., :1], points[..., 1:]
        crosses = (start[:, 1] > y) != (end[:, 1] > y)
        rise = np.where(end[:, 1] == start[:, 1], 1.0, end[:, 1] - start[:, 1])
        at = start[:, 0] + (y - start[:, 1]) * (end[:, 0] - start[:, 0]) / rise
        return np.asarray(np.sum(crosses & (x < at), axis=-1) % 2 == 1)
