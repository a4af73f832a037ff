"""Obstacle points grouped into things, each with a place on the floor and how sure that place is.

Points are counted on a grid of the floor plane; cells that touch belong to one thing. Of a thing only the
near side is seen: a small round one is completed by the disc that its visible arc spans, a large one keeps
the rectangle of what was seen.

Source: seed 003, section 3 (obstacle points); seed 001, S14 (cylinders); completion is ours.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float
from scipy import ndimage

from . import _clusters_kernels
from .primitives.errors import ConfigError


@dataclass(frozen=True)
class ClusterConfig:
    """Grain and smallest thing."""

    cell_m: float = 0.05  # ours: as the terrain map; two things 10 cm apart stay two
    least_points: int = 40  # ours: stray points are no thing
    least_cell_points: int = 3  # seed 003: fewer points in a cell are stray
    least_height_m: float = 0.04  # ours: lower is carpet
    small_m: float = 0.45  # ours: longest side of what is taken for round
    tall_m: float = 1.2  # ours: only what is this tall is parted into several, by its heads
    prominence_m: float = 0.15  # ours: head over shoulder is 0.25 m
    arc_noise: float = 0.30  # ours: share of the radius by which a completed centre may be off

    def __post_init__(self) -> None:
        if not self.cell_m > 0.0:
            raise ConfigError(f"clusters: cell_m={self.cell_m} must be positive")
        if self.least_points < 1 or self.least_cell_points < 1:
            raise ConfigError(
                f"clusters: least_points={self.least_points} and "
                f"least_cell_points={self.least_cell_points} must be at least 1"
            )


@dataclass(frozen=True)
class Cluster:
    """One thing that rises from the floor, body frame.

    Args:
        centre: Of its disc, m.
        covariance: (2, 2) of the centre.
        radius_m: Of the disc that covers it.
        height_m: Its top above the floor.
        footprint: Length and width of the seen part, m, and direction of the length, rad.
        points: How many it rests on.
    """

    centre: Float[np.ndarray, "2"]
    covariance: Float[np.ndarray, "2 2"]
    radius_m: float
    height_m: float
    footprint: tuple[float, float, float]
    points: int


def cluster(
    points: Float[np.ndarray, "n 3"],
    sigma: Float[np.ndarray, "n"],
    sensor_xy: Float[np.ndarray, "2"],
    config: ClusterConfig | None = None,
) -> list[Cluster]:
    """Group obstacle points.

    Args:
        points: Upright frame, z the height over the floor, m.
        sigma: Deviation of each point's depth, m.
        sensor_xy: The camera on the floor plane, m.
        config: Grain and smallest thing.

    Returns:
        By distance from the sensor, nearest first.
    """
    config = config or ClusterConfig()
    if len(points) < config.least_points:
        return []
    low = points[:, :2].min(axis=0)
    cells = np.floor((points[:, :2] - low) / config.cell_m).astype(np.int64)
    shape = cells.max(axis=0) + 1
    flat = cells[:, 0] * shape[1] + cells[:, 1]
    counts = np.bincount(flat, minlength=int(shape[0] * shape[1])).reshape(shape)
    labels, number = ndimage.label(counts >= config.least_cell_points, np.ones((3, 3)))
    labels, number = _split(labels, number, cells, points[:, 2], config)
    label_of_point = labels.ravel()[flat]
    order = np.argsort(label_of_point, kind="stable")
    bounds = np.searchsorted(label_of_point[order], np.arange(1, number + 2))
    found = []
    for begin, end in zip(bounds[:-1], bounds[1:], strict=True):
        if end - begin < config.least_points:
            continue
        members = order[begin:end]
        if np.quantile(points[members, 2], 0.98) >= config.least_height_m:
            found.append(_describe(points[members], sigma[members], sensor_xy, config))
    return sorted(found, key=lambda c: float(np.linalg.norm(c.centre - sensor_xy)))


def _split(
    labels: np.ndarray, number: int, cells: np.ndarray, heights: np.ndarray, config: ClusterConfig
) -> tuple[np.ndarray, int]:
    """Part tall things that only touch: two people shoulder to shoulder have two heads."""
    top = np.full(labels.shape, -np.inf)
    np.maximum.at(top, (cells[:, 0], cells[:, 1]), heights)
    for label in range(1, number + 1):
        inside = labels == label
        if top[inside].max() < config.tall_m:
            continue
        smooth = ndimage.median_filter(np.where(inside, top, 0.0), size=3)  # flying pixels are no heads
        relief = np.where(inside, smooth, np.nan)
        flat = np.flatnonzero(inside)
        order = flat[np.argsort(-relief.ravel()[flat], kind="stable")]
        parts = _clusters_kernels.peaks(relief, order, config.prominence_m)
        for part in np.unique(parts[inside])[1:]:
            number += 1
            labels[parts == part] = number
    return labels, number


def _describe(
    points: np.ndarray, sigma: np.ndarray, sensor_xy: np.ndarray, config: ClusterConfig
) -> Cluster:
    xy = points[:, :2]
    rectangle = _rectangle(xy)
    length, width, _ = rectangle
    height = float(np.quantile(points[:, 2], 0.98))
    noise = float(np.median(sigma)) ** 2 / 9 + (config.cell_m / 10) ** 2  # points err together
    if length > config.small_m:
        middle = (xy.min(axis=0) + xy.max(axis=0)) / 2
        radius = length / 2
        return Cluster(middle, np.eye(2) * (noise + (0.1 * length) ** 2), radius, height,
                       rectangle, len(points))  # fmt: skip
    return _disc(xy, sensor_xy, height, noise, rectangle, config)


def _disc(
    xy: np.ndarray,
    sensor_xy: np.ndarray,
    height: float,
    noise: float,
    rectangle: tuple[float, float, float],
    config: ClusterConfig,
) -> Cluster:
    """The disc behind a visible arc: as wide as the arc is across the view, touching its near edge."""
    middle = np.median(xy, axis=0)
    away = middle - sensor_xy
    away = away / max(float(np.linalg.norm(away)), 1e-9)
    across = np.array([-away[1], away[0]])
    left, right = np.quantile((xy - sensor_xy) @ across, [0.99, 0.01])
    near = float(np.quantile((xy - sensor_xy) @ away, 0.03))
    far = float(np.quantile((xy - sensor_xy) @ away, 0.97))
    radius = float(np.clip((left - right) / 2, 0.03, 0.5))
    deep = max(radius, (far - near) / 2)  # a box seen end on is deeper than wide
    centre = sensor_xy + across * (left + right) / 2 + away * (near + deep)
    along = noise + (config.arc_noise * radius) ** 2 / 4
    sideways = noise + (config.arc_noise * radius) ** 2 / 16
    turn = np.column_stack([away, across])
    return Cluster(
        np.asarray(centre),
        turn @ np.diag([along, sideways]) @ turn.T,
        max(radius, deep),
        height,
        rectangle,
        len(xy),
    )


def _rectangle(xy: np.ndarray) -> tuple[float, float, float]:
    """Length, width and direction of the smallest rectangle round the points."""
    (_, (a, b), angle) = cv2.minAreaRect(xy.astype(np.float32))
    radians = float(np.radians(angle))
    return (float(a), float(b), radians) if a >= b else (float(b), float(a), radians + np.pi / 2)
