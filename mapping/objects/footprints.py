"""Footprints: the ground plan of what stands on the floor, from the fused obstacle points.

Points that hang together on the floor plane are one thing, except for a skirt: what is much lower than
the thing it touches (floor mistaken for an obstacle, a low thing beside a high one) is taken by itself.
The plan is the rectangle of least area round a thing, and each of its edges is where half of the thing's
outline along that edge lies: stray points at silhouettes, and a face that one frame in ten has seen
too far out, do not move it.

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


@dataclass(frozen=True)
class FootprintConfig:
    """What hangs together, what is too little, and how sure an edge can be."""

    cell_m: float = 0.02  # ours: grain of the outline, as the voxels of the cloud
    gap_m: float = 0.08  # ours: wider gaps part two things; two cells of a depth camera at 3 m
    skirt: float = 0.3  # ours: lower than this share of the thing's height is not part of it
    least_points: int = 20  # ours: fewer voxels are no thing
    least_neighbours: int = 4  # ours: voxels with fewer others within the gap are stray
    least_sightings: int = (
        2  # ours: where sightings are given, voxels seen in fewer frames are stray
    )
    fringe_m: float = 0.05  # ours: how far stray voxels lie off a face
    fringe: float = 0.25  # ours: a column this much thinner than one beside it is its fringe
    edge_sigma_m: float = 0.01  # ours: what fused depth leaves as bias of a face

    def __post_init__(self) -> None:
        if not 0.0 < self.cell_m <= self.gap_m:
            raise ConfigError(
                f"footprints: cell_m={self.cell_m} must be positive and at most gap_m={self.gap_m}"
            )
        if not 0.0 <= self.skirt < 1.0:
            raise ConfigError(f"footprints: skirt={self.skirt} must lie in [0, 1)")
        if self.least_points < 3:
            raise ConfigError(f"footprints: least_points={self.least_points} must be at least 3")
        if not self.edge_sigma_m > 0.0:
            raise ConfigError(f"footprints: edge_sigma_m={self.edge_sigma_m} must be positive")


@dataclass(frozen=True)
class Footprint:
    """One thing on the floor: a rectangle, and how sure we are of its middle.

    Args:
        centre: (2,), middle of the rectangle, world frame, m.
        length_m: The longer side.
        width_m: The shorter side.
        yaw_rad: Direction of the longer side, in [-pi/2, pi/2).
        height_m: Top above the floor.
        covariance: (2, 2) of the centre, m^2.
        points: Voxels it was made of.
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
    """The things that stand on the floor, those of most points first.

    Args:
        points_world: Obstacle points, averaged voxel by voxel, world frame with z the height above the
            floor, m; NaN is passed over.
        config: Thresholds.
        sightings: In how many frames each voxel was seen; None: not known.

    Returns:
        One footprint a thing; an empty list where nothing stands.

    Raises:
        InputError: Not one number of sightings a point.
    """
    config = config or FootprintConfig()
    keep = np.isfinite(points_world).all(axis=1)
    if sightings is not None and len(sightings) != len(points_world):
        raise InputError(
            f"footprints: {len(points_world)} points but {len(sightings)} sightings; give one a point"
        )
    keep[keep] = _has_company(points_world[keep].astype(np.float64), config)
    points = points_world[keep].astype(np.float64)
    weights = np.ones(len(points)) if sightings is None else sightings[keep].astype(np.float64)
    things: list[np.ndarray] = []
    for part in _parts(points, config):
        if np.quantile(weights[part], 0.9) >= 2 * config.least_sightings:  # a part well seen
            part = part[weights[part] >= config.least_sightings]
        trunk = _trunk(points[part], config)
        things += [part[trunk][sub] for sub in _parts(points[part[trunk]], config)]
        things += [part[~trunk][sub] for sub in _parts(points[part[~trunk]], config)]
    things = [thing for thing in things if len(thing) >= config.least_points]
    things.sort(key=lambda thing: (-len(thing), *points[thing[0]].tolist()))
    return [_footprint(points[thing], weights[thing], config) for thing in things]


def _cells(
    points: Float[np.ndarray, "n 3"], config: FootprintConfig
) -> tuple[Int[np.ndarray, "k 2"], Int[np.ndarray, "n"]]:
    """The cells of the floor plane that hold points, and which of them each point is in."""
    lattice = np.floor(points[:, :2] / config.cell_m).astype(np.int64)
    cells, cell = np.unique(lattice, axis=0, return_inverse=True)
    return cells, cell.reshape(-1)


def _has_company(
    points: Float[np.ndarray, "n 3"], config: FootprintConfig
) -> Bool[np.ndarray, "n"]:
    """Voxels with enough others near them, in space: single flying pixels have none."""
    if not len(points):
        return np.zeros(0, np.bool_)
    near = cKDTree(points).query_ball_point(points, config.gap_m, return_length=True)
    return np.asarray(near) - 1 >= config.least_neighbours


