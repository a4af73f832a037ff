"""Footprints: the rectangles that obstacles cover on the floor, from the accumulated obstacle cloud.

Points that are connected on the floor plane are one obstacle. Parts much lower than the obstacle they touch
(floor misclassified as obstacle, a low object beside a high one) are separated as its skirt. The footprint is
the rectangle whose four sides hold most of the outline. Each side lies at the median reach of the outline
along it, so that outliers at silhouettes, and a face displaced in one frame out of ten, do not move it.

Source: ours; the rectangle of least area after Freeman and Shapira 1975.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from perception.primitives.errors import ConfigError, InputError
from perception.primitives.settings import setting

CELL_M = 0.02  # ours: resolution of the outline, that of the cloud's voxels
SKIRT = 0.3  # ours: columns lower than this share of the obstacle's height are its skirt
LEAST_NEIGHBOURS = 4  # ours: voxels with fewer neighbours within the gap are outliers
FRINGE_M = 0.05  # ours: distance of outlier voxels from a face
FRINGE = 0.25  # ours: columns with a smaller share of a neighbour's voxels are its fringe
EDGE_SIGMA_M = 0.01  # ours: standard deviation of the bias of a face in fused depth


@dataclass(frozen=True)
class FootprintConfig:
    """Which voxels form an obstacle."""

    gap_m: float = setting(
        0.08,
        "m",
        "wider gaps on the floor separate two obstacles",
        "ours: two pixels of a depth camera at 3 m",
    )
    least_points: int = (
        20  # ours: outliers form smaller clusters; voxels that an obstacle has at least
    )
    least_sightings: int = setting(
        2,
        "",
        "frames in which a voxel of a well-seen obstacle is seen at least",
        "ours: outliers appear once",
    )

    def __post_init__(self) -> None:
        if not self.gap_m >= CELL_M:
            raise ConfigError(f"footprints: gap_m={self.gap_m} must be at least {CELL_M}")
        if self.least_points < 3:
            raise ConfigError(f"footprints: least_points={self.least_points} must be at least 3")


@dataclass(frozen=True)
class Footprint:
    """The footprint of one obstacle: a rectangle, with the covariance of its centre.

    Args:
        centre: (2,), centre of the rectangle, world frame, m.
        length_m: The longer side.
        width_m: The shorter side.
        yaw_rad: Direction of the longer side, in [-pi/2, pi/2).
        height_m: Height of its top above the floor.
        covariance: (2, 2) of the centre, m^2.
        points: Number of voxels.
    """

    centre: Float[np.ndarray, "2"]
    length_m: float
    width_m: float
    yaw_rad: float
    height_m: float
    covariance: Float[np.ndarray, "2 2"]
    points: int


def find(
    points_world: Float[np.ndarray, "n 3"],
    config: FootprintConfig | None = None,
    sightings: Int[np.ndarray, "n"] | None = None,
) -> list[Footprint]:
    """Footprints of all obstacles on the floor, those with most points first.

    Args:
        points_world: Obstacle points, averaged per voxel, world frame with z the height above the floor,
            m; NaN is ignored.
        config: Thresholds.
        sightings: Number of frames in which each voxel was seen; None: unknown.

    Returns:
        One footprint per obstacle.

    Raises:
        InputError: The number of sightings differs from the number of points.
    """
    config = config or FootprintConfig()
    keep = np.isfinite(points_world).all(axis=1)
    if sightings is not None and len(sightings) != len(points_world):
        raise InputError(
            f"footprints: {len(points_world)} points but {len(sightings)} sightings; give one a point"
        )
    keep[keep] = _has_neighbours(points_world[keep].astype(np.float64), config)
    points = points_world[keep].astype(np.float64)
    weights = np.ones(len(points)) if sightings is None else sightings[keep].astype(np.float64)
    objects: list[np.ndarray] = []
    for part in _parts(points, config):
        if np.quantile(weights[part], 0.9) >= 2 * config.least_sightings:  # a well-seen part
            part = part[weights[part] >= config.least_sightings]
        trunk = _trunk(points[part])
        objects += [part[trunk][sub] for sub in _parts(points[part[trunk]], config)]
        objects += [part[~trunk][sub] for sub in _parts(points[part[~trunk]], config)]
    objects = [one for one in objects if len(one) >= config.least_points]
    objects.sort(key=lambda one: (-len(one), *points[one[0]].tolist()))
    return [_footprint(points[one], weights[one]) for one in objects]


def _cells(
    points: Float[np.ndarray, "n 3"],
) -> tuple[Int[np.ndarray, "k 2"], Int[np.ndarray, "n"]]:
    """The cells of the floor plane that hold points, and the index of each point's cell."""
    lattice = np.floor(points[:, :2] / CELL_M).astype(np.int64)
    cells, cell = np.unique(lattice, axis=0, return_inverse=True)
    return cells, cell.reshape(-1)


def _has_neighbours(
    points: Float[np.ndarray, "n 3"], config: FootprintConfig
) -> Bool[np.ndarray, "n"]:
    """Whether each voxel has enough neighbours in space; single flying pixels have none."""
    if not len(points):
        return np.zeros(0, np.bool_)
    near = cKDTree(points).query_ball_point(points, config.gap_m, return_length=True)
    return np.asarray(near) - 1 >= LEAST_NEIGHBOURS


