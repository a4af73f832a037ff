"""Straight edges of regions, from the pixels at which they end.

Along every column and row of the image a region ends between two pixels. Beyond is a region that it meets (convex or
concave), something farther away (the region really ends there), or something nearer (it is hidden, which is no edge). A line
through such ends is an edge. Its standard deviation has the width of a pixel on the plane: a line that crosses many rows is
known to a fraction of it, one along a row only to the row.

Source: ours.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from ..primitives.frame import Depth
from . import _border_kernels, _edge_kernels
from .region import Edge, EdgeKind, Region

MEET_SIGMAS = 3.0  # ours
LEAST_PART = 0.02  # ours: of the image width or height, that an edge crosses
MOST_LINES = 512  # ours: of an image
FOLD_PX, END_PX, PATTERN_END_PX, MATCHED_PX = 0.2, 0.1, 1.0, 1.4
"""Ours: by how much a border is off because its pixels see both sides, by standard deviation once for all edges of a view
and once for each. At a fold, the brighter surface decides; where a surface ends, time of flight drops the pixels between,
which leaves less. A camera that matches a projected pattern errs by a pixel or two either way: a Kinect shows the top of a
cabinet 11 mm, 1.8 pixels, too small (TUM fr3 cabinet, 15 pairs of edges, true to 2 cm). Block matching of 9 pixels widens
what is nearer, by how much depends on the texture, at each end of an edge."""
LEAST_FOLD = 1e-3  # against division by zero
MOST_DOUBT_M = 0.2  # ours: planes so nearly parallel do not meet at the edge
FOLD_M = 0.003  # ours: roughness of floors, by which two planes that meet may be off


def straight_edges(
    regions: list[Region],
    labels: Int[np.ndarray, "h w"],
    q: Float[np.ndarray, "h w"],
    weight: Float[np.ndarray, "h w"],
    depth: Depth,
    sensor: str | None,
) -> list[Region]:
    """The regions with their edges.

    Args:
        regions: In the order of their labels.
        labels: Region of every pixel, -1 if none.
        q, weight: Inverse depth, 1/m, and one over its variance; 0 where there is no depth.
        depth: The image.
        sensor: As for `segmentation.find`.
    """
    if not regions:
        return []
    x, y = depth.camera.slopes
    height, width = labels.shape
    matched = depth.baseline_m > 0.0
    end_px = END_PX if sensor == "tof" else PATTERN_END_PX
    planes = np.array([[*one.plane.normal, one.plane.offset_m] for one in regions])
    slopes = -planes[:, :3] / planes[:, 3:]
    rows = np.empty((64 * (height + width), _border_kernels.FIELDS), np.int64)
    rows = rows[: _border_kernels.borders(labels, q, weight, x, y, slopes, MEET_SIGMAS, rows)]
    rows = rows[rows[:, 2] != _border_kernels.HIDDEN]
    if not len(rows):
        return regions
    group = (rows[:, 0] * 4 + rows[:, 1]) * 4 + rows[:, 2]
    order = np.argsort(group, kind="stable")
    ends = np.flatnonzero(np.diff(group[order], append=-1)) + 1
    found = np.empty((MOST_LINES, _edge_kernels.LINE))
    count = _edge_kernels.lines_of(
        rows[order],
        ends,
        q,
        weight,
        x,
        y,
        planes,
        np.array([one.middle for one in regions]),
        np.array([one.plane.tangents for one in regions]),
        np.array([LEAST_PART * width, LEAST_PART * height]),
        found,
    )
    lines = found[:count]
    kinds, doubts = _folds(lines, regions, planes)
    edges: list[list[Edge]] = [[] for _ in regions]
    for line, kind, doubt in zip(lines, kinds, doubts, strict=True):
        ends = line[:6].reshape(2, 3).copy()
        off_px = MATCHED_PX if matched else end_px if kind == EdgeKind.OCCLUDING else FOLD_PX
        off = off_px * float(line[9])
        turn = 2.0 * off**2 / float(np.sum((ends[1] - ends[0]) ** 2)) if matched else 0.0
        P = np.array([[line[6] + doubt[0] + turn, line[8]], [line[8], line[7] + doubt[1] + off**2]])
        edge = Edge(EdgeKind(int(kind)), ends, P, off, int(line[12]))
        edges[int(line[10])].append(edge)
    return [replace(one, edges=tuple(mine)) for one, mine in zip(regions, edges, strict=True)]


def _folds(
    lines: Float[np.ndarray, "n f"], regions: list[Region], planes: Float[np.ndarray, "m 4"]
) -> tuple[Int[np.ndarray, "n"], Float[np.ndarray, "n 2"]]:
    """Kinds of edges, by the planes where two planes meet, and the uncertainty of where they meet.

    It is large at a shallow fold, as at the foot of a ramp: between the places where a pixel is within
    `MEET_SIGMAS` of both planes, the border may be anywhere.

    Args:
        lines: From `lines_of`.
        regions, planes: All, and the normal and offset of each.

    Returns:
        Kinds, and variances to add to those of angle and offset.
    """
    region, kinds, other = (
        lines[:, 10].astype(int),
        lines[:, 11].astype(int),
        lines[:, 12].astype(int),
    )
    ends = lines[:, :6].reshape(-1, 2, 3)
    middle, way = ends.mean(axis=1), ends[:, 1] - ends[:, 0]
    one, two = planes[region], planes[other]
    normal, beyond = one[:, :3], two[:, :3]
    width = MEET_SIGMAS * lines[:, 13] * np.abs(np.sum(normal * middle, axis=1)) / middle[:, 2]
    apart = np.abs(np.sum(beyond * middle, axis=1) + two[:, 3])
    tangents = np.array([one.plane.tangents for one in regions])
    own = np.array([one.own for one in regions])
    variance = width**2 / 3.0 + FOLD_M**2
    for index in (region, other):
        at = np.ones((len(lines), 3))
        at[:, :2] = np.einsum("nij,nj->ni", tangents[index], middle)
        variance = variance + np.einsum("ni,nij,nj->n", at, own[index], at)
    cosine = np.sum(normal * beyond, axis=1)
    sine = np.linalg.norm(np.cross(normal, beyond), axis=1)
    across = variance / np.maximum(sine / np.maximum(np.abs(cosine), 1e-9), LEAST_FOLD) ** 2
    meet = (other >= 0) & (apart <= 2.0 * width + FOLD_M) & (across < MOST_DOUBT_M**2)
    outward = np.cross(normal, way)
    centres = np.array([one.middle for one in regions])[region]
    outward *= np.sign(np.sum(outward * (middle - centres), axis=1))[:, None]
    rises = np.sum(beyond * outward, axis=1) < 0.0
    kinds = np.where(meet, np.where(rises, EdgeKind.CONCAVE, EdgeKind.CONVEX), kinds)
    angle = across / np.maximum(np.sum(way * way, axis=1) / 4.0, 1e-9)
    return kinds, np.where(meet[:, None], np.column_stack([angle, across]), 0.0)