def _parts(points: Float[np.ndarray, "n 3"], config: FootprintConfig) -> list[Int[np.ndarray, "k"]]:
    """Indices of the points of each part that hangs together on the floor plane."""
    if not len(points):
        return []
    cells, cell = _cells(points, config)
    pairs = cKDTree(cells).query_pairs(config.gap_m / config.cell_m + 1e-9, output_type="ndarray")
    links = coo_array((np.ones(len(pairs), np.int8), tuple(pairs.T)), shape=(len(cells),) * 2)
    count, label = connected_components(links, directed=False)
    of_point = label[cell]
    return [np.flatnonzero(of_point == k) for k in range(count)]


def _trunk(points: Float[np.ndarray, "n 3"], config: FootprintConfig) -> Bool[np.ndarray, "n"]:
    """Points in columns that are high enough to belong to the main body of a part."""
    cells, cell = _cells(points, config)
    top = np.full(len(cells), -np.inf)
    np.maximum.at(top, cell, points[:, 2])
    return top[cell] >= config.skirt * np.quantile(points[:, 2], 0.95)


def _footprint(
    points: Float[np.ndarray, "n 3"], weights: Float[np.ndarray, "n"], config: FootprintConfig
) -> Footprint:
    middle = points[:, :2].mean(axis=0)
    outline = _columns(points, weights, config) - middle
    yaw = _orientation(outline, config)
    axes = np.array([[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]])
    sides = _sides(outline @ axes.T, config)
    edges = np.array([side.edge for side in sides])  # -x, +x, -y, +y; outward
    variances = np.array([side.sigma**2 for side in sides]) + config.edge_sigma_m**2
    size = edges[::2] + edges[1::2]
    centre = middle + (edges[1::2] - edges[::2]) / 2 @ axes
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
    points: Float[np.ndarray, "n 3"], weights: Float[np.ndarray, "n"], config: FootprintConfig
) -> Float[np.ndarray, "k 2"]:
    """Mean places of the columns that make the plan; the thin fringe of dense ones is left out.

    A side face stacks many voxels on few columns. What flies off it makes columns of few voxels right
    beside; a horizontal face has few voxels on all of its columns, and keeps them.
    """
    _, cell = _cells(points, config)
    weight = np.bincount(cell, weights)
    count = np.bincount(cell)
    places = np.stack([np.bincount(cell, points[:, axis]) / count for axis in range(2)], axis=1)
    around = cKDTree(places).query_pairs(config.fringe_m, output_type="ndarray")
    densest = weight.copy()
    np.maximum.at(densest, around[:, 0], weight[around[:, 1]])
    np.maximum.at(densest, around[:, 1], weight[around[:, 0]])
    return places[weight >= config.fringe * densest]


def _orientation(outline: Float[np.ndarray, "k 2"], config: FootprintConfig) -> float:
    """Yaw in [0, pi/2) at which most of the outline lies on the four sides of a rectangle, rad."""

    def support(yaw: float) -> float:
        c, s = math.cos(yaw), math.sin(yaw)
        return sum(side.support for side in _sides(outline @ np.array([[c, -s], [s, c]]), config))

    step = math.radians(2.0)
    best = max((k * step for k in range(45)), key=support)
    while step > math.radians(0.1):
        step /= 3
        best = max((best + k * step for k in (0, -1, 1, -2, 2)), key=support)
    return best % (math.pi / 2)


class _Side(NamedTuple):
    """One side of the rectangle: distance outward, deviation, m; strips of the outline that lie on it."""

    edge: float
    sigma: float
    support: float


def _sides(local: Float[np.ndarray, "k 2"], config: FootprintConfig) -> list[_Side]:
    """The sides towards -x, +x, -y, +y of an outline in the rectangle's axes, m.

    The outline is cut into strips square to a side; how far out it reaches in each of them tells where the
    side lies. Of a thing of which two faces were seen, the other two sides are only touched by the faces'
    ends: the strips that reach as far as the farthest few columns decide, be they all or these few.
    """
    sides = []
    for axis in range(2):
        along = local[:, 1 - axis]
        strip = np.floor((along - along.min()) / config.cell_m).astype(np.int64)
        for sign in (-1.0, 1.0):
            reach = np.full(int(strip.max()) + 1, -np.inf)
            outward = sign * local[:, axis]
            np.maximum.at(reach, strip, outward)
            few = min(len(outward), max(3, len(outward) // 50))
            farthest = float(np.partition(outward, -few)[-few])
            sides.append(_side(reach[reach >= farthest - config.fringe_m], config))
    return sides


def _side(reach: Float[np.ndarray, "strips"], config: FootprintConfig) -> _Side:
    """Where the side lies by how far out the outline reaches in each strip that touches it, m."""
    edge = float(np.median(reach))
    deviation = reach - edge
    sigma = 1.48 * float(np.median(np.abs(deviation))) / math.sqrt(len(reach))
    return _Side(edge, sigma, float(np.exp(-0.5 * (deviation / config.cell_m) ** 2).sum()))
