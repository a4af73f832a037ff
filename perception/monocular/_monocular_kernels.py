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
    red: np.ndarray,
    green: np.ndarray,
    blue: np.ndarray,
    limits: Limits,
    low: Normal,
    high: Normal,
    out: np.ndarray,
) -> None:
    """Set out to 255 where a pixel lies in the range; `low` and `high` bound the hue by two half planes.

    It takes an image for each colour and has neither division nor branch, so that the loop vectorises.
    """
    height, width = out.shape
    v0, v1, s0, s1, least = limits
    a0, a1, a2 = low
    b0, b1, b2 = high
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


@njit(cache=True, nogil=True)
def find_runs(mask: np.ndarray, first: np.ndarray, begin: np.ndarray, end: np.ndarray) -> None:
    """Runs of non-zero pixels of every row.

    Args:
        mask: (h, w).
        first: (h + 1,) output: the first run of each row, and their number.
        begin, end: Output: columns of each run, the last one not included.
    """
    rows, columns = mask.shape
    count = 0
    for v in range(rows):
        line = mask[v]
        first[v] = count
        inside = False
        for start in range(0, columns, RUN):
            part = line[start : start + RUN]
            every, some = np.uint8(255), np.uint8(0)
            for x in range(part.size):
                every &= part[x]
                some |= part[x]
            if (some == 0 and not inside) or (every != 0 and inside):
                continue
            for x in range(part.size):
                if (part[x] != 0) != inside:
                    if inside:
                        end[count] = start + x
                        count += 1
                    else:
                        begin[count] = start + x
                    inside = not inside
        if inside:
            end[count] = columns
            count += 1
    first[rows] = count


@njit(cache=True, nogil=True)
def join_runs(
    first: np.ndarray, begin: np.ndarray, end: np.ndarray, reach: int, number: np.ndarray
) -> int:
    """Number the components that the runs make, and return how many there are, with the background as number 0.

    Args:
        first, begin, end: As from `find_runs`.
        reach: 0 if pixels side by side are neighbours, 1 if those at the corners are, too.
        number: (n,) output: component of each run, in the order of OpenCV: by its first pixel, or by its first block of
            2x2 pixels if neighbours meet at corners.
    """
    n = first[-1]
    parent, key = np.empty(n, np.int64), np.empty(n, np.int64)
    for i in range(n):
        parent[i] = i
    for v in range(1, len(first) - 1):
        j = first[v - 1]
        for i in range(first[v], first[v + 1]):
            while j < first[v] and end[j] + reach <= begin[i]:
                j += 1
            k = j
            while k < first[v] and begin[k] < end[i] + reach:
                a, b = _root(parent, i), _root(parent, k)
                parent[max(a, b)] = min(a, b)
                k += 1
    roots = 0
    side = 1 + reach
    for v in range(len(first) - 1):
        for i in range(first[v], first[v + 1]):
            place = (v // side << 32) + begin[i] // side
            root = _root(parent, i)
            if root == i:
                key[i] = place
                roots += 1
            else:
                key[root] = min(key[root], place)
    own = np.empty(roots, np.int64)
    k = 0
    for i in range(n):
        if parent[i] == i:
            own[k] = i
            k += 1
    for rank, k in enumerate(np.argsort(key[own])):
        number[own[k]] = rank + 1
    for i in range(n):
        number[i] = number[_root(parent, i)]
    return roots + 1


@njit(cache=True, nogil=True)
def measure(
    first: np.ndarray,
    begin: np.ndarray,
    end: np.ndarray,
    number: np.ndarray,
    labels: np.ndarray,
    boxes: np.ndarray,
    centroids: np.ndarray,
) -> None:
    """Paint every component, and take its bounding box, area and centroid.

    Args:
        first, begin, end, number: As from `find_runs` and `join_runs`.
        labels: (h, w) output; 0 before.
        boxes: (n, 5) output: left, top, width, height, area, as in OpenCV.
        centroids: (n, 2) output: mean column and row; 0 before.
    """
    rows, columns = labels.shape
    boxes[:, 0], boxes[:, 1] = columns, rows
    boxes[:, 2:] = 0
    sums = np.zeros((len(boxes), 2), np.int64)
    for v in range(rows):
        free = 0  # where the background may go on
        for i in range(first[v], first[v + 1] + 1):
            last = i == first[v + 1]
            left = columns if last else begin[i]
            if left > free:
                _extend(boxes, sums, 0, v, free, left)
            if not last:
                free = end[i]
                labels[v, left:free] = number[i]
                _extend(boxes, sums, number[i], v, left, free)
    for k in range(len(boxes)):
        boxes[k, 2] -= boxes[k, 0]
        boxes[k, 3] -= boxes[k, 1]
        if boxes[k, 4] > 0:
            centroids[k, 0] = sums[k, 0] / boxes[k, 4]
            centroids[k, 1] = sums[k, 1] / boxes[k, 4]


@njit(cache=True, nogil=True)
def _extend(boxes: np.ndarray, sums: np.ndarray, label: int, v: int, begin: int, end: int) -> None:
    """Add a run to a component; width and height of its box still hold its right and lower border."""
    many = end - begin
    boxes[label, 0] = min(boxes[label, 0], begin)
    boxes[label, 1] = min(boxes[label, 1], v)
    boxes[label, 2] = max(boxes[label, 2], end)
    boxes[label, 3] = max(boxes[label, 3], v + 1)
    boxes[label, 4] += many
    sums[label, 0] += many * (begin + end - 1) // 2
    sums[label, 1] += many * v
