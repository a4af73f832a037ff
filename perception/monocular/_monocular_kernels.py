"""Compiled loops of the monocular cycle: colour test, edge pixels and their groups, components."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..primitives.compiled import njit

RUN = 64
"""Pixels that are looked at together; few of these runs have an edge."""


class Limits(NamedTuple):
    """Limits of value and saturation, 0 to 255, and the chroma below which a pixel has no hue."""

    value_low: np.int32
    value_high: np.int32
    saturation_low: np.int32
    saturation_high: np.int32
    least_chroma: np.int32


class Normal(NamedTuple):
    """Integer normal of a half plane of colours."""

    red: np.int32
    green: np.int32
    blue: np.int32


@njit(cache=True, nogil=True)
def mark_range(
    rgb: np.ndarray,
    limits: Limits,
    low: Normal,
    high: Normal,
    out: np.ndarray,
) -> None:
    """Set out to 255 where a pixel lies in the range; `low` and `high` bound the hue by two half planes.

    The colours of a row are parted first; then neither division nor branch, so that the loop vectorises.
    """
    height, width = out.shape
    rs, gs, bs = np.empty(width, np.uint8), np.empty(width, np.uint8), np.empty(width, np.uint8)
    v0, v1, s0, s1, least = limits
    a0, a1, a2 = low
    b0, b1, b2 = high
    for y in range(height):
        colours, line = rgb[y], out[y]
        for x in range(width):
            rs[x], gs[x], bs[x] = colours[x, 0], colours[x, 1], colours[x, 2]
        for x in range(width):
            r, g, b = np.int32(rs[x]), np.int32(gs[x]), np.int32(bs[x])
            value = max(r, max(g, b))
            chroma = np.int32(value - min(r, min(g, b)))
            scaled = np.int32(np.int32(255) * chroma)
            inside = (
                (value >= v0)
                & (value <= v1)
                & (scaled >= np.int32(s0 * value))
                & (scaled <= np.int32(s1 * value))
            )
            first = np.int32(np.int32(a0 * r) + np.int32(a1 * g)) + np.int32(a2 * b)
            second = np.int32(np.int32(b0 * r) + np.int32(b1 * g)) + np.int32(b2 * b)
            coloured = (np.int32(first) >= 0) & (np.int32(second) >= 0)
            line[x] |= np.uint8(255) * np.uint8(inside & (coloured | (chroma < least)))


@njit(cache=True, nogil=True)
def mark_edges(ground: np.ndarray, edges: np.ndarray, columns: np.ndarray, rows: np.ndarray) -> int:
    """Mark and list, row by row, the pixels that are not ground above a ground pixel; return their count."""
    height, width = ground.shape
    count = 0
    for y in range(height - 1):
        above, below, line = ground[y], ground[y + 1], edges[y]
        for x in range(width):
            line[x] = below[x] & ~above[x]
    for y in range(height - 1):
        for first in range(0, width, RUN):
            line = edges[y, first : first + RUN]
            some = np.uint8(0)
            for x in range(line.size):
                some |= line[x]
            if some == 0:
                continue
            for x in range(line.size):
                if line[x] != 0:
                    if count < len(rows):
                        columns[count] = first + x
                        rows[count] = y
                    count += 1
    return count


@njit(cache=True, nogil=True)
def _root(parent: np.ndarray, i: int) -> int:
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@njit(cache=True, nogil=True)
def group_edges(
    columns: np.ndarray,
    rows: np.ndarray,
    width: int,
    reach: int,
    parent: np.ndarray,
    start: np.ndarray,
    order: np.ndarray,
) -> None:
    """Group edge pixels that are at most `reach` apart in both directions.

    Args:
        columns, rows: Pixels, row by row.
        width: Of the image.
        reach: In px.
        parent: (n,) output: first pixel of each one's group.
        start, order: (width + 1,), (n,) output: pixels sorted by column, rows ascending.
    """
    n = len(columns)
    start[:] = 0
    for i in range(n):
        start[columns[i] + 1] += 1
    for x in range(width):
        start[x + 1] += start[x]
    fill = start[:-1].copy()
    for i in range(n):
        parent[i] = i
        order[fill[columns[i]]] = i
        fill[columns[i]] += 1
    for x in range(width):
        for other in range(x, min(x + reach + 1, width)):
            j = start[other]
            for k in range(start[x], start[x + 1]):
                i = order[k]
                while j < start[other + 1] and rows[order[j]] < rows[i] - reach:
                    j += 1
                m = j
                while m < start[other + 1] and rows[order[m]] <= rows[i] + reach:
                    a, b = _root(parent, i), _root(parent, order[m])
                    if a < b:
                        parent[b] = a
                    elif b < a:
                        parent[a] = b
                    m += 1
    for i in range(n):
        parent[i] = _root(parent, i)


@njit(cache=True, nogil=True)
def group_below(
    u: np.ndarray,
    v: np.ndarray,
    start: np.ndarray,
    order: np.ndarray,
    rows: np.ndarray,
    labels: np.ndarray,
    farthest: float,
    out: np.ndarray,
) -> None:
    """Label of the nearest edge at or below each pixel in its own column, within `farthest` px; -1 for none."""
    width = len(start) - 1
    for i in range(len(u)):
        out[i] = -1
        x = int(np.floor(u[i] + 0.5))
        if x < 0 or x >= width:
            continue
        for k in range(start[x], start[x + 1]):
            gap = rows[order[k]] - v[i]
            if gap >= -1.0:
                if gap <= farthest:
                    out[i] = labels[order[k]]
                break


@njit(cache=True)
def measure(labels: np.ndarray, boxes: np.ndarray, centroids: np.ndarray) -> None:
    """Bounding box, area and centroid of every component, in one pass over the labels.

    Args:
        labels: (h, w) from 0 on.
        boxes: (n, 5) output: left, top, width, height, area, as in OpenCV.
        centroids: (n, 2) output: mean column and row.
    """
    rows, columns = labels.shape
    boxes[:, 0], boxes[:, 1] = columns, rows
    boxes[:, 2:] = 0
    sums = np.zeros((len(boxes), 2), np.int64)
    for v in range(rows):
        u = 0
        while u < columns:  # one run of equal labels at a time
            label = labels[v, u]
            begin = u
            while u < columns and labels[v, u] == label:
                u += 1
            many = u - begin
            boxes[label, 0] = min(boxes[label, 0], begin)
            boxes[label, 1] = min(boxes[label, 1], v)
            boxes[label, 2] = max(boxes[label, 2], u)
            boxes[label, 3] = max(boxes[label, 3], v + 1)
            boxes[label, 4] += many
            sums[label, 0] += many * (begin + u - 1) // 2
            sums[label, 1] += many * v
    for k in range(len(boxes)):
        boxes[k, 2] -= boxes[k, 0]
        boxes[k, 3] -= boxes[k, 1]
        if boxes[k, 4] > 0:
            centroids[k, 0] = sums[k, 0] / boxes[k, 4]
            centroids[k, 1] = sums[k, 1] / boxes[k, 4]
