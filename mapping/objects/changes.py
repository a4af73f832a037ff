"""What changed between two sessions of one place: space that one saw filled and the other saw free.

The surface of each session is a set of voxels. Every voxel of one session is projected into the images of the other: a
longer depth there says free, an equal one filled, a shorter one nothing. Voxels that turned free form objects, by
their neighbourhood. One that is gone and one that appeared, of the same size, are one that moved.

Source: ours; free space by projection as in Newcombe et al. 2011 (the sign of a projective distance).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Float32, Int
from scipy.optimize import linear_sum_assignment
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.special import ndtr

from perception.primitives.camera import Camera
from perception.primitives.pose import Pose3

# Ours, as all thresholds below: chosen on a synthetic room and the home of seed 100.
VOXEL_M = 0.04
STRIDE = 2  # pixels
NEAREST_M, FARTHEST_M = 0.3, 4.5
MOST_SIGMA_M = 0.03  # of a depth that counts
LOWEST_M, HIGHEST_M = 0.06, 2.2  # above the floor; rugs and ceilings are left out
LEAST_SIGHTINGS = 2  # images that saw a voxel
SIGMAS = 3.0  # of depth and pose between filled and free
PRIOR = 0.02  # share of voxels that change
PER_IMAGE = 1.6  # log odds by one image that sees a voxel free, or filled
MOST_IMAGES = 4  # that count: more of them share their errors
CLEAR_M = 0.08  # least distance of a changed voxel from the other session's surface
GAP_M = 0.09  # between voxels of one object
LEAST_VOXELS = 25  # of an object
LEAST_SIDE_M = 0.12  # of the second longest side of an object: thinner ones are edges of others
SAME_M, SAME_SHARE = 0.10, 0.20  # sides of one object at two places differ by at most
UNSEEN_SHARE = 0.15  # of a side: deviation of the centre because the far side was not seen


@dataclass(frozen=True, eq=False)
class Look:
    """A depth image of a session at its place in the common map.

    Args:
        z: Depth along the optical axis, m; NaN where there is none.
        sigma: Its standard deviation, m.
        camera: Intrinsics, without distortion.
        T_map_camera: Its pose; z of the map is height above the floor.
        sigma_m: Standard deviation of its position in the map.
    """

    z: Float32[np.ndarray, "h w"]
    sigma: Float32[np.ndarray, "h w"]
    camera: Camera
    T_map_camera: Pose3
    sigma_m: float = 0.0


@dataclass(frozen=True, eq=False)
class ChangedObject:
    """Something that one session saw and the other did not.

    Args:
        outline: Corners of its rectangle on the floor, counter-clockwise, map axes, m.
        position: Its middle, m.
        covariance: Of the position, m^2; the unseen far side included.
        size: Length, width and height of its top above the floor, m.
        low: Height of its underside above the floor, m.
        probability: That this space changed from filled to free.
        voxels: Number of them.
    """

    outline: Float[np.ndarray, "4 2"]
    position: Float[np.ndarray, "2"]
    covariance: Float[np.ndarray, "2 2"]
    size: Float[np.ndarray, "3"]
    low: float
    probability: float
    voxels: int


@dataclass(frozen=True, eq=False)
class Change:
    """One change between two sessions.

    Args:
        kind: "gone", "appeared" or "moved".
        before, after: The object in the first and in the second session; None where it is not.
        probability: That it changed so.
    """

    kind: str
    before: ChangedObject | None
    after: ChangedObject | None
    probability: float


@dataclass(frozen=True, eq=False)
class Surface:
    """Voxels of a session's surface.

    Args:
        points: Their mean points, map axes, m.
        sightings: Number of images that saw each.
    """

    points: Float[np.ndarray, "n 3"]
    sightings: Int[np.ndarray, "n"]


def find_changes(first: Sequence[Look], second: Sequence[Look]) -> list[Change]:
    """Changes from the first session to the second, the most probable first."""
    surfaces = surface_of(first), surface_of(second)
    gone = lost_objects(surfaces[0], first, surfaces[1], second)
    appeared = lost_objects(surfaces[1], second, surfaces[0], first)
    found, pairs = [], _moves(gone, appeared)
    for k, n, alike in pairs:
        chance = gone[k].probability * appeared[n].probability * alike
        found.append(Change("moved", gone[k], appeared[n], chance))
    old, new = {k for k, _, _ in pairs}, {n for _, n, _ in pairs}
    found += [Change("gone", o, None, o.probability) for k, o in enumerate(gone) if k not in old]
    found += [
        Change("appeared", None, o, o.probability) for n, o in enumerate(appeared) if n not in new
    ]
    return sorted(found, key=lambda one: -one.probability)


def surface_of(looks: Sequence[Look]) -> Surface:
    """The voxels that the images of a session fill."""
    places, points = [], []
    for look in looks:
        seen = _points(look)
        lattice = np.floor(seen / VOXEL_M).astype(np.int64)
        cells, of = np.unique(lattice, axis=0, return_inverse=True)
        of = of.reshape(-1)
        count = np.bincount(of, minlength=len(cells))
        mean = np.stack([np.bincount(of, axis, len(cells)) for axis in seen.T], axis=1)
        places.append(cells)
        points.append(mean / np.maximum(count, 1)[:, None])
    if not places:
        return Surface(np.zeros((0, 3)), np.zeros(0, np.int64))
    cells, of = np.unique(np.concatenate(places), axis=0, return_inverse=True)
    of, every = of.reshape(-1), np.concatenate(points)
    sightings = np.bincount(of, minlength=len(cells))
    total = np.stack([np.bincount(of, axis, len(cells)) for axis in every.T], axis=1)
    return Surface(total / np.maximum(sightings, 1)[:, None], sightings)


def _points(look: Look) -> Float[np.ndarray, "n 3"]:
    """Points of an image in the map."""
    z, sigma = look.z[::STRIDE, ::STRIDE], look.sigma[::STRIDE, ::STRIDE]
    with np.errstate(invalid="ignore"):
        good = (z > NEAREST_M) & (z < FARTHEST_M) & (sigma < MOST_SIGMA_M)
    x, y = look.camera.slopes
    x, y = np.broadcast_arrays(x, y)
    depth = z[good].astype(np.float64)
    rays = np.stack([x[::STRIDE, ::STRIDE][good], y[::STRIDE, ::STRIDE][good]], axis=-1)
    return look.T_map_camera.apply(np.column_stack([rays * depth[:, None], depth]))


def lost_objects(
    surface: Surface, own: Sequence[Look], other: Surface, looks: Sequence[Look]
) -> list[ChangedObject]:
    """Objects of one session whose space the other session saw free.

    Args:
        surface, own: The session that has them.
        other, looks: The session that has not.
    """
    height = surface.points[:, 2]
    least = min(LEAST_SIGHTINGS, len(own))
    kept = (surface.sightings >= least) & (height > LOWEST_M) & (height < HIGHEST_M)
    points = surface.points[kept]
    if not len(points) or not len(other.points):
        return []
    free, filled = evidence(points, looks)
    odds = PER_IMAGE * np.clip(free - filled, -MOST_IMAGES, MOST_IMAGES)
    odds += math.log(PRIOR / (1.0 - PRIOR))
    away = np.asarray(cKDTree(other.points).query(points)[0])
    chosen = np.flatnonzero((odds > 0.0) & (away > CLEAR_M))
    emptied, held = evidence(points[chosen], own)
    chosen = chosen[held > emptied]  # what its own session saw come and go is no furniture
    sigma_m = _pose_sigma(own, looks)
    chance = 1.0 / (1.0 + np.exp(-odds))
    found = []
    for part in connected_in_space(points[chosen], GAP_M):
        some = chosen[part]
        one = _object(points[some], chance[some], away[some], sigma_m)
        if one is not None:
            found.append(one)
    return sorted(found, key=lambda one: (-one.voxels, *one.position.tolist()))


def evidence(
    points: Float[np.ndarray, "n 3"], looks: Sequence[Look]
) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
    """Number of images in which each point lies in free space, and on a surface."""
    free, filled = np.zeros(len(points)), np.zeros(len(points))
    for look in looks:
        camera = look.camera
        x, y, z = look.T_map_camera.inverse().apply(points).T
        ahead = (z > NEAREST_M) & (z < FARTHEST_M)
        depth = np.where(ahead, z, 1.0)
        u = np.rint(camera.fx * x / depth + camera.cx)
        v = np.rint(camera.fy * y / depth + camera.cy)
        inside = ahead & (u >= 0) & (u < camera.width) & (v >= 0) & (v < camera.height)
        index = np.flatnonzero(inside)
        row, column = v[index].astype(np.int64), u[index].astype(np.int64)
        nearest, farthest, sigma = _around(look)
        near, far = nearest[row, column], farthest[row, column]
        margin = VOXEL_M + SIGMAS * np.hypot(sigma[row, column], look.sigma_m)
        with np.errstate(invalid="ignore"):
            free[index] += near > z[index] + margin
            filled[index] += (near <= z[index] + margin) & (far >= z[index] - margin)
    return free, filled


def _around(look: Look) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Smallest and largest depth of the pixels around each, and its deviation; NaN without depth."""
    known = np.isfinite(look.z)
    kernel = np.ones((3, 3), np.uint8)
    nearest = cv2.erode(np.where(known, look.z, np.float32(np.inf)), kernel)
    farthest = cv2.dilate(np.where(known, look.z, np.float32(-np.inf)), kernel)
    nearest[~known] = np.nan
    farthest[~known] = np.nan
    return nearest, farthest, look.sigma


