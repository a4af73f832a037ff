"""Clustering: points above the floor to separate obstacles, with position, size and covariance of each.

Connected points on a plan of small cells form a cluster. Objects that touch below but are separate above (people side
by side) are split by their tops. Only the near side of an object is visible, so its centre lies behind the mean of
its points: by pi/4 of the radius if it is round and far, the mean over the visible half of a circle; by more
close by, where less than half is visible. A sensor above an object sees its top, and so its far edge. The centre of a
truncated object is unknown, except for round ones
close by, to which a circle is fitted (`circle_fit`).

A cluster reaches down into the height of the robot; a shelf above is none. Walls and long furniture give large
clusters, which belong into the map and not to a tracker.

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

from ..floor.classify import ClassConfig
from ..floor.segmented_view import CUT, HOLE
from ..primitives.errors import ConfigError, InputError
from ..primitives.frame import Depth
from ..primitives.settings import setting
from . import circle_fit
from .row_gaps import NEIGHBOURS, Plan, Sensor, with_level

ENOUGH = 1000  # points of a cluster that its measurement uses at most
CELL_POINTS = 3.0  # ours: least points in a cell, scaled to 2 m; fewer are flying pixels
COARSE_RAD = 1 / 130  # ours: angle between two pixels; in coarser images a cell needs fewer points
TRUNCATED_POINTS = 3  # ours: points at a truncation that make a cluster truncated
OUTER, UNSEEN = 0.05, 0.5
"""Ours: share of the points of an object that are its left or right end, and of these beside a hole if it is not seen."""
FRONT_M = 0.05  # ours: a front rises more than this within this depth
HIDDEN_M = 1.0  # ours: standard deviation along the ray of a centre whose front is not seen
MERGED_M = 0.7  # ours: a longer cluster may be several objects
APART_M = 0.25  # ours: objects side by side rise this much above the height at which they touch
LEVEL_M = 0.10  # ours: height steps in which tops are compared
LEAST_CELLS = 3  # a top of fewer cells is a hand or a flying pixel
ROUND_M = 0.40
"""Ours: largest half width of a round object; the centre of others is that of the points."""
NEARNESS = (0.48, 0.93)
"""Growth of radius, and of the shift of the centre, with half width / distance; from simulated circles."""
SHAPE_PER_M = 0.6
"""Ours: centre error of a flat, round or angular front is this times radius squared, m."""
SEEN = 0.4  # ours: share of that error where both edges are seen
SLICE_M, SLICE_POINTS = 0.02, 3
"""Ours: an object whose top is seen is cut into slices along the ray; slices of fewer points are flying pixels."""
LEAST_SLOPE = 0.15  # ours: least slope of the line of sight at which a top shows its far edge
PLACE_SIGMA_M = 0.004  # ours: error common to all points of an object, at the sensor
PLACE_SIGMA_PER_M = 0.006  # ours: its growth with range; half a pixel at either edge
CIRCLE_MOST_M = 1.0  # ours: range up to which a circle is fitted to a truncated object
LEAST_CELL_M = 0.005  # ours: finer than any sensor, and a plan still fits into memory
SURFACE = 12  # ours: surface points of a cluster
RIM_PX = 3.5
"""Ours: mean over rendered rooms of the rim that blocks of 9 pixels leave out, 2 to 7 where disparity jumps by 1 to 60."""
LEAST_SHARE = 1e-6  # against division by zero


@dataclass(frozen=True)
class ClusterConfig:
    """Resolution and least size of clusters."""

    cell_m: float = setting(
        0.05,
        "m",
        "cell size of the plan; gaps up to this are bridged",
        "ours: wider than the quantisation of a Kinect at 3.5 m",
    )
    least_points: float = setting(
        20.0, "", "least points of a cluster, scaled to a range of 2 m", "ours: fewer are noise"
    )
    least_height_m: float = setting(
        0.03, "m", "least height of an obstacle", "ours: the floor threshold reaches 0.03 m"
    )

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"clusters: {name}={value} must be positive and finite")
        if self.cell_m < LEAST_CELL_M:
            raise ConfigError(f"clusters: cell_m={self.cell_m} must be at least {LEAST_CELL_M} m")


class Footprint(NamedTuple):
    """Rectangle on the floor: longer and shorter side, m; direction of the longer one, rad."""

    length_m: float
    width_m: float
    yaw_rad: float


@dataclass(frozen=True)
class Cluster:
    """One object on the floor.

    Args:
        centre: (2,), centre of its covering disc, m, in the frame of the points.
        covariance: (2, 2) of the centre, m^2.
        radius_m: Radius of the disc.
        height_m: Height of its top above the floor.
        points: Number of points.
        footprint: Rectangle of least area around its visible part.
        whole: Whether it is not truncated.
        circular: Whether it is truncated, but a circle was fitted to its front.
        surface: Indices of points on its front, away from its edges and its foot.
        goes_on_above: Whether the upper border of the image cuts it.
    """

    centre: Float[np.ndarray, "2"]
    covariance: Float[np.ndarray, "2 2"]
    radius_m: float
    height_m: float
    points: int
    footprint: Footprint
    whole: bool = True
    circular: bool = False
    surface: Int[np.ndarray, "k"] = field(default_factory=lambda: np.zeros(0, np.int64))
    goes_on_above: bool = False

    @property
    def placed(self) -> bool:
        """Whether centre and radius are those of the whole object, not only of its visible part."""
        return self.whole or self.circular


def rim_of(depth: Depth) -> float:
    """Angle, rad, at the left and right end of an object that has no depth, since block matching leaves it out."""
    return RIM_PX / depth.camera.fx if depth.baseline_m > 0.0 else 0.0


def cluster(
    points: Float[np.ndarray, "n 3"],
    sigma: Float[np.ndarray, "n"],
    sensor_xy: Float[np.ndarray, "2"],
    config: ClusterConfig | None = None,
    truncated: Int[np.ndarray, "n"] | None = None,
    floor_band: Float[np.ndarray, "n"] | None = None,
    uppermost: Bool[np.ndarray, "n"] | None = None,
    lowermost: Bool[np.ndarray, "n"] | None = None,
    sensor_height_m: float = 0.0,
    pitch_rad: float = 0.0,
    rim_rad: float = 0.0,
    top_m: float = ClassConfig().top_m,
) -> list[Cluster]:
    """Separate objects, the nearest to the sensor first.

    Args:
        points: Points above the floor in an upright frame, m; z is the height above the floor. Points above
            the robot's head help to separate objects that touch.
        sigma: Standard deviation of each point along its ray, m.
        sensor_xy: Position of the sensor, m.
        config: Sizes.
        truncated: Where the visible part of an object ends, as `segmented_view.truncated` gives it; None: no
            object is truncated.
        floor_band: Height at each point up to which it may be floor, with all errors of the plane
            (`classify.band`), m; a cluster whose top does not exceed it is none. None: the least height alone.
        uppermost: Points at the upper border of the image; None: no object reaches it.
        lowermost: Points at its lower border; an object there is truncated unless its front is seen above it.
        sensor_height_m: Height of the sensor above the floor.
        pitch_rad: Angle between two rows of pixels, the largest of several sensors; by it a level surface seen at a
            grazing angle stays one. 0: not known.
        rim_rad: Angle at either end of an object that has no depth, see `rim_of`; the smallest of several sensors.
        top_m: Height below which an obstacle must have points, of the robot and its headroom.

    Raises:
        InputError: Points or sigma are not finite.
    """
    config = config or ClusterConfig()
    if len(points) != len(sigma):
        raise InputError(
            f"clusters: {len(points)} points but {len(sigma)} sigmas; expected one each"
        )
    if len(points) == 0:
        return []
    if not (np.isfinite(points).all() and np.isfinite(sigma).all()):
        raise InputError(
            "clusters: points and sigma must be finite; leave out pixels without depth"
        )
    away = points - np.append(sensor_xy, sensor_height_m)
    weight = np.einsum("ij,ij->i", away, away) / 4.0  # density as seen from 2 m
    sensor = Sensor(sensor_xy, sensor_height_m, pitch_rad, rim_rad)
    labels, count = _label_objects(points, weight, sensor, config)
    short = labels.astype(np.uint16) if count < 2**16 else labels  # radix sort
    order = np.argsort(short, kind="stable")
    is_low = points[:, 2] < top_m
    low_mass = np.bincount(labels, weight * is_low, count + 1)[1:]
    borders = np.cumsum(np.bincount(labels, minlength=count + 1))
    found = []
    for (first, last), mass in zip(itertools.pairwise(borders), low_mass, strict=True):
        if mass < config.least_points:
            continue
        mine = order[first:last]
        whole = truncated is None or _ends(truncated, mine, labels) < TRUNCATED_POINTS
        cut_above = uppermost is not None and int(uppermost[mine].sum()) >= TRUNCATED_POINTS
        cut_below = lowermost is not None and int(lowermost[mine].sum()) >= TRUNCATED_POINTS
        mine = mine[:: max(len(mine) // ENOUGH, 1)]
        members = points[mine]
        whole &= truncated is None or not _ends_in_hole(truncated[mine], members, sensor_xy)
        height = float(np.quantile(members[:, 2], 0.99))
        band = 0.0 if floor_band is None else float(np.mean(floor_band[mine]))
        if height < max(config.least_height_m, band):
            continue
        above = -math.inf if cut_above else sensor_height_m - height
        measured = _measure(members, sigma[mine], int(last - first), sensor, height, above)
        if cut_below and not _front_seen(members, sensor_xy):
            measured = _with_hidden_front(measured, sensor_xy)
        elif not whole:
            measured = _with_circle(replace(measured, whole=False), members, sensor_xy)
        surface = mine[_front(members, sensor_xy, height)]
        found.append(replace(measured, surface=surface, goes_on_above=cut_above))
    return sorted(found, key=lambda c: float(np.hypot(*(c.centre - sensor_xy))))


def _ends(
    truncated: Int[np.ndarray, "n"], mine: Int[np.ndarray, "k"], labels: Int[np.ndarray, "n"]
) -> int:
    """Number of points of an object at which it ends; its own nearer points do not end it."""
    beside = truncated[mine]
    hider = np.where(beside >= 0, beside, mine)
    return int(np.count_nonzero((beside == CUT) | (labels[hider] != labels[mine])))


def _ends_in_hole(
    truncated: Int[np.ndarray, "n"],
    members: Float[np.ndarray, "n 3"],
    sensor_xy: Float[np.ndarray, "2"],
) -> bool:
    """Whether the left or the right end of an object is not seen, since there is no depth beside most of it."""
    hole = truncated == HOLE
    if not hole.any():
        return False
    away = members[:, :2] - sensor_xy
    middle = away.mean(axis=0)
    across = away @ np.array([-middle[1], middle[0]])
    left, right = np.quantile(across, (OUTER, 1.0 - OUTER))
    return bool(max(hole[across <= left].mean(), hole[across >= right].mean()) > UNSEEN)


def _front_seen(members: Float[np.ndarray, "n 3"], sensor_xy: Float[np.ndarray, "2"]) -> bool:
    """Whether the nearest part of an object is a front, and not the level part of a top."""
    away = np.hypot(*(members[:, :2] - sensor_xy).T)
    near = members[away < np.quantile(away, 0.03) + FRONT_M, 2]
    low, high = np.quantile(near, (0.1, 0.9))
    return bool(high - low > FRONT_M)


def _with_hidden_front(seen: Cluster, sensor_xy: Float[np.ndarray, "2"]) -> Cluster:
    """A cluster whose near end is not seen: how far away its centre is remains open."""
    ahead = seen.centre - sensor_xy
    ahead = ahead / max(float(np.linalg.norm(ahead)), 1e-9)
    return replace(
        seen, whole=False, covariance=seen.covariance + HIDDEN_M**2 * np.outer(ahead, ahead)
    )


def _label_objects(
    points: Float[np.ndarray, "n 3"],
    weight: Float[np.ndarray, "n"],
    sensor: Sensor,
    config: ClusterConfig,
) -> tuple[Int[np.ndarray, "n"], int]:
    """Label of the object of each point, from 1; 0 for isolated points. And the number of objects."""
    row, column = (np.floor(points[:, k] / config.cell_m).astype(np.int64) for k in (0, 1))
    first = np.array([row.min(), column.min()])
    row, column = row - first[0], column - first[1]
    rows, columns = int(row.max()) + 1, int(column.max()) + 1
    flat = row * columns + column
    plan = Plan(flat, (rows, columns), first * config.cell_m, config.cell_m)
    least = CELL_POINTS * COARSE_RAD / max(sensor.pitch_rad, COARSE_RAD)
    occupied, tops = with_level(points[:, 2], weight, sensor, plan, least)
    labels, count = ndimage.label(occupied, NEIGHBOURS)
    longest = MERGED_M / config.cell_m
    for number, box in enumerate(ndimage.find_objects(labels), start=1):
        if max(side.stop - side.start for side in box) <= longest:
            continue
        part = _split(labels[box] == number, tops[box])
        if part is not None:
            labels[box][part > 1] = part[part > 1] + count - 1
            count += int(part.max()) - 1
    return labels.reshape(-1)[flat], count


def _split(is_object: np.ndarray, tops: np.ndarray) -> Int[np.ndarray, "rows columns"] | None:
    """Parts of a cluster that are separate higher up, labelled from 1; None if it is one object.

    Level by level, a part becomes a summit when it is separate from the others and rises `APART_M` above the
    level; every other cell belongs to the nearest summit.
    """
    tops = np.where(is_object, tops, -np.inf)
    summits: list[np.ndarray] = []
    waiting = [(is_object, 0.0)]
    while waiting:
        region, level = waiting.pop()
        highest = float(tops[region].max())
        while level + APART_M < highest:
            level += LEVEL_M
            labels, count = ndimage.label(region & (tops >= level), NEIGHBOURS)
            numbers = np.arange(1, count + 1)
            highest_of = ndimage.maximum(tops, labels, numbers)
            cells_of = np.bincount(labels.ravel(), minlength=count + 1)[1:]
            rises = (highest_of >= level + APART_M) & (cells_of >= LEAST_CELLS)
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
    marked = np.zeros(is_object.shape, dtype=np.int64)
    for k, summit in enumerate(summits, start=1):
        marked[summit] = k
    _, (i, j) = ndimage.distance_transform_edt(marked == 0, return_indices=True)
    return np.where(is_object, marked[i, j], 0)


def _measure(
    members: Float[np.ndarray, "n 3"],
    sigma: Float[np.ndarray, "n"],
    count: int,
    sensor: Sensor,
    height_m: float,
    sensor_above_m: float,
) -> Cluster:
    """Disc, covariance and rectangle of one object, whose top the sensor is above by some height.

    The far edge of a top lies between its last row of pixels and the next one, wherever is equally likely.
    """
    mean = members[:, :2].mean(axis=0)
    ahead = mean - sensor.xy
    ahead = ahead / max(float(np.linalg.norm(ahead)), 1e-9)
    axes = np.stack([ahead, [-ahead[1], ahead[0]]])  # along the ray, across it
    local = (members[:, :2] - mean) @ axes.T
    nearest, left, farthest, right = _extent(local)
    away = float(np.linalg.norm(mean - sensor.xy))
    rim = sensor.rim_rad * math.hypot(away, sensor.height_m - float(members[:, 2].mean()))
    seen = (right - left) / 2.0
    across = seen + rim
    depth_seen = farthest - nearest
    noise = float(np.mean(sigma))
    place = math.hypot(PLACE_SIGMA_M, PLACE_SIGMA_PER_M * away, rim)
    top_seen, gap = sensor_above_m > LEAST_SLOPE * away, 0.0
    if top_seen:
        gap = sensor.pitch_rad * (away**2 + sensor_above_m**2) / sensor_above_m
        top_seen = gap < across
    if across <= ROUND_M and depth_seen <= 2.0 * ROUND_M:
        nearness = across / max(away, across)
        push = _mean_of_arc(seen, across) * (1.0 + NEARNESS[1] * nearness)
        across *= 1.0 if top_seen else 1.0 + NEARNESS[0] * nearness
        along = max(push, nearest + depth_seen / 2.0)
        if top_seen:
            along = _middle_of_evenly_spread(local[:, 0]) + gap / 4.0
        middle = np.array([along, (left + right) / 2.0])
        middle_local = local - middle
        reach = np.quantile(np.hypot(middle_local[:, 0], middle_local[:, 1]), 0.9)
        radius = max(across, float(reach) - 1.28 * noise)  # 90 % quantile of the noise
        shape = SHAPE_PER_M * radius**2
        unsure = math.hypot(SEEN * shape, gap / math.sqrt(48.0)) if top_seen else shape
        sigmas = np.array([math.hypot(unsure, place), SEEN * shape])
    else:
        middle = np.array([(nearest + farthest) / 2.0, (left + right) / 2.0])
        radius = math.hypot(across, depth_seen / 2.0)
        sigmas = np.full(2, SHAPE_PER_M * radius**2)
    sigmas = np.hypot(sigmas, noise / math.sqrt(min(len(members), 25)))
    sigmas[1] = math.hypot(sigmas[1], place)
    return Cluster(
        mean + axes.T @ middle,
        axes.T @ np.diag(sigmas**2) @ axes,
        radius,
        height_m,
        count,
        _rectangle(members[:, :2]),
    )


def _front(
    members: Float[np.ndarray, "n 3"], sensor_xy: Float[np.ndarray, "2"], height_m: float
) -> Int[np.ndarray, "k"]:
    """Points of the upper half of the front, in the middle half of the width, spread over the height."""
    away = members[:, :2] - sensor_xy
    middle = away.mean(axis=0)
    across = away @ np.array([-middle[1], middle[0]])
    left, right = np.quantile(across, (0.25, 0.75))
    inner = np.flatnonzero((across >= left) & (across <= right) & (members[:, 2] >= 0.5 * height_m))
    ordered = inner[np.argsort(members[inner, 2], kind="stable")]
    return (
        ordered[np.unique(np.linspace(0, len(ordered) - 1, SURFACE).astype(np.int64))]
        if len(ordered)
        else ordered
    )


def _with_circle(
    truncated: Cluster, members: Float[np.ndarray, "n 3"], sensor_xy: Float[np.ndarray, "2"]
) -> Cluster:
    """A truncated cluster, with the circle fitted to its front if it is near and round."""
    away = np.hypot(*(members[:, :2] - sensor_xy).T)
    if float(np.quantile(away, 0.03)) > CIRCLE_MOST_M:
        return truncated
    circle = circle_fit.fit(members[:, :2], sensor_xy)
    if circle is None:
        return truncated
    place = math.hypot(PLACE_SIGMA_M, PLACE_SIGMA_PER_M * float(away.mean()))
    return replace(
        truncated,
        centre=circle.centre,
        covariance=circle.covariance + place**2 * np.eye(2),
        radius_m=circle.radius_m,
        circular=True,
    )


def _mean_of_arc(half_width_m: float, radius_m: float) -> float:
    """Mean distance, m, of the front of a circle from the middle of it, over a part of its width; pi/4 radius of all."""
    share = min(max(half_width_m / max(radius_m, LEAST_SHARE), LEAST_SHARE), 1.0)
    return radius_m * (math.asin(share) / share + math.sqrt(1.0 - share * share)) / 2.0


def _extent(local: Float[np.ndarray, "n 2"]) -> tuple[float, float, float, float]:
    """Nearest, left, farthest and right end: 3 % quantiles, extended as for uniformly spread points."""
    low, high = np.quantile(local, (0.03, 0.97), axis=0)
    grown = (high - low) * 0.03 / 0.94
    low, high = low - grown, high + grown
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def _middle_of_evenly_spread(along: Float[np.ndarray, "n"]) -> float:
    """Middle between both ends, each slice along the ray counting alike: a front has more points than a top."""
    slices = np.floor(along / SLICE_M).astype(np.int64)
    slices -= slices.min()
    counts = np.bincount(slices)
    enough = counts >= min(SLICE_POINTS, int(counts.max()))
    weights = enough[slices] / counts[slices]
    order = np.argsort(along, kind="stable")
    below = np.cumsum(weights[order])
    ends = np.searchsorted(below, below[-1] * np.array([0.03, 0.97]))
    return float(along[order][np.minimum(ends, len(along) - 1)].mean())


def _rectangle(xy: Float[np.ndarray, "n 2"]) -> Footprint:
    """Rectangle of least area."""
    (_, (one, other), degrees) = cv2.minAreaRect(xy.astype(np.float32))
    yaw = math.radians(degrees) + (0.0 if one >= other else math.pi / 2.0)
    yaw = (yaw + math.pi / 2.0) % math.pi - math.pi / 2.0
    return Footprint(max(one, other), min(one, other), yaw)
