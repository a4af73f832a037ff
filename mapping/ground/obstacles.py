"""Obstacles round the robot: voxels that depth images hit or looked through, each with a probability and a position variance.

The voxels stand in a map frame that the motions of the body build up, as the surfaces of `ground_map` do; what leaves is in
the frame of the body. A voxel is hit where points end in it, and looked through where an image measures something farther;
the log-odds of both add up. Every motion adds its error to the place of what is not seen anew. What is known too badly, or
is far away, is forgotten: the robot sees it again before it gets there.

Nothing here tells ground from obstacles: `planning.footholds.room` does.

Source: log-odds after Moravec and Elfes 1985, bounded after Hornung et al. 2013 (OctoMap); the rest ours.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from perception.depth.points import Points
from perception.primitives.frame import Depth
from perception.primitives.pose import Pose2, Pose3

VOXEL_M = 0.05  # ours
HIT, THROUGH = 0.85, -0.4  # OctoMap: log-odds of 0.7 and 0.4
LEAST, MOST = -2.0, 3.5  # OctoMap: log-odds of 0.12 and 0.97
BLURRED_M = 0.03  # ours: points with a larger standard deviation along their ray are not used
BEYOND_M = (
    0.10  # ours: an image looks through a voxel if it sees farther by this and three deviations
)
REACH_M, TALL_M = 3.0, 2.0  # ours: voxels farther beside or above the body are dropped
VAGUE_M = 0.12  # ours: voxels with a larger standard deviation of their position are dropped
SHIFT = 1 << 20  # of an index in a key


@dataclass(frozen=True, eq=False)
class Voxels:
    """Occupied voxels.

    Args:
        places: Their middles, body frame, m; z = 0 is the ground where the robot stands.
        probability: That something is in each.
        variance_m2: Of the place of each across, relative to the body.
    """

    places: Float[np.ndarray, "n 3"]
    probability: Float[np.ndarray, "n"]
    variance_m2: Float[np.ndarray, "n"]


class ObstacleMap:
    """Voxels round the robot that depth images hit."""

    def __init__(self) -> None:
        self._body = Pose2()  # in the map frame
        self._height_m = 0.0
        self._keys = np.zeros(0, np.int64)  # sorted
        self._odds = np.zeros(0)
        self._variance = np.zeros(0)

    def move(self, motion: Pose2, rise_m: float, covariance: Float[np.ndarray, "4 4"]) -> None:
        """Follow a motion of the body; arguments as for `GroundMap.move`."""
        self._body = self._body @ motion
        self._height_m += rise_m
        places = self._middles()
        away = places[:, :2] - self._body.vector[:2]
        lever = (away**2).sum(axis=1)
        self._variance += (covariance[0, 0] + covariance[1, 1] + covariance[2, 2] * lever) / 2.0
        high = np.abs(places[:, 2] - self._height_m) < TALL_M
        self._keep((lever < REACH_M**2) & high & (self._variance < VAGUE_M**2))

    def observe(
        self,
        points: Points,
        depth: Depth,
        T_body_camera: Pose3,
        covariance: Float[np.ndarray, "6 6"],
    ) -> None:
        """Take in an image.

        Args:
            points: Of the image, camera frame.
            depth: The image.
            T_body_camera: Pose of the camera; z = 0 is the ground where the robot stands.
            covariance: Of that pose, as for `GroundMap.observe`.
        """
        flat = self._body.lifted()
        T = replace(flat, translation=(self._body.x, self._body.y, self._height_m)) @ T_body_camera
        self._look_through(depth, T)
        sharp = np.flatnonzero(points.sigma < BLURRED_M)
        places = T.apply(points.xyz.take(sharp, axis=0))
        away = np.linalg.norm(places[:, :2] - self._body.vector[:2], axis=1)
        kept = (away < REACH_M) & (np.abs(places[:, 2] - self._height_m) < TALL_M)
        hit = np.unique(_keys(np.floor(places[kept] / VOXEL_M).astype(np.int64)))
        if not len(hit):
            return
        keys = np.union1d(self._keys, hit)
        odds, variance = np.zeros(len(keys)), np.zeros(len(keys))
        old = np.searchsorted(keys, self._keys)
        odds[old], variance[old] = self._odds, self._variance
        new = np.searchsorted(keys, hit)
        odds[new] = np.minimum(odds[new] + HIT, MOST)
        lever = ((_indices(hit) + 0.5) * VOXEL_M - T.position) ** 2
        spread = (
            np.trace(covariance[:2, :2]) / 2.0 + covariance[5, 5] * lever[:, :2].sum(axis=1) / 2
        )
        spread += np.trace(covariance[3:5, 3:5]) / 2.0 * lever[:, 2] + VOXEL_M**2 / 12.0
        variance[new] = spread
        self._keys, self._odds, self._variance = keys, odds, variance

    @property
    def voxels(self) -> Voxels:
        """Those more likely occupied than free, body frame."""
        taken = self._odds > 0.0
        places = self._middles()[taken]
        flat = self._body.inverse().apply(places[:, :2])
        return Voxels(
            np.column_stack([flat, places[:, 2] - self._height_m]),
            1.0 / (1.0 + np.exp(-self._odds[taken])),
            self._variance[taken],
        )

    def _look_through(self, depth: Depth, T: Pose3) -> None:
        """Lower the odds of voxels in front of what the image measures."""
        if not len(self._keys):
            return
        seen = T.inverse().apply(self._middles())
        ahead = np.flatnonzero(seen[:, 2] > VOXEL_M)
        inside, column, row = depth.camera.nearest_pixels(seen[ahead])
        ahead, row, column = ahead[inside], row[inside], column[inside]
        z, sigma = depth.z[row, column], depth.sigma[row, column]
        farther = z - seen[ahead, 2] > BEYOND_M + 3.0 * sigma  # False where there is no depth
        through = ahead[farther]
        self._odds[through] += THROUGH
        self._keep(self._odds > LEAST)

    def _middles(self) -> Float[np.ndarray, "n 3"]:
        """Middles of all voxels, map frame."""
        return (_indices(self._keys) + 0.5) * VOXEL_M

    def _keep(self, kept: np.ndarray) -> None:
        if not kept.all():
            self._keys, self._odds = self._keys[kept], self._odds[kept]
            self._variance = self._variance[kept]


def _keys(index: Int[np.ndarray, "n 3"]) -> Int[np.ndarray, "n"]:
    """One number for the three indices of a voxel."""
    x, y, z = (index + SHIFT // 2).T
    return np.asarray((x * SHIFT + y) * SHIFT + z)


def _indices(keys: Int[np.ndarray, "n"]) -> Int[np.ndarray, "n 3"]:
    """The indices of `_keys`."""
    x, rest = np.divmod(keys, SHIFT * SHIFT)
    y, z = np.divmod(rest, SHIFT)
    return np.stack([x, y, z], axis=1) - SHIFT // 2