def _pose_sigma(own: Sequence[Look], looks: Sequence[Look]) -> float:
    """Standard deviation of the places of two sessions relative to each other, m."""
    return math.hypot(*(float(np.median([one.sigma_m for one in some])) for some in (own, looks)))


def connected_in_space(
    points: Float[np.ndarray, "n 3"], gap_m: float
) -> list[Int[np.ndarray, "k"]]:
    """Indices of the points of each part connected over gaps up to `gap_m`."""
    if not len(points):
        return []
    pairs = cKDTree(points).query_pairs(gap_m, output_type="ndarray")
    links = coo_array((np.ones(len(pairs), np.int8), tuple(pairs.T)), shape=(len(points),) * 2)
    count, label = connected_components(links, directed=False)
    return [np.flatnonzero(label == k) for k in range(count)]


def _object(
    points: Float[np.ndarray, "n 3"],
    chance: Float[np.ndarray, "n"],
    away: Float[np.ndarray, "n"],
    sigma_m: float,
) -> ChangedObject | None:
    """The object that some voxels form; None if they are too few or an edge only."""
    if len(points) < LEAST_VOXELS:
        return None
    centre, between, turn = cv2.minAreaRect(points[:, :2].astype(np.float32))
    whole = between[0] + VOXEL_M, between[1] + VOXEL_M  # voxels go half a side beyond their points
    length, width = max(whole), min(whole)
    low, top = float(points[:, 2].min()) - VOXEL_M / 2, float(points[:, 2].max()) + VOXEL_M / 2
    if sorted((length, width, top - low))[1] < LEAST_SIDE_M:
        return None
    corners = _counter_clockwise(cv2.boxPoints((centre, whole, turn)).astype(np.float64))
    spread = math.hypot(sigma_m, VOXEL_M)
    along = corners[1] - corners[0]
    along = along / max(float(np.linalg.norm(along)), 1e-9)
    across = np.array([-along[1], along[0]])
    sides = [float(np.ptp(points[:, :2] @ axis)) for axis in (along, across)]
    axes = np.stack([along, across], axis=1)
    covariance = axes @ np.diag(spread**2 + (UNSEEN_SHARE * np.array(sides)) ** 2) @ axes.T
    misplaced = 2.0 * float(
        ndtr(-float(np.median(away)) / spread)
    )  # an unchanged surface, that far off
    return ChangedObject(
        corners,
        np.array(centre, float),
        covariance,
        np.array([length, width, top]),
        low,
        float(chance.mean()) * (1.0 - misplaced),
        len(points),
    )


def _counter_clockwise(corners: Float[np.ndarray, "4 2"]) -> Float[np.ndarray, "4 2"]:
    x, y = corners.T
    area = float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
    return corners if area >= 0.0 else corners[::-1].copy()


def _moves(
    gone: Sequence[ChangedObject], appeared: Sequence[ChangedObject]
) -> list[tuple[int, int, float]]:
    """Pairs of the same size, and the probability that a pair is one object."""
    if not gone or not appeared:
        return []
    cost = np.array([[_unlike(a.size, b.size) for b in appeared] for a in gone])
    rows, columns = linear_sum_assignment(np.minimum(cost, 10.0))
    return [
        (k, n, float(math.exp(-0.5 * cost[k, n] ** 2)))
        for k, n in zip(rows.tolist(), columns.tolist(), strict=True)
        if cost[k, n] <= 1.0
    ]


def _unlike(size: Float[np.ndarray, "3"], other: Float[np.ndarray, "3"]) -> float:
    """Largest difference of two sizes, in units of what one object at two places shows; > 1: two objects."""
    allowed = SAME_M + SAME_SHARE * np.maximum(size, other)
    return float(np.max(np.abs(size - other) / allowed))
