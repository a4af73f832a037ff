"""Columns: the obstacle cloud as vertical stacks of voxels on a 2 cm lattice of the floor.

A vertical face stacks many voxels on few columns; outliers form columns of few voxels beside them, the fringe. Every
column keeps where the sensor stood on average when it saw it: that mean lies on the visible side of a face, because the
places from which a face is visible form a half plane.

Source: ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import TypeVar

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

CELL_M = 0.02  # ours: side of a column, that of the cloud's voxels
FRINGE_M = 0.05  # ours: distance of outlier voxels from a face
FRINGE = 0.25  # ours: columns with a smaller share of a neighbour's voxels are its fringe
UPRIGHT_M = 0.06
"""Ours: a column at least this high, or half as high as the obstacle, is part of a face."""


Kind = TypeVar("Kind", bound="Seen")


@dataclass(frozen=True, eq=False)
class Seen:
    """How voxels, or columns of them, were seen; means over a column.

    Args:
        stay: Share of the frames that saw the cell of the map in which an obstacle stood there; NaN if not known.
        sensor: Mean position of the sensor, world frame, m; NaN if not known.
        pose_variance: Mean variance of the place by the uncertainty of the pose, per axis, m^2.
        noise_variance: Mean variance of the points by the noise of the sensor, per axis, m^2.
        colour: Mean colour, RGB from 0 to 255; NaN without a camera.
        occupancy: Probability that an obstacle covers the cell of the map; NaN if not known.
    """

    stay: Float[np.ndarray, "n"]
    sensor: Float[np.ndarray, "n 2"]
    pose_variance: Float[np.ndarray, "n"]
    noise_variance: Float[np.ndarray, "n"]
    colour: Float[np.ndarray, "n 3"]
    occupancy: Float[np.ndarray, "n"]

    def __len__(self) -> int:
        return len(self.stay)

    def of(self: Kind, chosen: Int[np.ndarray, "k"] | Bool[np.ndarray, "n"]) -> Kind:
        """Some of them."""
        return type(self)(*(getattr(self, name)[chosen] for name in self.__dataclass_fields__))


@dataclass(frozen=True, eq=False)
class Voxels(Seen):
    """Voxels of the obstacle cloud.

    Args:
        xyz: Mean points, world frame, z above the floor, m.
        sightings: Number of frames that saw each.
    """

    xyz: Float[np.ndarray, "n 3"]
    sightings: Float[np.ndarray, "n"]


@dataclass(frozen=True, eq=False)
class Columns(Seen):
    """Columns of voxels.

    Args:
        xy: Mean place of the voxels, m.
        weight: Sightings of all its voxels.
        count: Number of voxels.
        low, top: Heights of the lowest and the highest voxel, m.
        upright: Whether it is part of a vertical face.
    """

    xy: Float[np.ndarray, "n 2"]
    weight: Float[np.ndarray, "n"]
    count: Int[np.ndarray, "n"]
    low: Float[np.ndarray, "n"]
    top: Float[np.ndarray, "n"]
    upright: Bool[np.ndarray, "n"]

    @property
    def to_sensor(self) -> Float[np.ndarray, "n 2"]:
        """Unit direction to the sensor; NaN if not known."""
        away = self.sensor - self.xy
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(away / np.linalg.norm(away, axis=1, keepdims=True))


def stack(voxels: Voxels) -> Columns:
    """Columns of the voxels of one obstacle, without its fringe; ordered by place."""
    lattice = np.floor(voxels.xyz[:, :2] / CELL_M).astype(np.int64)
    _, cell = np.unique(lattice, axis=0, return_inverse=True)
    cell = cell.reshape(-1)
    count = np.bincount(cell)

    def mean(values: Float[np.ndarray, "n *d"]) -> Float[np.ndarray, "k *d"]:
        if values.ndim == 1:
            return np.asarray(np.bincount(cell, values) / count)
        return np.stack([mean(column) for column in values.T], axis=1)

    low, top = np.full(len(count), np.inf), np.full(len(count), -np.inf)
    np.minimum.at(low, cell, voxels.xyz[:, 2])
    np.maximum.at(top, cell, voxels.xyz[:, 2])
    xy = mean(voxels.xyz[:, :2])
    weight = np.bincount(cell, voxels.sightings)
    high = float(np.quantile(voxels.xyz[:, 2], 0.95))
    found = Columns(
        **{field.name: mean(getattr(voxels, field.name)) for field in fields(Seen)},
        xy=xy,
        weight=weight,
        count=count,
        low=low,
        top=top,
        upright=top - low >= min(UPRIGHT_M, 0.5 * high),
    )
    around = cKDTree(xy).query_pairs(FRINGE_M, output_type="ndarray")
    densest = weight.copy()
    np.maximum.at(densest, around[:, 0], weight[around[:, 1]])
    np.maximum.at(densest, around[:, 1], weight[around[:, 0]])
    return found.of(weight >= FRINGE * densest)


def connected(xy: Float[np.ndarray, "n 2"], gap_m: float) -> list[Int[np.ndarray, "k"]]:
    """Indices of the points of each part connected on the floor plane over gaps up to `gap_m`."""
    if not len(xy):
        return []
    lattice = np.floor(xy / CELL_M).astype(np.int64)
    cells, cell = np.unique(lattice, axis=0, return_inverse=True)
    pairs = cKDTree(cells).query_pairs(gap_m / CELL_M + 1e-9, output_type="ndarray")
    links = coo_array((np.ones(len(pairs), np.int8), tuple(pairs.T)), shape=(len(cells),) * 2)
    count, label = connected_components(links, directed=False)
    of_point = label[cell.reshape(-1)]
    return [np.flatnonzero(of_point == k) for k in range(count)]


def on_border(xy: Float[np.ndarray, "n 2"], gap_m: float) -> Bool[np.ndarray, "n"]:
    """Whether places lie on the outer border of all of them, closed over gaps."""
    reach = math.ceil(gap_m / CELL_M)
    cell = np.floor((xy - xy.min(axis=0)) / CELL_M).astype(np.int64) + 2 * reach
    mask = np.zeros(cell.max(axis=0)[::-1] + 2 * reach + 1, np.uint8)
    mask[cell[:, 1], cell[:, 0]] = 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (reach | 1, reach | 1))
    mask = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, disc)
    _, outside = cv2.connectedComponents(1 - mask, connectivity=4)
    solid = (outside != outside[0, 0]).astype(np.uint8)
    inner = cv2.erode(solid, np.ones((3, 3), np.uint8))
    return np.asarray(inner[cell[:, 1], cell[:, 0]] == 0)
