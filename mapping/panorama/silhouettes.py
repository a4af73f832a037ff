"""Where things end, measured in the views themselves: finer than a pixel, and told in the base frame.

The panorama says which thing a pixel belongs to; where it ends is asked of the views, as drawing them on
one sphere moves edges by up to a pixel. In each row of a view the edge lies half way between the last pixel
that shows the thing and the first that shows what is beyond: a mixed pixel between both knows nothing and
is shared by them. An edge crosses the rows at different places within the pixel, so that their mean is
finer than one.

Source: seed 004, section 8 ("one pixel is 0.34 to 0.83 % of the width: sub-pixel edges are needed");
the method is ours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Int32

from perception.primitives.errors import ConfigError
from perception.primitives.plane import Plane
from perception.primitives.pose import Pose3

from .rendering import Drawing
from .views import View


@dataclass(frozen=True)
class SilhouetteConfig:
    """How edges are read off the rows of a view."""

    mixed_px: int = 3  # ours: what lies beyond an edge is looked for so far behind it
    nearer_m: float = 0.025  # ours: what is so much nearer hides the edge; five deviations
    outer_share: float = 0.25  # ours: an edge is what this share of the rows reach or exceed
    same_px: float = 1.5  # ours: rows that end so close to it show the same edge
    alike_rows: float = 4.0  # ours: neighbouring rows cross at the same place in the pixel
    least_px: float = 0.08  # ours: deviation of an edge that many rows agree upon
    inner_px: int = 5  # ours: so many pixels tell how a face goes on to its edge
    bent_share: float = (
        0.02  # ours: off a face by more of their depth, they show a crease or two things
    )
    hidden_share: float = 0.3  # ours: an edge hidden in so many rows is not the thing's own
    same_range_m: float = 0.05  # seed 004: one slice; a pixel so near to the drawing's is the same

    def __post_init__(self) -> None:
        if self.mixed_px < 1 or self.inner_px < 2:
            raise ConfigError(
                f"silhouettes: mixed_px={self.mixed_px} must be at least 1 and "
                f"inner_px={self.inner_px} at least 2"
            )
        for name in ("nearer_m", "same_px", "alike_rows", "least_px", "same_range_m"):
            if not getattr(self, name) > 0.0:
                raise ConfigError(f"silhouettes: {name}={getattr(self, name)} must be positive")
        if not 0.0 < self.outer_share < 1.0:
            raise ConfigError(f"silhouettes: outer_share={self.outer_share} must lie in (0, 1)")


@dataclass(frozen=True, eq=False)
class LabelledView:
    """One view that is placed, with the thing each of its pixels shows.

    Args:
        view: As given.
        T_base_camera: Where it was.
        number: Of the view, as they were given.
        labels: Thing at each pixel, as of the panorama; 0 for none.
    """

    view: View
    T_base_camera: Pose3
    number: int
    labels: Int32[np.ndarray, "h w"]


def label_view(
    view: View,
    T_base_camera: Pose3,
    number: int,
    drawing: Drawing,
    labels: Int32[np.ndarray, "a b"],
    floor: Plane,
    heights_m: tuple[float, float],
    config: SilhouetteConfig,
) -> LabelledView:
    """Find the panorama's things in one of its views.

    Args:
        view: As given to the panorama.
        T_base_camera: Where it was placed.
        number: Of the view.
        drawing: The panorama's.
        labels: Its things.
        floor: Base frame.
        heights_m: Least and greatest height of a thing's pixels above the floor.
        config: How near a pixel must be to what is drawn there.
    """
    z = view.depth.z
    points = view.depth.camera.rays * z[..., None].astype(np.float64)
    points = points @ T_base_camera.rotation.T + T_base_camera.position
    height = floor.distance(points)
    with np.errstate(invalid="ignore"):
        standing = (height >= heights_m[0]) & (height <= heights_m[1])
    found = np.zeros(z.shape, np.int32)
    row, column = np.nonzero(standing)
    away = points[row, column] - drawing.centre
    distance = np.linalg.norm(away, axis=1)
    sphere = drawing.sphere
    x = (np.arctan2(-away[:, 1], away[:, 0]) - sphere.left_rad) * sphere.px_per_rad
    y = (sphere.top_rad - np.arcsin(away[:, 2] / distance)) * sphere.px_per_rad
    x, y = np.rint(x).astype(int), np.rint(y).astype(int)
    mine = np.zeros(row.size, np.int32)
    for dy, dx in ((0, 0), (0, -1), (0, 1), (-1, 0), (1, 0), (-1, -1), (-1, 1), (1, -1), (1, 1)):
        place = (
            np.clip(y + dy, 0, sphere.height - 1),
            np.clip(x + dx, 0, sphere.width - 1),
        )
        with np.errstate(invalid="ignore"):
            close = np.abs(drawing.range_m[place] - distance) <= config.same_range_m
        new = (mine == 0) & close
        mine[new] = labels[place][new]
    found[row, column] = mine
    for _ in range(config.mixed_px):
        _grow(found, standing, z, config.nearer_m)
    return LabelledView(view, T_base_camera, number, found)


def _grow(
    labels: Int32[np.ndarray, "h w"],
    standing: Bool[np.ndarray, "h w"],
    z: Float32[np.ndarray, "h w"],
    within_m: float,
) -> None:
    """Give pixels without a label that of a neighbour at the same depth, in place: drawing loses rims."""
    height, width = labels.shape
    before = labels.copy()
    for down, across in ((0, -1), (0, 1), (-1, 0), (1, 0)):
        here = (
            slice(max(0, -down), height - max(0, down)),
            slice(max(0, -across), width - max(0, across)),
        )
        there = (
            slice(max(0, down), height + min(0, down)),
            slice(max(0, across), width + min(0, across)),
        )
        with np.errstate(invalid="ignore"):
            same = np.abs(z[here] - z[there]) <= within_m
        new = standing[here] & (labels[here] == 0) & (before[there] > 0) & same
        labels[here][new] = before[there][new]


@dataclass(frozen=True, eq=False)
class EdgeCrossings:
    """Where rows (or columns) of one view leave a thing.

    Args:
        points: Of the edge, base frame, m.
        values: How far outward each lies: azimuth to the left or right, rad, or height above the floor, m.
        unit: What a pixel is there, in the same unit.
        hidden: Whether what comes next is nearer.
        open: Whether the view ends there, or nothing is known beyond.
        number: Of the view.
    """

    points: Float[np.ndarray, "n 3"]
    values: Float[np.ndarray, "n"]
    unit: Float[np.ndarray, "n"]
    hidden: Bool[np.ndarray, "n"]
    open: Bool[np.ndarray, "n"]
    number: int


def edge_crossings(
    seeing: LabelledView, label: int, side: str, floor: Plane, config: SilhouetteConfig
) -> EdgeCrossings | None:
    """Where a view's rows leave a thing to the "left" or "right", or its columns leave it at the "top".

    Returns:
        None if the view does not show the thing.
    """
    mask, z = seeing.labels == label, seeing.view.depth.z
    if side == "top":
        mask, z = mask.T, z.T
    elif side == "right":
        mask, z = mask[:, ::-1], z[:, ::-1]
    lines = np.flatnonzero(mask.sum(axis=1) >= 2)
    if lines.size == 0:
        return None
    end, own, hidden, outside = row_ends(mask[lines], z[lines], config)
    if side == "right":
        end = z.shape[1] - 1 - end
    u, v = (lines.astype(float), end) if side == "top" else (end, lines.astype(float))
    camera = seeing.view.depth.camera
    points = camera.back_project(np.column_stack([u, v]), own)
    points = points @ seeing.T_base_camera.rotation.T + seeing.T_base_camera.position
    if side == "top":
        values, unit = floor.distance(points), own / camera.fy
    else:
        sign = 1.0 if side == "left" else -1.0
        values = sign * np.arctan2(points[:, 1], points[:, 0])
        unit = own / camera.fx / np.hypot(points[:, 0], points[:, 1])
    return EdgeCrossings(points, values, unit, hidden, outside, seeing.number)


def row_ends(
    mask: Bool[np.ndarray, "h w"], z: Float32[np.ndarray, "h w"], config: SilhouetteConfig
) -> tuple[
    Float[np.ndarray, "h"], Float[np.ndarray, "h"], Bool[np.ndarray, "h"], Bool[np.ndarray, "h"]
]:
    """Of each row its first end: place in px, depth of the thing there, whether hidden, whether open."""
    line = np.arange(mask.shape[0])
    last = mask.argmax(axis=1)
    end = last - 0.5
    beyond = np.full(line.size, np.nan)
    for step in range(1, config.mixed_px + 2):
        place = last - step
        told = np.where(place >= 0, z[line, np.maximum(place, 0)], np.nan)
        further = np.where(place >= 1, z[line, np.maximum(place - 1, 0)], told)
        with np.errstate(invalid="ignore"):
            mixed = np.abs(further - told) > config.nearer_m + config.bent_share * told
        mixed &= step <= config.mixed_px
        new = np.isnan(beyond) & np.isfinite(told) & ~mixed
        beyond[new] = told[new]
        end[new] = last[new] - 0.5 * step
    own = _depth_at(mask, z, last, end, config)
    with np.errstate(invalid="ignore"):
        hidden = beyond < own - config.nearer_m
    return end, own, hidden, (last <= 1) & np.isnan(beyond)


def _depth_at(
    mask: Bool[np.ndarray, "h w"],
    z: Float32[np.ndarray, "h w"],
    last: Int[np.ndarray, "h"],
    end: Float[np.ndarray, "h"],
    config: SilhouetteConfig,
) -> Float[np.ndarray, "h"]:
    """Depth of the thing at its end: its face, on which 1/z is linear, goes on as far as the edge."""
    line = np.arange(mask.shape[0])[:, None]
    steps = np.arange(config.inner_px)
    reach = np.minimum(last[:, None] + steps, mask.shape[1] - 1)
    shown = mask[line, reach] & np.isfinite(z[line, reach])
    inverse = np.where(shown, 1.0 / z[line, reach].astype(np.float64), np.nan)
    whole = shown.all(axis=1)
    level = 1.0 / np.nanmedian(inverse, axis=1)
    middle = (config.inner_px - 1) / 2.0
    slope = (np.where(shown, inverse, 0.0) @ (steps - middle)) / float(
        ((steps - middle) ** 2).sum()
    )
    straight = 1.0 / (np.where(shown, inverse, 1.0).mean(axis=1) + slope * (end - last - middle))
    line_of = np.where(shown, inverse, 1.0).mean(axis=1)[:, None] + slope[:, None] * (
        steps - middle
    )
    bent = np.abs(np.where(shown, inverse / line_of - 1.0, 0.0)).max(axis=1)
    return np.where(whole & (bent < config.bent_share), straight, level)


@dataclass(frozen=True)
class Edge:
    """An edge of a thing, all views together.

    Args:
        point: Its place, base frame, m.
        value: Azimuth outward, rad, or height, m.
        sigma: Deviation of it as pixels give it; poses come on top.
        view: The view that shows most of it.
        own: Whether it is the thing's own edge: neither hidden nor cut off.
    """

    point: tuple[float, float, float]
    value: float
    sigma: float
    view: int
    own: bool


def fuse_edge(found: Sequence[EdgeCrossings], config: SilhouetteConfig) -> Edge | None:
    """One edge out of what several views' rows say.

    Args:
        found: Of one side of one thing.
        config: Which rows count.

    The outermost view leads: what a share of its rows reach is the edge, and every row of any view that
    ends close to it counts. Rows that are open count only where there are no others.
    """
    free = any(not c.open.all() for c in found)
    usable = [(c, ~c.open if free else np.ones(c.open.size, bool)) for c in found]
    usable = [(c, kept) for c, kept in usable if kept.any()]
    if not usable:
        return None
    reach, unit = max(
        (float(np.quantile(c.values[kept], 1.0 - config.outer_share)), float(np.median(c.unit)))
        for c, kept in usable
    )
    close = [(c, kept & (np.abs(c.values - reach) <= config.same_px * unit)) for c, kept in usable]
    values = np.concatenate([c.values[kept] for c, kept in close])
    if values.size == 0:
        return None
    point = np.concatenate([c.points[kept] for c, kept in close]).mean(axis=0)
    spread = max(float(values.std()), 0.15 * unit)
    sigma = spread / np.sqrt(max(values.size / config.alike_rows, 1.0))
    hidden = np.concatenate([c.hidden[kept] for c, kept in close])
    leading = max(close, key=lambda pair: int(pair[1].sum()))[0]
    x, y, z = (float(v) for v in point)
    return Edge(
        (x, y, z),
        float(values.mean()),
        max(float(sigma), config.least_px * unit),
        leading.number,
        free and float(hidden.mean()) < config.hidden_share,
    )
