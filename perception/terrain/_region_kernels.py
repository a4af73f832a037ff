"""Compiled loops of the plane segmentation: cells, growth, and the label of every pixel.

Along the ray r = p / z a plane is 1 / z = a.r with a = -n / rho: inverse depth is linear over the image. The sums of a
weighted least-squares fit add up, so that a union of cells is fitted without its pixels.
"""

from __future__ import annotations

import math

import numpy as np

from ..floor._search_kernels import solve
from ..primitives.compiled import njit

SUMS = 11  # A (00, 01, 02, 11, 12, 22), g (3), sum of w q^2, number
AROUND = 1
"""Ours: a pixel that two regions explain takes the better one of its neighbourhood of 3 x 3."""
TRUNCATED = 9.0  # ours: of a squared residual in that neighbourhood
CANDIDATES = 9


@njit(cache=True, nogil=True)
def sum_cells(
    z: np.ndarray,
    sigma: np.ndarray,
    slope_x: np.ndarray,
    slope_y: np.ndarray,
    limits: tuple[float, float, float],
    size: tuple[int, int],
    q: np.ndarray,
    weight: np.ndarray,
    sums: np.ndarray,
) -> None:
    """Inverse depth with its weight, and the sums of every cell.

    Args:
        z, sigma: (h, w), depth and its standard deviation, m.
        slope_x, slope_y: Ray slopes as (1 or h, w) and (h, 1 or w) tables.
        limits: Nearest and farthest depth, roughness of a surface, m.
        size: Rows and columns of a cell.
        q, weight: (h, w) float32, written: 1 / z and 1 / its variance; 0 where there is no depth.
        sums: (rows, columns, SUMS), zeros, written.
    """
    height, width = z.shape
    nearest, farthest, rough = limits
    tall, wide = size
    rows, columns = sums.shape[0], sums.shape[1]
    rows_x, columns_y = slope_x.shape[0], slope_y.shape[1]
    for v in range(height):
        row = v if rows_x > 1 else 0
        i = v // tall
        for u in range(width):
            depth = float(z[v, u])
            s = float(sigma[v, u])
            q[v, u] = 0.0
            weight[v, u] = 0.0
            if not (nearest <= depth <= farthest and 0.0 < s < np.inf):
                continue
            one = 1.0 / depth
            w = depth**4 / (s * s + rough * rough)
            q[v, u] = one
            weight[v, u] = w
            j = u // wide
            if i >= rows or j >= columns:
                continue
            x = slope_x[row, u]
            y = slope_y[v, u if columns_y > 1 else 0]
            cell = sums[i, j]
            wx, wy = w * x, w * y
            cell[0] += wx * x
            cell[1] += wx * y
            cell[2] += wx
            cell[3] += wy * y
            cell[4] += wy
            cell[5] += w
            cell[6] += wx * one
            cell[7] += wy * one
            cell[8] += w * one
            cell[9] += w * one * one
            cell[10] += 1.0


@njit(cache=True, nogil=True)
def fit(sums: np.ndarray, A: np.ndarray, g: np.ndarray) -> tuple[float, float, float, float]:
    """Slope a of the plane of some sums, and its sum of weighted squared residuals; infinite where singular."""
    A[0, 0], A[0, 1], A[0, 2] = sums[0], sums[1], sums[2]
    A[1, 0], A[1, 1], A[1, 2] = sums[1], sums[3], sums[4]
    A[2, 0], A[2, 1], A[2, 2] = sums[2], sums[4], sums[5]
    g[0], g[1], g[2] = sums[6], sums[7], sums[8]
    a, b, c, good = solve(A, g)
    if not good:
        return 0.0, 0.0, 0.0, np.inf
    return a, b, c, max(sums[9] - a * g[0] - b * g[1] - c * g[2], 0.0)


@njit(cache=True, nogil=True)
def flatten(
    sums: np.ndarray,
    least: float,
    most: float,
    graze: float,
    common: float,
    sigmas: float,
    rest: np.ndarray,
) -> None:
    """Find the cells that a plane explains, and weaken them by an error that their pixels share.

    Two rows on either side of a jump of depth fit a plane, too, one that is nearly along the ray.

    Args:
        sums: (rows, columns, SUMS); those of a flat cell are reduced by the shared error.
        least: Least number of pixels of a cell.
        most: Most squared residual per degree of freedom.
        graze: Sine of the least angle between a surface and the ray.
        common, sigmas: Standard deviation of the error that the pixels of one cell share, m, and in those of a pixel.
        rest: (rows, columns), written: sum of squared residuals of a flat cell as weakened, inf of the others.
    """
    A, g = np.empty((3, 3)), np.empty(3)
    for i in range(sums.shape[0]):
        for j in range(sums.shape[1]):
            cell = sums[i, j]
            rest[i, j] = np.inf
            if cell[10] < least:
                continue
            a, b, c, left = fit(cell, A, g)
            if left > most * (cell[10] - 3.0):
                continue
            x, y, middle = cell[2] / cell[5], cell[4] / cell[5], cell[8] / cell[5]  # means
            if middle < graze * math.sqrt((a * a + b * b + c * c) * (x * x + y * y + 1.0)):
                continue
            weaker = 1.0 / (
                1.0 + cell[5] * (common * middle * middle) ** 2 + cell[10] * sigmas * sigmas
            )
            cell *= weaker
            rest[i, j] = left * weaker


