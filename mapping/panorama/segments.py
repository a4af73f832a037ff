"""Segments: connected obstacles split where their outline is discontinuous or concave.

The walls of a room are connected with each other and with a carton that a mixed pixel joins to them. Listed as
one obstacle they say nothing about the free space between them. The outline on the floor plane, column by
column, has a discontinuity where one obstacle ends in front of another, and a concave corner where a wall
meets an obstacle.

Source: ours; outlines by `contours`, for the gaps of seed 004, eq. (20).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import median_filter

from perception.primitives.errors import InputError
from perception.primitives.plane import Plane

from .contours import LEAST_ROWS, fronts
from .obstacles import PanoramaObstacle
from .rendering import Drawing
from .sizes import LEVEL_FLOOR, RIM_RAD, TOP_M, SizeConfig, label_obstacles
from .stitching import Panorama

LEAP_M = 0.12  # ours: over two levels; a wall at a grazing angle moves a tenth of it per column
SMOOTH_COLUMNS = 5  # ours: mixed pixels are two columns wide
LEAST_COLUMNS = 4  # ours: 1 deg; narrower segments are rims
UNSEEN_COLUMNS = 5  # ours: narrower stripes without depth are dark spots


def outline_segments(
    panorama: Panorama,
    whole: Sequence[PanoramaObstacle],
    reach_m: float,
    floor: Plane = LEVEL_FLOOR,
    config: SizeConfig | None = None,
) -> list[PanoramaObstacle]:
    """Segments with a continuous outline of all labelled obstacles except the whole ones.

    Connected obstacles may show no edge in any view; `sizes.surroundings` then omits them, although their
    pixels prove an obstacle. Every obstacle wider than a rim that is not among the whole ones is split.

    Args:
        panorama: The panorama; one without a drawing has no segments.
        whole: Obstacles of `sizes.surroundings` of this panorama that are not to be split.
        reach_m: Columns at a larger forward distance are dropped.
        floor: As given to `surroundings`.
        config: As given to `surroundings`.

    Returns:
        The segments of each obstacle from left to right.

    Raises:
        InputError: A whole obstacle has other pixels here: `surroundings` had another floor or config.
    """
    config = config or SizeConfig()
    drawing = panorama.drawing
    if drawing is None:
        return []
    forward, labels = label_obstacles(drawing, panorama.placed, floor, config)
    done = {one.label for one in whole}
    for one in whole:
        here = int(np.count_nonzero(labels == one.label))
        if one.label and here != one.pixels:
            raise InputError(
                f"segments: obstacle {one.label} has {here} px here and {one.pixels} px in surroundings; give "
                "the floor and the config that surroundings was given"
            )
    rim = 3.0 * RIM_RAD * drawing.sphere.px_per_rad
    found = []
    for number in range(1, int(labels.max(initial=0)) + 1):
        mask = labels == number
        if number in done or np.count_nonzero(mask.any(axis=0)) <= rim:
            continue
        front, _ = fronts(forward, drawing.sigma_m, mask)
        for columns in _runs(drawing, front, reach_m):
            found.append(_segment(drawing, floor, mask, number, front[columns], columns))
    return found


def observed_sector(panorama: Panorama) -> tuple[float, float]:
    """Azimuths of the left and right end of the observed sector ahead, left positive.

    Every column within has depth, except narrow stripes. Space outside it is unknown, not free.
    """
    drawing = panorama.drawing
    if drawing is None:
        return 0.0, 0.0
    known = np.isfinite(drawing.range_m).sum(axis=0) >= LEAST_ROWS
    azimuth = _azimuths(drawing)
    ahead = int(np.argmin(np.abs(azimuth)))
    left = _unbroken(known[ahead::-1], UNSEEN_COLUMNS)
    right = _unbroken(known[ahead:], UNSEEN_COLUMNS)
    if left == 0 or right == 0:
        return 0.0, 0.0
    return float(azimuth[ahead - left + 1]), float(azimuth[ahead + right - 1])


def _azimuths(drawing: Drawing) -> Float[np.ndarray, "w"]:
    sphere = drawing.sphere
    return np.asarray(-(sphere.left_rad + np.arange(sphere.width) / sphere.px_per_rad))


def _unbroken(known: Bool[np.ndarray, "n"], patience: int) -> int:
    """Number of known columns from the first on, up to the first unknown stripe of `patience` columns."""
    last, blind = 0, 0
    for k, there in enumerate(known):
        blind = 0 if there else blind + 1
        if blind >= patience:
            break
        last = k + 1 if there else last
    return last


def _runs(drawing: Drawing, front: Float[np.ndarray, "w"], reach_m: float) -> list[np.ndarray]:
    """Columns of each segment."""
    known = np.flatnonzero(np.isfinite(front))
    if known.size == 0:
        return []
    x = median_filter(front[known], SMOOTH_COLUMNS, mode="nearest")
    near = x <= reach_m
    known, x = known[near], x[near]
    y = _across(drawing, known, x)
    leaps = np.hypot(np.diff(x), np.diff(y)) > LEAP_M
    whole = np.split(np.arange(known.size), np.flatnonzero(leaps) + 1)
    found = [known[part] for run in whole for part in _at_corners(x, y, run, LEAP_M)]
    return [run for run in found if run.size >= LEAST_COLUMNS]


def _at_corners(
    x: Float[np.ndarray, "n"], y: Float[np.ndarray, "n"], run: np.ndarray, most_m: float
) -> list[np.ndarray]:
    """Split an outline at its concave corners, where two obstacles meet.

    A convex corner, which points to the robot, belongs to one obstacle.

    Args:
        x, y: The whole outline, m, from left to right.
        run: Indices of a continuous part of it.
        most_m: Largest distance of the outline behind the straight line between its ends.
    """
    if run.size < 3:
        return [run]
    along = np.array([x[run[-1]] - x[run[0]], y[run[-1]] - y[run[0]]])
    behind = along[0] * (y[run] - y[run[0]]) - along[1] * (x[run] - x[run[0]])
    behind = behind / max(float(np.hypot(*along)), 1e-9)
    deepest = int(np.argmax(behind))
    if behind[deepest] <= most_m:
        return [run]
    left, right = run[:deepest], run[deepest:]
    return [*_at_corners(x, y, left, most_m), *_at_corners(x, y, right, most_m)]


def _across(
    drawing: Drawing, columns: np.ndarray, x: Float[np.ndarray, "n"]
) -> Float[np.ndarray, "n"]:
    """y of the outline, base frame, m."""
    slopes = np.tan(_azimuths(drawing)[columns])
    return np.asarray(drawing.centre[1] + (x - drawing.centre[0]) * slopes)


def _segment(
    drawing: Drawing,
    floor: Plane,
    mask: Bool[np.ndarray, "h w"],
    number: int,
    x: Float[np.ndarray, "n"],
    columns: np.ndarray,
) -> PanoramaObstacle:
    """One segment as an obstacle, with its own edges, distance and height."""
    y = _across(drawing, columns, x)
    left, right = int(np.argmax(y)), int(np.argmin(y))
    rows, at = np.nonzero(mask[:, columns])
    place = rows, columns[at]
    points = drawing.centre + drawing.sphere.rays[place] * drawing.range_m[place][:, None]
    height = max(float(np.percentile(floor.distance(points), 99.0)), 0.0)
    azimuth = np.arctan2(y, x)
    column = 1.0 / drawing.sphere.px_per_rad
    return PanoramaObstacle(
        left_rad=float(azimuth.max()),
        right_rad=float(azimuth.min()),
        distance_m=max(float(x.min()), 1e-3),
        width_m=float(np.ptp(y)),
        height_m=height,
        sigma_left_rad=column,
        sigma_right_rad=column,
        left_edge_m=(float(x[left]), float(y[left])),
        right_edge_m=(float(x[right]), float(y[right])),
        label=number,
        pixels=int(rows.size),
        cut_left=True,
        cut_right=True,
        cut_top=height > TOP_M - 0.02,
    )
