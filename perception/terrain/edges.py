"""Straight edges of regions, from the pixels at which they end.

Along every column and row of the image a region ends between two pixels. Beyond is a region that it meets (convex or
concave), something farther away (the region really ends there), or something nearer (it is hidden, which is no edge). A line
through such ends is an edge. Its standard deviation has the width of a pixel on the plane: a line that crosses many rows is
known to a fraction of it, one along a row only to the row.

Source: ours.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Int

from ..primitives.frame import Depth
from . import _edge_kernels as kernels
from .region import Edge, EdgeKind, Region

MEET_SIGMAS = 3.0  # ours
LEAST_SAMPLES, MOST_SAMPLES = 10, 120  # ours: pixels of an edge; more are thinned
LEAST_PART = 0.02  # ours: of the image width or height, that an edge crosses
MOST_EDGES = 2  # ours: of one kind on one side of a region
TRIALS = 12  # ours: lines through two samples that are tried
INLIER_PX = 1.5  # ours: a sample within this many pixels' width of a line is on it
BESIDE_PX = 5.0  # ours: a sample within this many is on no other line
LEAST_SHARE = 0.2  # ours: of the samples of a side that an edge explains
SHARED_PX, MATCHED_PX = (
    0.2,
    2.0,
)  # ours: outward shift of all borders of labels; after block matching of 9 px
PARTS = 8  # ours: of an edge, whose scatter tells its covariance
LEAST_FOLD = 1e-3  # slope of planes that do not meet
FOLD_M = 0.003  # ours: roughness of floors, by which two planes that meet may be off


def straight_edges(
    regions: list[Region],
    labels: Int[np.ndarray, "h w"],
    q: Float[np.ndarray, "h w"],
    weight: Float[np.ndarray, "h w"],
    depth: Depth,
) -> list[Region]:
    """The regions with their edges.

    Args:
        regions: In the order of their labels.
        labels: Region of every pixel, -1 if none.
        q, weight: Inverse depth, 1/m, and one over its variance; 0 where there is no depth.
        depth: The image.
    """
    if not regions:
        return []
    x, y = depth.camera.slopes
    shift_px = MATCHED_PX if depth.baseline_m > 0.0 else SHARED_PX
    slopes = np.stack([-one.plane.normal / one.plane.offset_m for one in regions])
    rows = np.empty((4 * labels.shape[0] * 16 + 4 * labels.shape[1] * 16, kernels.FIELDS), np.int64)
    count = kernels.borders(labels, q, weight, x, y, slopes, MEET_SIGMAS, rows)
    rows = rows[:count]
    rows = rows[rows[:, 2] != kernels.HIDDEN]
    v, u = np.divmod(rows[:, 4], depth.camera.width)
    dv = np.array([-1, 1, 0, 0])[rows[:, 1]] * rows[:, 5]
    du = np.array([0, 0, -1, 1])[rows[:, 1]] * rows[:, 5]
    inner, outer = (
        np.column_stack(
            [
                x[n if x.shape[0] > 1 else 0, m],
                y[n, m if y.shape[1] > 1 else 0],
                np.ones(len(rows)),
            ]
        )
        for n, m in ((v, u), (v + dv, u + du))
    )
    found = []
    for index, one in enumerate(regions):
        edges: list[Edge] = []
        mine = rows[:, 0] == index
        for side, kind in itertools.product(range(4), EdgeKind):
            chosen = np.flatnonzero(mine & (rows[:, 1] == side) & (rows[:, 2] == kind))
            by_columns = side in (kernels.UP, kernels.DOWN)
            if len(chosen) < LEAST_PART * depth.z.shape[1 if by_columns else 0]:
                continue
            chosen = chosen[:: -(-len(chosen) // MOST_SAMPLES)]
            crossed = (v if by_columns else u)[chosen]
            others = rows[chosen, 3]
            at = v[chosen], u[chosen]
            noise = float(np.median(weight[at] ** -0.5 / q[at] ** 2))
            edges += [
                _folded(edge, one, regions, noise)
                for edge in _lines(
                    one, inner[chosen], outer[chosen], crossed, others, kind, by_columns, shift_px
                )
            ]
        found.append(replace(one, edges=tuple(edges)))
    return found


def _folded(edge: Edge, region: Region, regions: list[Region], noise_m: float) -> Edge:
    """An edge where two planes meet with its kind by the planes, and with the doubt of where they meet.

    The doubt is large at a shallow fold, as at the foot of a ramp: between the places where a pixel is within
    `MEET_SIGMAS` of both planes, the border may be anywhere.

    Args:
        edge: Of the region.
        region, regions: The region, and all.
        noise_m: Standard deviation of depth there.
    """
    if edge.other < 0:
        return edge
    plane, other, middle = region.plane, regions[edge.other].plane, edge.middle
    width = MEET_SIGMAS * noise_m * abs(float(plane.normal @ middle)) / middle[2]
    if abs(float(other.distance(middle))) > 2.0 * width + FOLD_M:
        return edge
    variance = width**2 / 3.0 + FOLD_M**2
    for one in (region, regions[edge.other]):
        at = np.array([*(one.plane.tangents @ middle), 1.0])
        variance += float(at @ one.own @ at)
    across = variance / max(math.tan(plane.angle_to(other)), LEAST_FOLD) ** 2
    doubt = np.diag([across / (edge.length_m / 2.0) ** 2, across])
    outward = np.cross(plane.normal, edge.along)
    outward *= math.copysign(1.0, float(outward @ (middle - region.middle)))
    kind = EdgeKind.CONCAVE if float(other.normal @ outward) < 0.0 else EdgeKind.CONVEX
    return replace(edge, kind=kind, covariance=edge.covariance + doubt)


def _lines(
    region: Region,
    inner: Float[np.ndarray, "n 3"],
    outer: Float[np.ndarray, "n 3"],
    crossed: Int[np.ndarray, "n"],
    others: Int[np.ndarray, "n"],
    kind: EdgeKind,
    by_columns: bool,
    shift_px: float,
) -> list[Edge]:
    """Lines through the ends of a region on one side, the longest first.

    Args:
        region: Whose ends they are.
        inner, outer: Rays of the last pixel of the region and of the first one beyond.
        crossed: Row of each end if its columns were searched, else its column.
        others: Region beyond, or -1.
        kind: Of all of them.
        by_columns: Whether columns were searched.
        shift_px: Standard deviation of the shift that all edges share.
    """
    total = len(inner)
    if total < LEAST_SAMPLES:
        return []
    n, rho = region.plane.normal, region.plane.offset_m
    tangents = region.plane.tangents
    first = _on_plane(inner, n, rho)
    middle = _on_plane((inner + outer) / 2.0, n, rho)
    good = np.isfinite(first).all(axis=1) & np.isfinite(middle).all(axis=1)
    steps = (middle - first)[good] @ tangents.T * 2.0  # a pixel's width on the plane
    at, crossed, others = (middle[good] - region.middle) @ tangents.T, crossed[good], others[good]
    found: list[Edge] = []
    while len(at) >= max(LEAST_SAMPLES, LEAST_SHARE * total) and len(found) < MOST_EDGES:
        on, beside = _largest_line(at, steps)
        if np.count_nonzero(on) < max(LEAST_SAMPLES, LEAST_SHARE * total):
            break
        edge = _edge(region, at[on], steps[on], crossed[on], others[on], kind, shift_px)
        (u0, v0), (u1, v1) = edge.ends[:, :2] / edge.ends[:, 2:]
        if (abs(u1 - u0) >= abs(v1 - v0)) == by_columns:  # else rows cross it at a larger angle
            found.append(edge)
        at, steps, crossed, others = at[~beside], steps[~beside], crossed[~beside], others[~beside]
    return found


def _on_plane(
    rays: Float[np.ndarray, "n 3"], normal: Float[np.ndarray, "3"], rho: float
) -> Float[np.ndarray, "n 3"]:
    """Where rays meet a plane, NaN where they do not."""
    slope = rays @ normal
    with np.errstate(divide="ignore"):
        return np.asarray(rays * np.where(slope < -1e-6, -rho / slope, np.nan)[:, None])


def _largest_line(
    at: Float[np.ndarray, "n 2"], steps: Float[np.ndarray, "n 2"]
) -> tuple[Bool[np.ndarray, "n"], Bool[np.ndarray, "n"]]:
    """Which samples lie on the line that has most of them, and which on it or beside."""
    count = len(at)
    a = np.linspace(0, count - 1, TRIALS).astype(int)
    b = (a + count // 2) % count
    c = (a + count // 5) % count
    one, two = np.concatenate([a, a]), np.concatenate([b, c])
    way = at[two] - at[one]
    length = np.linalg.norm(way, axis=1)
    kept = length > 1e-6
    if not kept.any():
        return np.zeros(count, np.bool_), np.ones(count, np.bool_)
    normal = np.stack([-way[kept, 1], way[kept, 0]]) / length[kept]
    away = np.abs(at @ normal - np.sum(at[one[kept]].T * normal, axis=0))
    width = np.maximum(np.abs(steps @ normal), 1e-4)
    near = away < INLIER_PX * width
    best = int(np.argmax(near.sum(axis=0)))
    return near[:, best], away[:, best] < BESIDE_PX * width[:, best]


def _across(off: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "2"]:
    """Unit vector of the least scatter of points about the origin."""
    (a, b), (_, c) = off.T @ off
    turn = 0.5 * math.atan2(2.0 * b, a - c)
    return np.array([-math.sin(turn), math.cos(turn)])


def _edge(
    region: Region,
    at: Float[np.ndarray, "n 2"],
    steps: Float[np.ndarray, "n 2"],
    crossed: Int[np.ndarray, "n"],
    others: Int[np.ndarray, "n"],
    kind: EdgeKind,
    shift_px: float,
) -> Edge:
    """The line through samples, with its covariance."""
    normal = _across(at - at.mean(axis=0))
    for _ in range(2):  # weights by the width of a pixel across the line
        width = np.maximum(np.abs(steps @ normal), 1e-4)
        w = 1.0 / width**2
        centre = w @ at / w.sum()
        off = at - centre
        normal = _across(off * (1.0 / width)[:, None])
    along = np.array([normal[1], -normal[0]])
    run = off @ along
    unit = 1.0 / math.sqrt(w.mean())
    parts = np.array_split(np.argsort(run), min(PARTS, len(run) // 4))
    away = off @ normal
    offsets, places = (
        np.array([w[part] @ one[part] / w[part].sum() for part in parts]) for one in (away, run)
    )
    rows = len(np.unique(crossed))
    scatter = max(float(offsets @ offsets) / max(len(parts) - 2, 1), unit**2 / 12.0 / rows**2)
    at_centre, angle = scatter / len(parts), scatter / max(float(places @ places), 1e-9)
    low, high = run.min(), run.max()
    shift = (low + high) / 2.0
    P = np.array([[angle, shift * angle], [shift * angle, at_centre + shift**2 * angle]])
    ends = region.middle + (centre + np.outer([low, high], along)) @ region.plane.tangents
    known = others[others >= 0]
    other = int(np.bincount(known).argmax()) if len(known) else -1
    return Edge(kind, ends, P, shift_px * unit, other)
