"""Outlines: which ground an object covers, from its faces and columns and from the cells seen free.

Three shapes are tried, the simplest first; the first that the map does not contradict is taken:

1. a rectangle, if the faces stand at right angles: the ground behind two faces of a box is the box;
2. the convex hull of what was seen;
3. the cells that were seen, closed over gaps.

What was never seen may lie inside a rectangle or hull, but no floor that was seen.

Source: ours.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull, QhullError

from .columns import CELL_M, Columns
from .faces import BAND_M, TAKEN_M, Face
from .free_cells import FreeCells, Ring
from .pixels import filled, without_free

SQUARE_DEG = 12.0  # ours: faces of a box are this close to right angles
DEEPEST_M = 2.2  # ours: a box deeper and wider than a double bed is not completed
FREE_SHARE = 0.04  # ours: of a shape; more contradicts it, less is cut off it
CLOSE_M = 0.04  # ours: gaps between seen cells that are closed
LEAST_ON_CIRCLE = 12  # ours: columns
LEAST_ARC = 12  # ours: sectors of 10 deg that must hold columns
WIDEST_M = 0.6  # ours: radius of the widest round thing
ROUGH_M = 0.025  # ours: columns about the circle through them, at most; and a quarter of its radius
CIRCLE_SIDES = 24  # ours: a polygon within 1 % of the radius
EXTREME = 0.02  # ours: share of columns beyond a side that no face shows


def rectangle(columns: Columns, faces: list[Face]) -> Ring | None:
    """The rectangle of an object whose faces stand at right angles; None if they do not.

    A side with a face lies there. Any other side lies at the farthest columns.
    """
    lengths = np.array([face.length_m for face in faces])
    angles = np.array([math.atan2(face.normal[1], face.normal[0]) for face in faces])
    turned = complex((lengths * np.exp(4j * angles)).sum())
    yaw = float(np.angle(turned)) / 4.0
    off = np.abs((angles - yaw + math.pi / 4) % (math.pi / 2) - math.pi / 4)
    if lengths[off > math.radians(SQUARE_DEG)].sum() > 0.15 * lengths.sum():
        return None
    axes = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    local = on_faces(columns, faces) @ axes
    edges = np.zeros(4)  # -x, +x, -y, +y
    for side in range(4):
        outward = (1.0 if side % 2 else -1.0) * axes[:, side // 2]
        own = [f for f in faces if f.normal @ outward > math.cos(math.radians(2 * SQUARE_DEG))]
        if own:
            middles = [float(f.ends.mean(axis=0) @ outward) for f in own]
            reach = _weighted_median(np.array(middles), np.array([f.length_m for f in own]))
        else:
            values = local[:, side // 2] * (1.0 if side % 2 else -1.0)
            reach = float(np.quantile(values, 1.0 - EXTREME)) if len(values) > 20 else values.max()
            reach = max(reach, *(float((face.ends @ outward).max()) for face in faces))
        edges[side] = reach if side % 2 else -reach
    for axis in (0, 1):  # a lone face has the thickness of a column
        if edges[2 * axis + 1] - edges[2 * axis] < CELL_M:
            seen = [f.normal @ axes[:, axis] for f in faces]
            front = max(seen, key=abs)
            if front > 0.5:
                edges[2 * axis] = edges[2 * axis + 1] - CELL_M
            elif front < -0.5:
                edges[2 * axis + 1] = edges[2 * axis] + CELL_M
            else:
                edges[2 * axis : 2 * axis + 2] = edges[2 * axis : 2 * axis + 2].mean() + np.array(
                    [-CELL_M / 2, CELL_M / 2]
                )
    x0, x1, y0, y1 = edges
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]) @ axes.T


def circle(columns: Columns) -> tuple[Ring, float] | None:
    """The circle through the upright columns, as a polygon, and their RMS about it, m; None if they are not on one.

    Source: algebraic fit after Kasa 1976, refined by Gauss-Newton.
    """
    chosen = columns.upright
    places, weights = columns.xy[chosen], np.sqrt(columns.count[chosen])
    if len(places) < LEAST_ON_CIRCLE:
        return None
    middle = places.mean(axis=0)
    x, y = (places - middle).T
    rows = np.column_stack([x, y, np.ones(len(x))]) * weights[:, None]
    a, b, c = np.linalg.lstsq(rows, weights * (x**2 + y**2), rcond=None)[0]
    centre, radius = np.array([a, b]) / 2.0, math.sqrt(max(c + (a**2 + b**2) / 4.0, 1e-6))
    for _ in range(10):
        away = np.column_stack([x, y]) - centre
        distance = np.maximum(np.linalg.norm(away, axis=1), 1e-6)
        off = distance - radius
        robust = weights / np.maximum(np.abs(off), 0.005)
        rows = np.column_stack([away / distance[:, None], np.ones(len(x))])
        step = np.linalg.lstsq(rows * np.sqrt(robust)[:, None], off * np.sqrt(robust), rcond=None)[
            0
        ]
        centre, radius = centre + step[:2], radius + float(step[2])
    if not CELL_M < radius < WIDEST_M:
        return None
    away = np.column_stack([x, y]) - centre
    sector = np.floor(np.degrees(np.arctan2(away[:, 1], away[:, 0])) / 10.0)
    if np.unique(sector).size < LEAST_ARC:
        return None
    angle = 2.0 * math.pi * np.arange(CIRCLE_SIDES) / CIRCLE_SIDES
    ring = middle + centre + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    rough = 1.48 * float(np.median(np.abs(np.linalg.norm(away, axis=1) - radius)))
    return (ring, rough) if rough <= max(0.5 * CELL_M, min(ROUGH_M, 0.25 * radius)) else None


def misfit(ring: Ring, columns: Columns) -> float:
    """Median distance of the upright columns from an outline, as a standard deviation, m."""
    places = columns.xy[columns.upright]
    if not len(places):
        return math.inf
    nearest = np.full(len(places), np.inf)
    for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True):
        step = b - a
        share = np.clip((places - a) @ step / max(float(step @ step), 1e-12), 0.0, 1.0)
        nearest = np.minimum(nearest, np.linalg.norm(places - a - share[:, None] * step, axis=1))
    return float(1.48 * np.median(nearest))


def on_faces(columns: Columns, faces: list[Face]) -> Float[np.ndarray, "k 2"]:
    """Places of the columns; those that stick out of a face by its smear are moved onto it."""
    places = columns.xy.copy()
    for face in faces:
        off = places @ face.normal - face.offset_m
        along = places @ face.tangent
        near = (np.abs(off) <= TAKEN_M) & (along >= face.span[0] - BAND_M)
        near &= along <= face.span[1] + BAND_M
        places[near] -= off[near, None] * face.normal
    return places


def hull(places: Float[np.ndarray, "k 2"]) -> Ring | None:
    """Convex hull, counter-clockwise; None if the places lie on a line."""
    try:
        found = ConvexHull(places)
    except (QhullError, ValueError):
        return None
    return np.asarray(places[found.vertices])


def share_free(ring: Ring, free: FreeCells) -> float:
    """Share of the area of an outline that lies over free floor, its outermost cell's width not counted.

    Floor counts from two by two cells: a single ray of noise can free a single cell.
    """
    mask, first = filled(ring, free)
    width = 2 * round(free.cell_m / free.pixel_m) + 1
    inner = cv2.erode(mask, np.ones((width, width), np.uint8), borderValue=0)
    row, column = np.nonzero(inner)
    over = free.floor.at((np.stack([column, row], axis=1) + 0.5) * free.pixel_m + first)
    return float(over.sum()) / max(int(mask.sum()), 1)


def region(places: Float[np.ndarray, "k 2"], faces: list[Face], free: FreeCells) -> list[Ring]:
    """Outlines of the cells that were seen, closed over gaps, without free cells."""
    low = places.min(axis=0) - 2 * CLOSE_M
    first, pixel = free.corner(low), free.pixel_m
    size = np.ceil((places.max(axis=0) + 2 * CLOSE_M - first) / pixel).astype(int)
    mask = np.zeros((int(size[1]), int(size[0])), np.uint8)
    for column, row in np.floor((places - first) / pixel).astype(int):
        mask[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2] = 1
    for face in faces:
        a, b = np.floor((face.ends - first) / pixel).astype(int).tolist()
        cv2.line(mask, a, b, 1, 2)
    reach = round(CLOSE_M / pixel)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    closed = np.asarray(cv2.morphologyEx(mask, cv2.MORPH_CLOSE, disc), np.uint8)
    return without_free(closed, first, free)


def _weighted_median(values: Float[np.ndarray, "n"], weights: Float[np.ndarray, "n"]) -> float:
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order][int(np.searchsorted(total, 0.5 * total[-1]))])


def believable(ring: Ring, columns: Columns, faces: list[Face], free: FreeCells) -> bool:
    """Whether an object may fill a rectangle: not too large, little floor seen in it, and seen from its outer side.

    Without the place of the sensor, two faces at a right angle are a box or a corner of a room; three are a box.
    """
    size = np.linalg.norm(ring[1:3] - ring[:2], axis=1)
    if size.min() > DEEPEST_M or share_free(ring, free) > FREE_SHARE:
        return False
    if np.isfinite(columns.sensor).all() or size.min() <= 2 * CELL_M:
        return True
    turn = math.atan2(*(ring[1] - ring[0])[::-1]) / (math.pi / 2)
    shown = {round(math.atan2(f.normal[1], f.normal[0]) / (math.pi / 2) - turn) % 4 for f in faces}
    return len(shown) >= 3


def cut(ring: Ring, free: FreeCells, least_m: float) -> list[Ring]:
    """A convex outline without the free cells: sides are moved by up to `least_m`; what is more is cut out."""
    moved = ring
    for _ in range(4 * len(ring)):
        over = free.overlaps(moved)
        if not over:
            return [moved]
        shifted = _moved_in(moved, over[0], least_m)
        if shifted is None:
            break
        moved = shifted
    mask, first = filled(ring, free)
    return without_free(mask, first, free)


def _moved_in(ring: Ring, part: Ring, least_m: float) -> Ring | None:
    """A convex outline with the side moved that a part of it lies nearest to, until the part is outside."""
    best, chosen = least_m, -1
    count = len(ring)
    for k in range(count):
        step = ring[(k + 1) % count] - ring[k]
        inward = np.array([-step[1], step[0]]) / max(float(np.linalg.norm(step)), 1e-12)
        depth = float(((part - ring[k]) @ inward).max())
        if depth < best:
            best, chosen = depth, k
    if chosen < 0:
        return None
    step = ring[(chosen + 1) % count] - ring[chosen]
    inward = np.array([-step[1], step[0]]) / float(np.linalg.norm(step))
    inside_by = (ring - ring[chosen]) @ inward - best - 1e-6
    kept = []
    for k in range(count):
        after = (k + 1) % count
        if inside_by[k] >= 0.0:
            kept.append(ring[k])
        if inside_by[k] * inside_by[after] < 0.0:
            share = inside_by[k] / (inside_by[k] - inside_by[after])
            kept.append(ring[k] + share * (ring[after] - ring[k]))
    return np.array(kept) if len(kept) >= 3 else None
