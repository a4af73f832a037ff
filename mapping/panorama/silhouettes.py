"""Edges of obstacles, measured in the views with subpixel accuracy, in the base frame.

The panorama labels the pixels of an obstacle; its edges are measured in the views themselves, as drawing the
views on one sphere displaces edges by up to a pixel. In each image row the edge lies half way between the
last pixel of the obstacle and the first pixel of the background; a mixed pixel between them is shared. An
edge crosses the rows at different offsets within a pixel, so that the mean is finer than a pixel.

Source: Kang 2013 (seed 004), section 8 ("one pixel is 0.34 to 0.83 % of the width: sub-pixel edges are
needed"); the method is ours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Int32

from perception.primitives.plane import Plane
from perception.primitives.pose import Pose3

from .rendering import Drawing
from .views import View

MIXED_PX = 3  # ours: the background is searched up to this far behind an edge
NEARER_M = 0.025  # ours: a background nearer by this occludes the edge; five standard deviations
OUTER_SHARE = 0.25  # ours: share of the rows that reach the edge or beyond
SAME_PX = 1.5  # ours: rows that end this close to the edge show the same edge
CORRELATED_ROWS = 4.0  # ours: neighbouring rows that cross an edge at the same offset in the pixel
LEAST_PX = 0.08  # ours: smallest standard deviation of an edge
INNER_PX, LEAST_INNER_PX = 5, 3  # ours: pixels from which a face is extrapolated to its edge
BENT_SHARE = 0.02  # ours: relative depth residual of a face above which it has a crease
HIDDEN_SHARE = 0.3  # ours: an edge occluded in more rows is not the obstacle's own
SAME_RANGE_M = 0.05  # seed 004: one level; pixel and panorama this close show the same surface


@dataclass(frozen=True, eq=False)
class LabelledView:
    """A view with an estimated pose and the obstacle label of each of its pixels.

    Args:
        view: The view.
        T_base_camera: Its pose.
        number: Its index among the views of the panorama.
        labels: Obstacle at each pixel, numbered as in the panorama; 0 for none.
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
) -> LabelledView:
    """Transfer the obstacle labels of the panorama to one of its views.

    Args:
        view: The view.
        T_base_camera: Its pose.
        number: Its index.
        drawing: The panorama.
        labels: Obstacle labels of the panorama.
        floor: Base frame.
        heights_m: Lowest and highest height of obstacle pixels above the floor.
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
            close = np.abs(drawing.range_m[place] - distance) <= SAME_RANGE_M
        new = (mine == 0) & close
        mine[new] = labels[place][new]
    found[row, column] = mine
    for _ in range(MIXED_PX):
        _grow(found, standing, z)
    return LabelledView(view, T_base_camera, number, found)


def _grow(
    labels: Int32[np.ndarray, "h w"],
    standing: Bool[np.ndarray, "h w"],
    z: Float32[np.ndarray, "h w"],
) -> None:
    """Give unlabelled pixels the label of a neighbour at the same depth, in place: drawing loses rims."""
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
            same = np.abs(z[here] - z[there]) <= NEARER_M
        new = standing[here] & (labels[here] == 0) & (before[there] > 0) & same
        labels[here][new] = before[there][new]


@dataclass(frozen=True, eq=False)
class EdgeCrossings:
    """Points at which rows (or columns) of one view cross an edge of an obstacle.

    Args:
        points: Edge points, base frame, m.
        values: Outward coordinate: azimuth to the left or right, rad, or height above the floor, m.
        unit: Size of a pixel there, in the same unit.
        hidden: Whether the background is nearer, so that it occludes the edge.
        open: Whether the view ends there, or the background is unknown.
        number: Index of the view.
    """

    points: Float[np.ndarray, "n 3"]
    values: Float[np.ndarray, "n"]
    unit: Float[np.ndarray, "n"]
    hidden: Bool[np.ndarray, "n"]
    open: Bool[np.ndarray, "n"]
    number: int


def edge_crossings(view: LabelledView, label: int, side: str, floor: Plane) -> EdgeCrossings | None:
    """Subpixel crossings of one side of an obstacle in one view.

    Args:
        view: The view with its labels.
        label: Number of the obstacle.
        side: "left", "right" or "top".
        floor: Base frame.

    Returns:
        None if the view does not show the obstacle.
    """
    mask, z = view.labels == label, view.view.depth.z
    if side == "top":
        mask, z = mask.T, z.T
    elif side == "right":
        mask, z = mask[:, ::-1], z[:, ::-1]
    lines = np.flatnonzero(mask.sum(axis=1) >= 2)
    if lines.size == 0:
        return None
    end, own, hidden, outside = row_ends(mask[lines], z[lines])
    if side == "right":
        end = z.shape[1] - 1 - end
    u, v = (lines.astype(float), end) if side == "top" else (end, lines.astype(float))
    camera = view.view.depth.camera
    points = camera.back_project(np.column_stack([u, v]), own)
    points = points @ view.T_base_camera.rotation.T + view.T_base_camera.position
    if side == "top":
        values, unit = floor.distance(points), own / camera.fy
    else:
        sign = 1.0 if side == "left" else -1.0
        values = sign * np.arctan2(points[:, 1], points[:, 0])
        unit = own / camera.fx / np.hypot(points[:, 0], points[:, 1])
    return EdgeCrossings(points, values, unit, hidden, outside, view.number)


def row_ends(
    mask: Bool[np.ndarray, "h w"], z: Float32[np.ndarray, "h w"]
) -> tuple[
    Float[np.ndarray, "h"], Float[np.ndarray, "h"], Bool[np.ndarray, "h"], Bool[np.ndarray, "h"]
]:
    """First edge of each row: position, px; depth of the obstacle, m; whether occluded; whether open."""
    line = np.arange(mask.shape[0])
    last = mask.argmax(axis=1)
    end = last - 0.5
    beyond = np.full(line.size, np.nan)
    for step in range(1, MIXED_PX + 2):
        place = last - step
        behind = np.where(place >= 0, z[line, np.maximum(place, 0)], np.nan)
        further = np.where(place >= 1, z[line, np.maximum(place - 1, 0)], behind)
        with np.errstate(invalid="ignore"):
            mixed = np.abs(further - behind) > NEARER_M + BENT_SHARE * behind
        mixed &= step <= MIXED_PX
        new = np.isnan(beyond) & np.isfinite(behind) & ~mixed
        beyond[new] = behind[new]
        end[new] = last[new] - 0.5 * step
    own = _depth_at(mask, z, last, end)
    with np.errstate(invalid="ignore"):
        hidden = beyond < own - NEARER_M
    return end, own, hidden, (last <= 1) & np.isnan(beyond)


def _depth_at(
    mask: Bool[np.ndarray, "h w"],
    z: Float32[np.ndarray, "h w"],
    last: Int[np.ndarray, "h"],
    end: Float[np.ndarray, "h"],
) -> Float[np.ndarray, "h"]:
    """Depth of the obstacle at its edge, extrapolated along its outermost face, on which 1/z is linear.

    Of a face with fewer pixels before a crease, as a top seen at a grazing angle, fewer are used. Without any straight
    piece it is the median depth.
    """
    line = np.arange(mask.shape[0])[:, None]
    reach = np.minimum(last[:, None] + np.arange(INNER_PX), mask.shape[1] - 1)
    shown = mask[line, reach] & np.isfinite(z[line, reach])
    inverse = np.where(shown, 1.0 / z[line, reach].astype(np.float64), np.nan)
    found = 1.0 / np.nanmedian(inverse, axis=1)
    for count in range(LEAST_INNER_PX, INNER_PX + 1):
        level = inverse[:, :count].mean(axis=1)
        steps = np.arange(count) - (count - 1) / 2.0
        slope = inverse[:, :count] @ steps / float((steps**2).sum())
        face = level[:, None] + slope[:, None] * steps
        straight = np.abs(inverse[:, :count] / face - 1.0).max(axis=1) < BENT_SHARE
        at_end = level + slope * (end - last - (count - 1) / 2.0)
        found[straight] = 1.0 / at_end[straight]
    return found


@dataclass(frozen=True)
class Edge:
    """An edge of an obstacle, fused from all views.

    Args:
        point: Its position, base frame, m.
        value: Outward azimuth, rad, or height, m.
        sigma: Standard deviation of `value` by pixels, without the view's pose.
        view: Index of the view that shows most of it.
        own: Whether it is the obstacle's own edge, neither occluded nor cut off.
    """

    point: tuple[float, float, float]
    value: float
    sigma: float
    view: int
    own: bool


def fuse_edge(found: Sequence[EdgeCrossings]) -> Edge | None:
    """One edge from the crossings in several views.

    The view whose rows reach furthest outward defines the edge (`OUTER_SHARE` of its rows), and all rows of
    all views that end close to it are averaged. Open rows count only if there are no others.

    Args:
        found: Crossings of one side of one obstacle.
    """
    free = any(not c.open.all() for c in found)
    usable = [(c, ~c.open if free else np.ones(c.open.size, bool)) for c in found]
    usable = [(c, kept) for c, kept in usable if kept.any()]
    if not usable:
        return None
    reach, unit = max(
        (float(np.quantile(c.values[kept], 1.0 - OUTER_SHARE)), float(np.median(c.unit)))
        for c, kept in usable
    )
    close = [(c, kept & (np.abs(c.values - reach) <= SAME_PX * unit)) for c, kept in usable]
    values = np.concatenate([c.values[kept] for c, kept in close])
    if values.size == 0:
        return None
    point = np.concatenate([c.points[kept] for c, kept in close]).mean(axis=0)
    spread = max(float(values.std()), 0.15 * unit)
    sigma = spread / np.sqrt(max(values.size / CORRELATED_ROWS, 1.0))
    # rows that an edge parallel to the columns crosses at one offset within a pixel do not average it out
    parallel = [
        kept.sum() * np.sqrt(max(unit**2 / 12.0 - c.values[kept].var(), 0.0))
        for c, kept in close
        if kept.any()
    ]
    sigma = np.hypot(sigma, np.linalg.norm(parallel) / values.size)
    hidden = np.concatenate([c.hidden[kept] for c, kept in close])
    leading = max(close, key=lambda pair: int(pair[1].sum()))[0]
    x, y, z = (float(v) for v in point)
    return Edge(
        (x, y, z),
        float(values.mean()),
        max(float(sigma), LEAST_PX * unit),
        leading.number,
        free and float(hidden.mean()) < HIDDEN_SHARE,
    )
