"""Compiled loops of the monocular cycle: the colour test, edge pixels, their groups, and whose corner it is."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def mark_range(
    red: np.ndarray,
    green: np.ndarray,
    blue: np.ndarray,
    limits: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    out: np.ndarray,
) -> None:
    """Set out to 255 where a pixel lies in the range; hue by two half planes, no division, no branch.

    `limits`: value low, high; saturation low, high (0-255); chroma below which a pixel has no hue.
    `low`, `high`: integer normals (r, g, b) of the half planes. All of them int32.
    """
    height, width = out.shape
    v0, v1, s0, s1, least = limits[0], limits[1], limits[2], limits[3], limits[4]
    a0, a1, a2 = low[0], low[1], low[2]
    b0, b1, b2 = high[0], high[1], high[2]
    for y in range(height):
        rs, gs, bs, line = red[y], green[y], blue[y], out[y]
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
    """Pixels that are no ground with ground below them: marked in edges, listed row by row; their count."""
    height, width = ground.shape
    count = 0
    for y in range(height - 1):
        above, below, line = ground[y], ground[y + 1], edges[y]
        for x in range(width):
            line[x] = below[x] & ~above[x]
    for y in range(height - 1):
        line = edges[y]
        for x in range(width):
            if line[x] != 0:
                if count < len(rows):
                    columns[count] = x
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
    """Join edge pixels no farther apart than `reach` in both directions; parent becomes each one's root.

    `columns`, `rows` come row by row. `start` (width + 1) and `order` (n) become the pixels sorted by
    column, rows rising.
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
def owners(
    u: np.ndarray,
    v: np.ndarray,
    start: np.ndarray,
    order: np.ndarray,
    rows: np.ndarray,
    labels: np.ndarray,
    above: float,
    out: np.ndarray,
) -> None:
    """Label of the nearest edge at or below each corner in its own column, no more than `above` px off."""
    width = len(start) - 1
    for i in range(len(u)):
        out[i] = -1
        x = int(np.floor(u[i] + 0.5))
        if x < 0 or x >= width:
            continue
        for k in range(start[x], start[x + 1]):
            gap = rows[order[k]] - v[i]
            if gap >= -1.0:
                if gap <= above:
                    out[i] = labels[order[k]]
                break


@njit(cache=True)
def measure(labels: np.ndarray, boxes: np.ndarray, middles: np.ndarray) -> None:
    """Box, area and middle of every component, in one pass over its labels.

    Args:
        labels: (h, w) from 0 on.
        boxes: (n, 5) output: left, top, width, height, area, as OpenCV has them.
        middles: (n, 2) output: mean of columns and rows.
    """
    rows, columns = labels.shape
    boxes[:, 0], boxes[:, 1] = columns, rows
    boxes[:, 2:] = 0
    sums = np.zeros((len(boxes), 2), np.int64)
    for v in range(rows):
        u = 0
        while u < columns:  # run by run
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
            middles[k, 0] = sums[k, 0] / boxes[k, 4]
            middles[k, 1] = sums[k, 1] / boxes[k, 4]
