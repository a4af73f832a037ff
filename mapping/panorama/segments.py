"""What hangs together in a panorama, cut apart where its outline leaps or has a corner; and how far aside
ground was seen.

A room's walls hang together with each other, and with a carton that a mixed pixel ties to them: listed as one
thing they say nothing about the way between. The outline on the floor plan, column by column, leaps wherever
one thing ends before another; where a wall meets what stands across the way it has an inward corner.

Source: ours; outlines as `contours` draws them, for the gaps of seed 004, eq. (20).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import median_filter

from perception.primitives.errors import ConfigError, InputError
from perception.primitives.plane import Plane

from .contours import fronts
from .obstacles import PanoramaObstacle
from .rendering import Drawing
from .sizes import LEVEL_FLOOR, SizeConfig, label_obstacles
from .stitching import Panorama


@dataclass(frozen=True)
class PieceConfig:
    """What is cut, and where."""

    leap_m: float = (
        0.12  # ours: twice a level; a wall looked along moves on by a tenth of it a column
    )
    smooth_columns: int = 5  # ours: mixed pixels are two columns wide
    least_columns: int = 4  # ours: 1 deg; narrower pieces are rims
    unseen_columns: int = 5  # ours: narrower blind stripes are dark spots
    sizes: SizeConfig = field(default_factory=SizeConfig)

    def __post_init__(self) -> None:
        if not self.leap_m > 0.0:
            raise ConfigError(f"pieces: leap_m={self.leap_m} must be positive")
        if min(self.smooth_columns, self.least_columns, self.unseen_columns) < 1:
            raise ConfigError("pieces: column counts must be at least 1")


def outline_segments(
    panorama: Panorama,
    whole: Sequence[PanoramaObstacle],
    reach_m: float,
    config: PieceConfig | None = None,
    floor: Plane = LEVEL_FLOOR,
) -> list[PanoramaObstacle]:
    """What is not listed whole, as pieces that do not leap, nearer than a reach, from left to right each.

    Where things hang together no view may show an edge of them, and the listing leaves them out; but what has
    pixels stands there. So whatever is wider than a rim and not among the whole ones is cut to pieces.

    Args:
        panorama: Finished; one without a drawing has no pieces.
        whole: Things that `sizes.surroundings` lists of this panorama, and that need no cutting.
        reach_m: Forward distance; what is farther is left out.
        config: Where to cut; its sizes are those of the listing.
        floor: That of the listing.

    Raises:
        InputError: A whole thing has other pixels here, as it was listed by other sizes or another floor.
    """
    config = config or PieceConfig()
    drawing = panorama.drawing
    if drawing is None:
        return []
    forward, labels = label_obstacles(drawing, panorama.placed, floor, config.sizes)
    done = {one.label for one in whole}
    for one in whole:
        here = int(np.count_nonzero(labels == one.label))
        if one.label and here != one.pixels:
            raise InputError(
                f"pieces: thing {one.label} has {here} px, but {one.pixels} px where it was listed; give the "
                "sizes and the floor that surroundings was given"
            )
    rim = 3.0 * math.radians(config.sizes.rim_deg) * drawing.sphere.px_per_rad
    found = []
    for number in range(1, int(labels.max(initial=0)) + 1):
        mask = labels == number
        if number in done or np.count_nonzero(mask.any(axis=0)) <= rim:
            continue
        front, _ = fronts(forward, drawing.sigma_m, mask, config.sizes.contour)
        for columns in _runs(drawing, front, reach_m, config):
            found.append(_piece(drawing, mask, number, front[columns], columns, config))
    return found


def observed_sector(panorama: Panorama, config: PieceConfig | None = None) -> tuple[float, float]:
    """Azimuths to the left and to the right, left positive, up to which every column shows something.

    Beyond them nothing is known: not seen is not free.
    """
    config = config or PieceConfig()
    drawing = panorama.drawing
    if drawing is None:
        return 0.0, 0.0
    known = np.isfinite(drawing.range_m).sum(axis=0) >= config.sizes.contour.least_rows
    azimuth = _azimuths(drawing)
    ahead = int(np.argmin(np.abs(azimuth)))
    left = _unbroken(known[ahead::-1], config.unseen_columns)
    right = _unbroken(known[ahead:], config.unseen_columns)
    if left == 0 or right == 0:
        return 0.0, 0.0
    return float(azimuth[ahead - left + 1]), float(azimuth[ahead + right - 1])


def _azimuths(drawing: Drawing) -> Float[np.ndarray, "w"]:
    sphere = drawing.sphere
    return np.asarray(-(sphere.left_rad + np.arange(sphere.width) / sphere.px_per_rad))


def _unbroken(known: Bool[np.ndarray, "n"], patience: int) -> int:
    """How many columns from the first on are known but for stripes narrower than the patience."""
    last, blind = 0, 0
    for k, there in enumerate(known):
        blind = 0 if there else blind + 1
        if blind >= patience:
            break
        last = k + 1 if there else last
    return last


def _runs(
    drawing: Drawing, front: Float[np.ndarray, "w"], reach_m: float, config: PieceConfig
) -> list[np.ndarray]:
    """Columns of each piece."""
    known = np.flatnonzero(np.isfinite(front))
    if known.size == 0:
        return []
    x = median_filter(front[known], config.smooth_columns, mode="nearest")
    near = x <= reach_m
    known, x = known[near], x[near]
    y = _across(drawing, known, x)
    leaps = np.hypot(np.diff(x), np.diff(y)) > config.leap_m
    whole = np.split(np.arange(known.size), np.flatnonzero(leaps) + 1)
    found = [known[part] for run in whole for part in _at_corners(x, y, run, config.leap_m)]
    return [run for run in found if run.size >= config.least_columns]


def _at_corners(
    x: Float[np.ndarray, "n"], y: Float[np.ndarray, "n"], run: np.ndarray, most_m: float
) -> list[np.ndarray]:
    """An outline cut where it turns back towards the robot: what it is there is a corner of two things.

    A corner that points to the robot is one thing's own.

    Args:
        x, y: The whole outline, m, from left to right.
        run: Places in it that belong together.
        most_m: How far the outline may lie behind the straight line between its ends.
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
    away = np.tan(_azimuths(drawing)[columns])
    return np.asarray(drawing.centre[1] + (x - drawing.centre[0]) * away)


def _piece(
    drawing: Drawing,
    mask: Bool[np.ndarray, "h w"],
    number: int,
    x: Float[np.ndarray, "n"],
    columns: np.ndarray,
    config: PieceConfig,
) -> PanoramaObstacle:
    """One piece as a thing, with its own edges, distance and height."""
    y = _across(drawing, columns, x)
    left, right = int(np.argmax(y)), int(np.argmin(y))
    rows, at = np.nonzero(mask[:, columns])
    phi = drawing.sphere.top_rad - rows / drawing.sphere.px_per_rad
    z = drawing.centre[2] + drawing.range_m[rows, columns[at]] * np.sin(phi)
    height = max(float(np.percentile(z, 99.0)), 0.0)
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
        cut_top=height > config.sizes.top_m - 0.02,
    )
