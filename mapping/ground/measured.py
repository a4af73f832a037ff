"""What a region of one image says of a surface: its height and slopes, and where its edges are, with the errors of both.

All are linear in the error of the region's plane and in that of the camera's pose: a translation d and a rotation w, in the
axes of the map frame, move a point p of the camera's frame, which stands at R p + t, by d + w x R p.

Source: ours.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from perception.primitives.plane import Plane
from perception.primitives.pose import Pose3
from perception.terrain.region import Edge, EdgeKind, Region

from .surface import Border

KINDS = {
    EdgeKind.CONVEX: Border.DROP,
    EdgeKind.OCCLUDING: Border.DROP,
    EdgeKind.CONCAVE: Border.RISE,
}


@dataclass(frozen=True)
class Level:
    """Height and slopes of a region about an origin; map frame.

    Args:
        value: (z, dz/dx, dz/dy).
        by_camera: (3, 6), change by an error of the camera's pose.
        shared: (3, k), change by one standard deviation of each coefficient of the distortion.
        noise: (3, 3), covariance by all else.
    """

    value: Float[np.ndarray, "3"]
    by_camera: Float[np.ndarray, "3 6"]
    shared: Float[np.ndarray, "3 k"]
    noise: Float[np.ndarray, "3 3"]


def level(region: Region, T: Pose3, origin: Float[np.ndarray, "2"]) -> Level:
    """Height and slopes of a region about an origin.

    Args:
        region: Camera frame.
        T: Camera in the map frame.
        origin: (x, y), map frame, m.
    """
    n = T.rotation @ region.plane.normal
    rho = region.plane.offset_m - float(n @ T.position)
    slope = -n[:2] / n[2]
    z = -(rho + float(n[:2] @ origin)) / n[2]
    # Columns: tilts and offset of the plane, then translation and rotation of the camera.
    dn, drho = np.zeros((3, 9)), np.zeros(9)
    dn[:, :2] = T.rotation @ region.plane.tangents.T
    dn[:, 6:] = [[0.0, n[2], -n[1]], [-n[2], 0.0, n[0]], [n[1], -n[0], 0.0]]
    drho[2], drho[3:6] = 1.0, -n
    drho -= T.position @ dn
    change = -np.vstack([drho + [*origin, z] @ dn, dn[:2] + slope[:, None] * dn[2]]) / n[2]
    by_plane, by_camera = change[:, :3], change[:, 3:]
    return Level(
        np.array([z, *slope]),
        by_camera,
        by_plane @ region.shared,
        by_plane @ region.own @ by_plane.T,
    )


@dataclass(frozen=True)
class Side:
    """A straight side of a surface; map frame.

    Args:
        border: What is beyond.
        place: (x, y) of a point on it, m.
        outward: Horizontal unit vector out of the surface.
        reach: Where it was seen, from the first to the last place along `along`, m.
        covariance: (2, 2) of (turn about up, rad; place along `outward`, m), by what differs from view to view.
        lasting_m: Standard deviation of its place by what does not.
        shared_m: The part of that which shifts all sides outwards alike.
        views: Number of images that showed it.
    """

    border: Border
    place: Float[np.ndarray, "2"]
    outward: Float[np.ndarray, "2"]
    reach: tuple[float, float]
    covariance: Float[np.ndarray, "2 2"]
    lasting_m: float
    shared_m: float
    views: int = 1

    @property
    def along(self) -> Float[np.ndarray, "2"]:
        """Unit vector along it, the surface to the left."""
        return np.array([-self.outward[1], self.outward[0]])

    @property
    def ends(self) -> Float[np.ndarray, "2 2"]:
        """First and last place that was seen."""
        return np.asarray(self.place + np.outer(self.reach, self.along))

    def variance_at(self, run_m: float) -> float:
        """Variance across at a distance along it, m^2."""
        lever = np.array([-run_m, 1.0])
        return float(lever @ self.covariance @ lever) + self.lasting_m**2

    def across(self, points: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n"]:
        """Distances of points outside of it, m."""
        return np.asarray((points - self.place) @ self.outward)

    def run(self, points: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n"]:
        """Places of points along it, m."""
        return np.asarray((points - self.place) @ self.along)


def side(
    region: Region,
    edge: Edge,
    T: Pose3,
    single: Float[np.ndarray, "6 6"],
    lasting: Float[np.ndarray, "6 m"],
    bend: Float[np.ndarray, "k m"],
) -> Side:
    """An edge of a region as a side of its surface.

    Args:
        region: Camera frame.
        edge: One of its edges.
        T: Camera in the map frame.
        single: Covariance of the camera's pose by what differs from view to view.
        lasting: Change of that pose by independent unit errors that do not.
        bend: Change of the coefficients of the distortion by the same errors.
    """
    ends = T.apply(edge.ends)[:, :2]
    middle = edge.middle
    place = ends.mean(axis=0)
    along = ends[1] - ends[0]
    length = float(np.linalg.norm(along))
    along = along / length
    outward = np.array([along[1], -along[0]])
    sense = np.array(
        [[1.0], [-1.0]]
    )  # of `edge.covariance`, whose offset is along the left of the edge
    if float(outward @ (T.apply(region.middle)[:2] - place)) > 0.0:
        outward, sense = -outward, np.array([[1.0], [1.0]])
    by_plane, by_camera = np.zeros((2, 3)), np.zeros((2, 6))
    shifts = [_shift(region.plane, end, T, outward) for end in (*edge.ends, middle)]
    for k, to in enumerate((by_plane, by_camera)):
        low, high, mean = (one[k] for one in shifts)
        to[0] = -(high - low) / length * _sign(along, outward)
        to[1] = mean
    own = edge.covariance * (sense @ sense.T) + by_plane @ region.own @ by_plane.T
    own = own + by_camera @ single @ by_camera.T
    fixed = by_plane @ region.shared @ bend + by_camera @ lasting
    covariance = own + np.diag([float(fixed[0] @ fixed[0]), 0.0])
    lasting_m = float(np.sqrt(fixed[1] @ fixed[1] + edge.shared_m**2))
    half = length / 2.0
    return Side(
        KINDS[edge.kind], place, outward, (-half, half), covariance, lasting_m, edge.shared_m
    )


def _sign(along: Float[np.ndarray, "2"], outward: Float[np.ndarray, "2"]) -> float:
    """1 if a direction is that of `Side.along`, else -1."""
    return float(np.sign(along @ np.array([-outward[1], outward[0]])))


def _shift(
    plane: Plane, point: Float[np.ndarray, "3"], T: Pose3, outward: Float[np.ndarray, "2"]
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "6"]]:
    """How far a point of a plane moves outwards by errors of the plane and of the camera's pose."""
    turned = T.rotation @ point
    push = np.array([*(plane.tangents @ point), 1.0]) / plane.offset_m  # along its ray
    (x, y, z), (a, b) = turned, outward
    by_camera = np.array([a, b, 0.0, -z * b, z * a, x * b - y * a])
    return float(x * a + y * b) * push, by_camera
