"""How far an obstacle may extend sideways behind what is seen of it.

A gap is bounded by the corner of an obstacle that protrudes furthest into it. On the side of the obstacle that is
turned towards straight ahead, that corner is always seen: what stands behind the front at the same azimuth lies
further aside. On the other side it may be hidden behind the front: anywhere along the line of sight of the seen
edge, from the seen edge to the greatest depth that the obstacle can have. A camera above the obstacle sees its top
face row by row, and the line of sight just above the last row passes the obstacle's height where its depth must
end. A higher obstacle is at most as deep as a piece of furniture.

Hidden depth is unknown between these bounds, and less is likelier than more: a density that falls linearly from the
seen edge to the farthest possible one, with the mean at a third of the way and the standard deviation of a triangle.

Source: ours, for the gaps of Kang 2013 (seed 004), eq. (20).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int32
from scipy.ndimage import median_filter

from perception.primitives.plane import Plane

from . import _kernels
from .obstacles import SEEN_M, PanoramaObstacle
from .rendering import Drawing

# all ours
HEIGHT_SIGMAS = 1.5  # error of the height of an obstacle
FACE_M = 0.015  # error of the height of a pixel of a top face, which is seen at a grazing angle
GRAZE_RAD = math.radians(3.0)  # flattest angle at which a time-of-flight camera sees a surface
SHOWN_M = 0.03  # pixels of an obstacle this far behind its front are its top face
DEEPEST_M = 0.8  # depth of a desk
FULL_SHARE = 0.5  # columns with fewer of the usual rows are mixed pixels beside an edge
SMOOTH_COLUMNS = 5  # 1.25 deg; single columns are displaced by drawing
TOUCH_RAD = math.radians(1.0)  # an obstacle this close beside an occluded edge occludes it
STEEPEST_RAD = math.radians(85.0)  # azimuths beyond have no lateral position
EDGE_COLUMNS = 3  # the outermost full columns, whose depth the edge has


@dataclass(frozen=True, eq=False)
class _Column:
    """Full columns of an obstacle: azimuth, and the horizontal ranges of the seen and of the greatest depth."""

    azimuth: Float[np.ndarray, "n"]
    seen: Float[np.ndarray, "n"]
    most: Float[np.ndarray, "n"]


def with_hidden_corners(
    obstacles: Sequence[PanoramaObstacle],
    drawing: Drawing,
    labels: Int32[np.ndarray, "h w"],
    floor: Plane,
) -> tuple[PanoramaObstacle, ...]:
    """The obstacles with `hidden_left_m` and `hidden_right_m`, and edges moved to corners seen over their tops.

    Args:
        obstacles: Of the panorama.
        drawing: The panorama.
        labels: Obstacle of each pixel.
        floor: Base frame.
    """
    sphere, centre = drawing.sphere, drawing.centre
    phi = sphere.top_rad - np.arange(sphere.height) / sphere.px_per_rad
    flat = drawing.range_m.astype(np.float64) * np.cos(phi)[:, None]
    height = floor.distance(centre + sphere.rays * drawing.range_m[..., None].astype(np.float64))
    drop = np.tan(-phi - 0.5 / sphere.px_per_rad)  # by which a pixel sees at least
    camera = float(floor.distance(centre[None])[0])
    found = []
    for one in obstacles:
        rows = (labels == one.label).sum(axis=0)
        full = np.flatnonzero(rows >= FULL_SHARE * max(float(np.median(rows[rows > 0])), 1.0))
        error_m = HEIGHT_SIGMAS * one.sigma_height_m
        limits = error_m, FACE_M, math.tan(GRAZE_RAD), SHOWN_M, DEEPEST_M
        seen, most = np.empty(full.size), np.empty(full.size)
        _kernels.depths_seen(
            flat, height, labels, full, one.label, drop, one.height_m, camera,
            1.0 / sphere.px_per_rad, limits, seen, most,
        )  # fmt: skip
        columns = _Column(-(sphere.left_rad + full / sphere.px_per_rad), seen, most)
        for left in (True, False):
            one = _on_side(one, columns, (float(centre[0]), float(centre[1])), left)
        found.append(one)
    return tuple(_behind_others(one, found) for one in found)


def _on_side(
    one: PanoramaObstacle, columns: _Column, centre: tuple[float, float], left: bool
) -> PanoramaObstacle:
    """One obstacle with the corner and the hidden width of one side."""
    sign = 1.0 if left else -1.0
    x, y = one.left_edge_m if left else one.right_edge_m
    edge = sign * math.atan2(y - centre[1], x - centre[0])
    azimuth = sign * columns.azimuth
    aside = np.flatnonzero(azimuth > 0.0)
    if edge <= 0.0 or aside.size == 0:
        return one
    azimuth = azimuth[aside]
    seen = median_filter(columns.seen[aside], SMOOTH_COLUMNS, mode="mirror")
    most = median_filter(columns.most[aside], SMOOTH_COLUMNS, mode="mirror")
    outermost = np.argsort(-azimuth)[:EDGE_COLUMNS]
    reach = max(
        float((most * np.sin(azimuth)).max()), math.sin(edge) * float(most[outermost].max())
    )
    at = int(np.argmax(seen * np.sin(azimuth)))
    corner = float(seen[at] * math.sin(azimuth[at])) + sign * centre[1]
    beyond = corner - sign * y
    width = one.width_m
    if beyond > SEEN_M:  # closer, the edge is finer than the columns
        x, y = centre[0] + float(seen[at]) * math.cos(azimuth[at]), sign * corner
        width += beyond
    hidden = max(reach + sign * centre[1] - sign * y, 0.0)
    if left:
        return replace(one, left_edge_m=(x, y), hidden_left_m=hidden, width_m=width)
    return replace(one, right_edge_m=(x, y), hidden_right_m=hidden, width_m=width)


def _behind_others(one: PanoramaObstacle, others: Sequence[PanoramaObstacle]) -> PanoramaObstacle:
    """An obstacle whose edge a nearer one occludes may extend to the far side of that one."""
    found = one
    for other in others:
        if other.distance_m >= one.distance_m:
            continue
        if one.cut_left and abs(other.right_rad - one.left_rad) <= TOUCH_RAD:
            y = one.left_edge_m[0] * math.tan(min(other.left_rad, STEEPEST_RAD))
            found = replace(found, hidden_left_m=max(found.hidden_left_m, y - one.left_edge_m[1]))
        if one.cut_right and abs(other.left_rad - one.right_rad) <= TOUCH_RAD:
            y = one.right_edge_m[0] * math.tan(max(other.right_rad, -STEEPEST_RAD))
            found = replace(
                found, hidden_right_m=max(found.hidden_right_m, one.right_edge_m[1] - y)
            )
    return found