def _parts(points: Float[np.ndarray, "n 3"], config: FootprintConfig) -> list[Int[np.ndarray, "k"]]:
    """Indices of the points of each part connected on the floor plane."""
    if not len(points):
        return []
    cells, cell = _cells(points)
    pairs = cKDTree(cells).query_pairs(config.gap_m / CELL_M + 1e-9, output_type="ndarray")
    links = coo_array((np.ones(len(pairs), np.int8), tuple(pairs.T)), shape=(len(cells),) * 2)
    count, label = connected_components(links, directed=False)
    of_point = label[cell]
    return [np.flatnonzero(of_point == k) for k in range(count)]


def _trunk(points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, "n"]:
    """Points in columns high enough to belong to the main body of a part."""
    cells, cell = _cells(points)
    top = np.full(len(cells), -np.inf)
    np.maximum.at(top, cell, points[:, 2])
    return top[cell] >= SKIRT * np.quantile(points[:, 2], 0.95)


def _footprint(points: Float[np.ndarray, "n 3"], weights: Float[np.ndarray, "n"]) -> Footprint:
    centroid = points[:, :2].mean(axis=0)
    outline = _columns(points, weights) - centroid
    yaw = _orientation(outline)
    axes = np.array([[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]])
    sides = _sides(outline @ axes.T)
    edges = np.array([side.edge for side in sides])  # -x, +x, -y, +y; outward
    variances = np.array([side.sigma**2 for side in sides]) + EDGE_SIGMA_M**2
    size = edges[::2] + edges[1::2]
    centre = centroid + (edges[1::2] - edges[::2]) / 2 @ axes
    covariance = axes.T @ np.diag((variances[::2] + variances[1::2]) / 4) @ axes
    if size[0] < size[1]:
        size, yaw = size[::-1], yaw + math.pi / 2
    return Footprint(
        centre,
        float(size[0]),
        float(size[1]),
        (yaw + math.pi / 2) % math.pi - math.pi / 2,
        float(np.quantile(points[:, 2], 0.95)),
        covariance,
        len(points),
    )


def _columns(
    points: Float[np.ndarray, "n 3"], weights: Float[np.ndarray, "n"]
) -> Float[np.ndarray, "k 2"]:
    """Mean positions of the columns of voxels that form the outline, without fringes.

    A vertical face stacks many voxels on few columns, and its outliers form columns of few voxels beside
    them. A horizontal face has few voxels on all of its columns, and keeps them.
    """
    _, cell = _cells(points)
    weight = np.bincount(cell, weights)
    count = np.bincount(cell)
    places = np.stack([np.bincount(cell, points[:, axis]) / count for axis in range(2)], axis=1)
    around = cKDTree(places).query_pairs(FRINGE_M, output_type="ndarray")
    densest = weight.copy()
    np.maximum.at(densest, around[:, 0], weight[around[:, 1]])
    np.maximum.at(densest, around[:, 1], weight[around[:, 0]])
    return places[weight >= FRINGE * densest]


def _orientation(outline: Float[np.ndarray, "k 2"]) -> float:
    """Yaw in [0, pi/2) at which most of the outline lies on the four sides of a rectangle, rad."""

    def support(yaw: float) -> float:
        c, s = math.cos(yaw), math.sin(yaw)
        return sum(side.support for side in _sides(outline @ np.array([[c, -s], [s, c]])))

    step = math.radians(2.0)
    best = max((k * step for k in range(45)), key=support)
    while step > math.radians(0.1):
        step /= 3
        best = max((best + k * step for k in (0, -1, 1, -2, 2)), key=support)
    return best % (math.pi / 2)


class _Side(NamedTuple):
    """One side of the rectangle: distance outward and its standard deviation, m; strips of outline on it."""

    edge: float
    sigma: float
    support: float


def _sides(local: Float[np.ndarray, "k 2"]) -> list[_Side]:
    """The sides towards -x, +x, -y, +y of an outline in the rectangle's axes, m.

    The outline is cut into strips perpendicular to a side; the reach of the outline in each strip locates
    the side. If only two faces were seen, the other two sides are touched by the ends of these faces alone.
    Hence only strips that reach as far as the farthest few columns count, whether many or few.
    """
    sides = []
    for axis in range(2):
        along = local[:, 1 - axis]
        strip = np.floor((along - along.min()) / CELL_M).astype(np.int64)
        for sign in (-1.0, 1.0):
            reach = np.full(int(strip.max()) + 1, -np.inf)
            outward = sign * local[:, axis]
            np.maximum.at(reach, strip, outward)
            few = min(len(outward), max(3, len(outward) // 50))
            farthest = float(np.partition(outward, -few)[-few])
            sides.append(_side(reach[reach >= farthest - FRINGE_M]))
    return sides


def _side(reach: Float[np.ndarray, "strips"]) -> _Side:
    """The side located by the reach of the outline, m, in each strip that touches it."""
    edge = float(np.median(reach))
    residual = reach - edge
    sigma = 1.48 * float(np.median(np.abs(residual))) / math.sqrt(len(reach))
    return _Side(edge, sigma, float(np.exp(-0.5 * (residual / CELL_M) ** 2).sum()))