@njit(cache=True, nogil=True)
def joined(
    one: np.ndarray, rest: float, other: np.ndarray, more: float, A: np.ndarray, g: np.ndarray,
    both: np.ndarray,
) -> float:  # fmt: skip
    """Increase of the squared residuals if two sets of pixels are one plane: chi-square with 3 degrees of freedom."""
    for k in range(SUMS):
        both[k] = one[k] + other[k]
    _, _, _, left = fit(both, A, g)
    return max(left - rest - more, 0.0)


@njit(cache=True, nogil=True)
def grow(
    sums: np.ndarray,
    rest: np.ndarray,
    order: np.ndarray,
    gate: float,
    least: int,
    labels: np.ndarray,
    regions: np.ndarray,
    region_rest: np.ndarray,
) -> int:
    """Grow regions from cells: a neighbour joins if one plane explains it and all cells so far.

    Args:
        sums, rest: Of the cells, from `flatten`.
        order: Flat indices of the seeds, the best first.
        gate: Most increase of `joined`.
        least: Fewest cells of a region.
        labels: (rows, columns), -1, written.
        regions, region_rest: (m, SUMS) and (m,), written: sums of every region, and its squared residuals.

    Returns:
        Number of regions.
    """
    rows, columns = rest.shape
    A, g, both = np.empty((3, 3)), np.empty(3), np.empty(SUMS)
    queue = np.empty(rows * columns, np.int64)
    count = 0
    for seed in order:
        if labels[seed // columns, seed % columns] != -1:
            continue
        if count == regions.shape[0]:
            break
        total = regions[count]
        total[:] = sums[seed // columns, seed % columns]
        left = rest[seed // columns, seed % columns]
        labels[seed // columns, seed % columns] = count
        queue[0] = seed
        head, tail = 0, 1
        while head < tail:
            i, j = queue[head] // columns, queue[head] % columns
            head += 1
            for k in range(4):
                m = i + (1 if k == 2 else -1 if k == 3 else 0)
                n = j + (1 if k == 0 else -1 if k == 1 else 0)
                if not (0 <= m < rows and 0 <= n < columns):
                    continue
                if labels[m, n] != -1 or rest[m, n] == np.inf:
                    continue
                more = joined(total, left, sums[m, n], rest[m, n], A, g, both)
                if more < gate:
                    total[:] = both
                    left += more + rest[m, n]
                    labels[m, n] = count
                    queue[tail] = m * columns + n
                    tail += 1
        if tail < least:
            for k in range(tail):
                labels[queue[k] // columns, queue[k] % columns] = -1
            labels[seed // columns, seed % columns] = -2  # no seed again, and of no region
            continue
        region_rest[count] = left
        count += 1
    return count


@njit(cache=True, nogil=True)
def merge(
    cells: np.ndarray, regions: np.ndarray, rest: np.ndarray, most: float, reach: int
) -> None:
    """Join neighbouring regions whose pixels one plane explains nearly as well, the most alike first.

    Args:
        cells: (rows, columns), region of every cell, negative if none; changed.
        regions, rest: From `grow`; changed.
        most: Most increase of the squared residuals, per pixel of the smaller region.
        reach: Cells between regions that are neighbours, and one more.
    """
    count = regions.shape[0]
    rows, columns = cells.shape
    near = np.zeros((count, count), np.bool_)
    for i in range(rows):
        for j in range(columns):
            one = cells[i, j]
            for step in range(1, reach + 1):
                for k in range(2):
                    m, n = (i + step, j) if k else (i, j + step)
                    if one >= 0 and m < rows and n < columns:
                        two = cells[m, n]
                        if two >= 0 and two != one:
                            near[one, two] = near[two, one] = True
    A, g, both = np.empty((3, 3)), np.empty(3), np.empty(SUMS)
    into = np.arange(count)
    while True:
        best, first, second = most, -1, -1
        for one in range(count):
            for two in range(one + 1, count):
                if near[one, two]:
                    less = min(regions[one, SUMS - 1], regions[two, SUMS - 1])
                    more = joined(regions[one], rest[one], regions[two], rest[two], A, g, both)
                    if more < best * less:
                        best, first, second = more / less, one, two
        if first < 0:
            break
        rest[first] += rest[second] + best * min(
            regions[first, SUMS - 1], regions[second, SUMS - 1]
        )
        regions[first] += regions[second]
        regions[second] = 0.0
        for other in range(count):
            if near[second, other] and other != first:
                near[first, other] = near[other, first] = True
            near[second, other] = near[other, second] = False
        for k in range(count):
            if into[k] == second:
                into[k] = first
    for i in range(rows):
        for j in range(columns):
            if cells[i, j] >= 0:
                cells[i, j] = into[cells[i, j]]


@njit(cache=True, nogil=True)
def label_pixels(
    q: np.ndarray,
    weight: np.ndarray,
    slope_x: np.ndarray,
    slope_y: np.ndarray,
    cells: np.ndarray,
    size: tuple[int, int],
    slopes: np.ndarray,
    sigmas: float,
    labels: np.ndarray,
    counts: np.ndarray,
) -> None:
    """Give every pixel to the region, of its cell and those around it, that explains it best; -1 if none does.

    Args:
        q, weight: From `sum_cells`.
        slope_x, slope_y: As there.
        cells: (rows, columns), region of every cell, negative if none.
        size: Rows and columns of a cell.
        slopes: (m, 3), a of every region.
        sigmas: Most residual, in standard deviations.
        labels: (h, w), written.
        counts: (m,), zeros, written: pixels of every region.
    """
    height, width = q.shape
    rows, columns = cells.shape
    tall, wide = size
    rows_x, columns_y = slope_x.shape[0], slope_y.shape[1]
    near = np.empty(CANDIDATES, np.int64)
    for i in range((height + tall - 1) // tall):
        for j in range((width + wide - 1) // wide):
            number = 0
            for m in range(max(i - 1, 0), min(i + 2, rows)):
                for n in range(max(j - 1, 0), min(j + 2, columns)):
                    label = cells[m, n]
                    known = label < 0
                    for k in range(number):
                        known = known or near[k] == label
                    if not known:
                        near[number] = label
                        number += 1
            for v in range(i * tall, min((i + 1) * tall, height)):
                for u in range(j * wide, min((j + 1) * wide, width)):
                    labels[v, u] = -1
                    if weight[v, u] == 0.0 or number == 0:
                        continue
                    x = slope_x[v if rows_x > 1 else 0, u]
                    y = slope_y[v, u if columns_y > 1 else 0]
                    best, fits, least = -1, 0, sigmas * sigmas
                    for k in range(number):
                        a = slopes[near[k]]
                        e = q[v, u] - (a[0] * x + a[1] * y + a[2])
                        e2 = e * e * weight[v, u]
                        if e2 < sigmas * sigmas:
                            fits += 1
                        if e2 < least:
                            best, least = near[k], e2
                    if fits > 1:
                        least = np.inf
                        for k in range(number):
                            a = slopes[near[k]]
                            e = q[v, u] - (a[0] * x + a[1] * y + a[2])
                            if e * e * weight[v, u] >= sigmas * sigmas:
                                continue
                            total = 0.0
                            for m in range(max(v - AROUND, 0), min(v + AROUND + 1, height)):
                                for n in range(max(u - AROUND, 0), min(u + AROUND + 1, width)):
                                    px = slope_x[m if rows_x > 1 else 0, n]
                                    py = slope_y[m, n if columns_y > 1 else 0]
                                    e = q[m, n] - (a[0] * px + a[1] * py + a[2])
                                    total += min(e * e * weight[m, n], TRUNCATED)
                            if total < least:
                                best, least = near[k], total
                    labels[v, u] = best
                    if best >= 0:
                        counts[best] += 1


@njit(cache=True, nogil=True)
def gather(
    labels: np.ndarray,
    q: np.ndarray,
    weight: np.ndarray,
    slope_x: np.ndarray,
    slope_y: np.ndarray,
    starts: np.ndarray,
    inner: np.ndarray,
    rough: float,
    xyz: np.ndarray,
    sigma: np.ndarray,
    pixels: np.ndarray,
    inside: np.ndarray,
    totals: np.ndarray,
    spans: np.ndarray,
) -> None:
    """Points of the regions, one region after the other.

    Args:
        labels, q, weight, slope_x, slope_y: As for `label_pixels`.
        starts: (m,), first row of every region; changed.
        inner: (h, w), which pixels are away from the border of their region.
        rough: Roughness that is part of the weight, m.
        xyz, sigma, pixels, inside: (n, 3), (n,), (n,), (n,), written.
        totals: (m, 4), zeros, written: sums of the points of every region, and of z^3.
        spans: (m, h, 2), written where a region has pixels: its first and last column in every row; elsewhere -1.
    """
    height, width = labels.shape
    rows_x, columns_y = slope_x.shape[0], slope_y.shape[1]
    for v in range(height):
        for u in range(width):
            label = labels[v, u]
            if label < 0:
                continue
            k = starts[label]
            starts[label] += 1
            z = 1.0 / q[v, u]
            xyz[k, 0] = slope_x[v if rows_x > 1 else 0, u] * z
            xyz[k, 1] = slope_y[v, u if columns_y > 1 else 0] * z
            xyz[k, 2] = z
            sigma[k] = math.sqrt(max(z**4 / weight[v, u] - rough * rough, 0.0))
            pixels[k] = v * width + u
            inside[k] = inner[v, u]
            total = totals[label]
            for i in range(3):
                total[i] += xyz[k, i]
            total[3] += z * z * z
            if spans[label, v, 0] < 0:
                spans[label, v, 0] = u
            spans[label, v, 1] = u
