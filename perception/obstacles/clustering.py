"""Points that rise from the floor to separate things: where each is, how large, how sure.

On a plan of small cells, points that hang together are one thing. Things that touch lower down but stand
apart higher up (people side by side) are parted where their tops are. Only the near side of a thing is
seen, so its middle lies behind the mean of its points: by pi/4 of its radius if it is round and far, which
is the mean over the visible half of a circle; near by, where less than half is seen, by more. What the
view cuts off has its middle elsewhere, but for round things close by, of which a part is enough
(`round_front`).

What reaches down to where the robot walks is a thing; a shelf above it is not. Walls and long furniture
come out as large clusters, and it is for the reader to leave those to the map.

Source: ours; the footprint is the rectangle of least area after Freeman and Shapira 1975.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import ndimage

from ..primitives.errors import ConfigError, InputError
from . import circle_fit
from .circle_fit import FrontConfig

NEIGHBOURS = np.ones((3, 3), dtype=bool)
ENOUGH = 1000  # points that measure a thing as well as all of them
LEAST_CELLS = 3  # a top of fewer cells is a hand or a flying pixel
NEARNESS = (
    0.48,
    0.93,
)  # by which radius and push grow per (half width / distance); from circles drawn


@dataclass(frozen=True)
class ClusterConfig:
    """What hangs together, what is too little, and how unsure a middle is."""

    cell_m: float = (
        0.05  # ours: wider than the steps of a Kinect at 3.5 m; gaps up to this are bridged
    )
    cell_points: float = 3.0  # ours: points in a cell, as seen from 2 m; fewer are flying pixels
    least_points: float = 20.0  # ours: points of a thing, as seen from 2 m
    cut_points: int = 3  # ours: so many points at a cut make a thing incomplete
    least_height_m: float = 0.03  # ours: the least that rises from the floor's own band
    robot_top_m: float = 0.56  # seed 003: robot's height + 0.1 m; a thing has points below it
    merged_m: float = 0.7  # ours: longer than this it may be several things
    apart_m: float = 0.25  # ours: things side by side rise so much above where they touch
    level_m: float = 0.10  # ours: steps in which tops are compared
    round_m: float = 0.40  # ours: wider is no round thing; its middle is that of what is seen
    shape_per_m: float = 0.6  # ours: middle of a flat, round or edgy front: times radius squared, m
    place_sigma_m: float = 0.004  # ours: error that all points of a thing share, near the sensor
    place_sigma_per_m: float = 0.006  # ours: and growing with range; half a pixel at either edge
    front_m: float = 1.0  # ours: what is cut off further away can be looked at whole
    front: FrontConfig = field(default_factory=FrontConfig)

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if name != "front" and not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"clusters: {name}={value} must be positive and finite")


class Footprint(NamedTuple):
    """Rectangle on the floor: sides in m, the longer first; direction of the longer one, rad."""

    length_m: float
    width_m: float
    yaw_rad: float


@dataclass(frozen=True)
class Cluster:
    """One thing that stands on the floor.

    Args:
        centre: (2,), middle of the disc that covers it, m, in the frame of the points.
        covariance: (2, 2) of the centre, m^2.
        radius_m: Of that disc.
        height_m: Its top above the floor.
        points: How many it was seen with.
        footprint: Rectangle of least area round what was seen of it.
        whole: Whether all of it is in view.
        round: Whether it is cut off or half hidden, but its front tells where its middle is.
    """

    centre: Float[np.ndarray, "2"]
    covariance: Float[np.ndarray, "2 2"]
    radius_m: float
    height_m: float
    points: int
    footprint: Footprint
    whole: bool = True
    round: bool = False

    @property
    def placed(self) -> bool:
        """Whether centre and radius are those of all of it; else the centre is elsewhere."""
        return self.whole or self.round

    @property
    def length_m(self) -> float:
        """Longer side of what was seen."""
        return self.footprint.length_m


def cluster(
    points: Float[np.ndarray, "n 3"],
    sigma: Float[np.ndarray, "n"],
    sensor_xy: Float[np.ndarray, "2"],
    config: ClusterConfig | None = None,
    cut_off: Bool[np.ndarray, "n"] | None = None,
) -> list[Cluster]:
    """Separate things, the nearest to the sensor first.

    Args:
        points: What is not floor, in an upright frame, z the height over the floor, m. With the points
            above the robot's head things that touch are told apart better.
        sigma: Deviation of each point along its ray, m.
        sensor_xy: Where the sensor stands, m.
        config: Sizes.
        cut_off: Points at which a thing may go on unseen; None: everything is seen whole.

    Raises:
        InputError: Points or sigma are not finite.
    """
    config = config or ClusterConfig()
    if len(points) != len(sigma):
        raise InputError(f"clusters: {len(points)} points but {len(sigma)} sigmas; one for each")
    if len(points) == 0:
        return []
    if not (np.isfinite(points).all() and np.isfinite(sigma).all()):
        raise InputError(
            "clusters: points and sigma must be finite; leave out pixels without depth"
        )
    dx, dy = points[:, 0] - sensor_xy[0], points[:, 1] - sensor_xy[1]
    weight = (dx * dx + dy * dy) / 4.0  # density as seen from 2 m
    labels, count = _things(points, weight, config)
    short = labels.astype(np.uint16) if count < 2**16 else labels  # sorted by radix
    order = np.argsort(short, kind="stable")
    is_low = points[:, 2] < config.robot_top_m
    low_mass = np.bincount(labels, weight * is_low, count + 1)[1:]
    borders = np.cumsum(np.bincount(labels, minlength=count + 1))
    found = []
    for (first, last), mass in zip(itertools.pairwise(borders), low_mass, strict=True):
        if mass < config.least_points:
            continue
        mine = order[first:last]
        whole = cut_off is None or np.count_nonzero(cut_off[mine]) < config.cut_points
        mine = mine[:: max(len(mine) // ENOUGH, 1)]
        thing = points[mine]
        height = float(np.quantile(thing[:, 2], 0.99))
        if height < config.least_height_m:
            continue
        measured = _measure(thing, sigma[mine], int(last - first), sensor_xy, height, config)
        if not whole:
            measured = _by_its_front(replace(measured, whole=False), thing, sensor_xy, config)
        found.append(measured)
    return sorted(found, key=lambda c: float(np.hypot(*(c.centre - sensor_xy))))


def _things(
    points: Float[np.ndarray, "n 3"], weight: Float[np.ndarray, "n"], config: ClusterConfig
) -> tuple[Int[np.ndarray, "n"], int]:
    """Number of the thing each point belongs to, from 1; 0 for stray points."""
    row, column = (np.floor(points[:, k] / config.cell_m).astype(np.int64) for k in (0, 1))
    row -= row.min()
    column -= column.min()
    rows, columns = int(row.max()) + 1, int(column.max()) + 1
    flat = row * columns + column
    mass = np.bincount(flat, weight, rows * columns).reshape(rows, columns)
    labels, count = ndimage.label(mass >= config.cell_points, NEIGHBOURS)
    tops = np.full(rows * columns, -np.inf)
    np.maximum.at(tops, flat, points[:, 2])
    plan_tops = tops.reshape(rows, columns)
    longest = config.merged_m / config.cell_m
    for number, box in enumerate(ndimage.find_objects(labels), start=1):
        if max(side.stop - side.start for side in box) <= longest:
            continue
        part = _part(labels[box] == number, plan_tops[box], config)
        if part is not None:
            labels[box][part > 1] = part[part > 1] + count - 1
            count += int(part.max()) - 1
    return labels.reshape(-1)[flat], count


def _part(
    is_thing: np.ndarray, tops: np.ndarray, config: ClusterConfig
) -> Int[np.ndarray, "rows columns"] | None:
    """Parts of a thing that stand apart higher up, numbered from 1; None if it is one.

    Level by level, a part is a summit once it is apart from the others and rises `apart_m` above the
    level; every other cell goes to the nearest summit.
    """
    tops = np.where(is_thing, tops, -np.inf)
    summits: list[np.ndarray] = []
    waiting = [(is_thing, 0.0)]
    while waiting:
        region, level = waiting.pop()
        highest = float(tops[region].max())
        while level + config.apart_m < highest:
            level += config.level_m
            labels, count = ndimage.label(region & (tops >= level), NEIGHBOURS)
            numbers = np.arange(1, count + 1)
            highest_of = ndimage.maximum(tops, labels, numbers)
            cells_of = np.bincount(labels.ravel(), minlength=count + 1)[1:]
            rises = (highest_of >= level + config.apart_m) & (cells_of >= LEAST_CELLS)
            apart = [labels == k for k in numbers[rises]]
            if len(apart) != 1:
                waiting += [(one, level) for one in apart]
                break
            region = apart[0]
        else:
            summits.append(region)
            continue
        if not apart:
            summits.append(region)
    if len(summits) < 2:
        return None
    marked = np.zeros(is_thing.shape, dtype=np.int64)
    for k, summit in enumerate(summits, start=1):
        marked[summit] = k
    _, (i, j) = ndimage.distance_transform_edt(marked == 0, return_indices=True)
    return np.where(is_thing, marked[i, j], 0)


def _measure(
    thing: Float[np.ndarray, "n 3"],
    sigma: Float[np.ndarray, "n"],
    count: int,
    sensor_xy: Float[np.ndarray, "2"],
    height_m: float,
    config: ClusterConfig,
) -> Cluster:
    """Disc, covariance and rectangle of one thing."""
    mean = thing[:, :2].mean(axis=0)
    ahead = mean - sensor_xy
    ahead = ahead / max(float(np.linalg.norm(ahead)), 1e-9)
    axes = np.stack([ahead, [-ahead[1], ahead[0]]])  # along the ray, across it
    local = (thing[:, :2] - mean) @ axes.T
    nearest, left, farthest, right = _extent(local)
    across = (right - left) / 2.0
    depth_seen = farthest - nearest
    noise = float(np.mean(sigma))
    away = float(np.linalg.norm(mean - sensor_xy))
    place = math.hypot(config.place_sigma_m, config.place_sigma_per_m * away)
    if across <= config.round_m and depth_seen <= 2.0 * config.round_m:
        nearness = across / max(away, across)
        push = math.pi / 4.0 * across * (1.0 + NEARNESS[1] * nearness)
        across *= 1.0 + NEARNESS[0] * nearness
        along = max(push, nearest + depth_seen / 2.0)
        middle = np.array([along, (left + right) / 2.0])
        middle_local = local - middle
        reach = np.quantile(np.hypot(middle_local[:, 0], middle_local[:, 1]), 0.9)
        radius = max(across, float(reach) - 1.28 * noise)  # noise alone reaches so far out
        shape = config.shape_per_m * radius**2
        sigmas = np.array([math.hypot(shape, place), 0.4 * shape])
    else:
        middle = np.array([(nearest + farthest) / 2.0, (left + right) / 2.0])
        radius = math.hypot(across, depth_seen / 2.0)
        sigmas = np.full(2, config.shape_per_m * radius**2)
    sigmas = np.hypot(sigmas, noise / math.sqrt(min(len(thing), 25)))
    sigmas[1] = math.hypot(sigmas[1], place)
    return Cluster(
        mean + axes.T @ middle,
        axes.T @ np.diag(sigmas**2) @ axes,
        radius,
        height_m,
        count,
        _rectangle(thing[:, :2]),
    )


def _by_its_front(
    cut: Cluster,
    thing: Float[np.ndarray, "n 3"],
    sensor_xy: Float[np.ndarray, "2"],
    config: ClusterConfig,
) -> Cluster:
    """The same with the middle of the circle through its front, if it is near and round."""
    away = np.hypot(*(thing[:, :2] - sensor_xy).T)
    if float(np.quantile(away, 0.03)) > config.front_m:
        return cut
    front = circle_fit.fit(thing[:, :2], sensor_xy, config.front)
    if front is None:
        return cut
    place = math.hypot(config.place_sigma_m, config.place_sigma_per_m * float(away.mean()))
    return replace(
        cut,
        centre=front.centre,
        covariance=front.covariance + place**2 * np.eye(2),
        radius_m=front.radius_m,
        round=True,
    )


def _extent(local: Float[np.ndarray, "n 2"]) -> tuple[float, float, float, float]:
    """Nearest, left-most, farthest, right-most: ends of evenly spread points, stray ones left out."""
    low, high = np.quantile(local, (0.03, 0.97), axis=0)
    grown = (high - low) * 0.03 / 0.94
    low, high = low - grown, high + grown
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def _rectangle(xy: Float[np.ndarray, "n 2"]) -> Footprint:
    """Rectangle of least area."""
    (_, (one, other), degrees) = cv2.minAreaRect(xy.astype(np.float32))
    yaw = math.radians(degrees) + (0.0 if one >= other else math.pi / 2.0)
    yaw = (yaw + math.pi / 2.0) % math.pi - math.pi / 2.0
    return Footprint(max(one, other), min(one, other), yaw)
