"""Compiled loops over the borders of regions: where one ends, and what is beyond."""

from __future__ import annotations

import math

import numpy as np

from ..primitives.compiled import njit

GAP_PX = 3  # ours: pixels without depth or region that a border may be wide: flying pixels
BEYOND_PX = 4  # ours: how far beyond a fold its sense is judged
MIXED_PX = 1  # ours: pixels between two surfaces that may see both
MOST_FOLD_SIGMAS = 10.0  # ours: beyond, a surface that begins in the border, not behind it
MOST_BACK_PX = 8  # ours
CONVEX, CONCAVE, OCCLUDING, HIDDEN = 0, 1, 2, 3
UP, DOWN, LEFT, RIGHT = 0, 1, 2, 3
FIELDS = 6  # region, side, kind, other region or -1, flat pixel inside, pixels to the one outside


@njit(cache=True, nogil=True)
def fitting(
    labels: np.ndarray,
    q: np.ndarray,
    weight: np.ndarray,
    slope_x: np.ndarray,
    slope_y: np.ndarray,
    a: np.ndarray,
    pixel: tuple[int, int],
    way: tuple[int, int],
    off: float,
) -> int:
    """Pixels of a region, inwards from its border, that fit only by their noise and are of the surface beyond.

    Args:
        labels, q, weight, slope_x, slope_y: As for `borders`.
        a: Slope of the region.
        pixel, way: The last pixel of the region, and the step outwards.
        off: Residual of the first pixel beyond: theirs have the same sign.
    """
    (v, u), (dv, du) = pixel, way
    label = labels[v, u]
    for back in range(MOST_BACK_PX):
        m, n = v - back * dv, u - back * du
        if not (0 <= m < labels.shape[0] and 0 <= n < labels.shape[1]) or labels[m, n] != label:
            return max(back - 1, 0)
        x = slope_x[m if slope_x.shape[0] > 1 else 0, n]
        y = slope_y[m, n if slope_y.shape[1] > 1 else 0]
        e = (q[m, n] - (a[0] * x + a[1] * y + a[2])) * math.sqrt(weight[m, n])
        if e * math.copysign(1.0, off) < 1.0:
            return back
    return MOST_BACK_PX - 1


@njit(cache=True, nogil=True)  # long: as calls it took 1.3 to 1.6 times as long
def borders(
    labels: np.ndarray,
    q: np.ndarray,
    weight: np.ndarray,
    slope_x: np.ndarray,
    slope_y: np.ndarray,
    slopes: np.ndarray,
    sigmas: float,
    found: np.ndarray,
) -> int:
    """Pairs of pixels along columns and rows of which the first is the last one of its region.

    Args:
        labels: (h, w), region of every pixel, -1 if none.
        q, weight: (h, w), inverse depth and one over its variance; 0 where there is no depth.
        slope_x, slope_y: Ray slopes as (1 or h, w) and (h, 1 or w) tables.
        slopes: (m, 3), a of every region.
        sigmas: Standard deviations within which two surfaces meet.
        found: (n, FIELDS), written as far as it reaches.

    Returns:
        Number of pairs.
    """
    height, width = labels.shape
    rows_x, columns_y = slope_x.shape[0], slope_y.shape[1]
    count = 0
    for v in range(height):
        for u in range(width):
            label = labels[v, u]
            if label < 0:
                continue
            if (
                0 < v < height - 1
                and 0 < u < width - 1
                and labels[v - 1, u] == label
                and labels[v + 1, u] == label
                and labels[v, u - 1] == label
                and labels[v, u + 1] == label
            ):
                continue
            for side in range(4):
                dv = -1 if side == UP else 1 if side == DOWN else 0
                du = -1 if side == LEFT else 1 if side == RIGHT else 0
                step, first = 1, 0  # first: the nearest pixel with depth of no region
                while step <= GAP_PX:
                    m, n = v + step * dv, u + step * du
                    if not (0 <= m < height and 0 <= n < width):
                        step = GAP_PX + 2
                    elif labels[m, n] >= 0:
                        break
                    else:
                        if first == 0 and weight[m, n] > 0.0:
                            first = step
                        step += 1
                m, n = v + step * dv, u + step * du
                if step == GAP_PX + 1:  # wide: depth of no region, or none
                    if not (0 <= m < height and 0 <= n < width) or weight[m, n] == 0.0:
                        continue
                elif step > GAP_PX + 1 or labels[m, n] == label:
                    continue
                if count == found.shape[0]:
                    return count
                other = labels[m, n]
                x0 = slope_x[v if rows_x > 1 else 0, u]
                y0 = slope_y[v, u if columns_y > 1 else 0]
                x1 = slope_x[m if rows_x > 1 else 0, n]
                y1 = slope_y[m, n if columns_y > 1 else 0]
                x, y = (x0 + x1) / 2.0, (y0 + y1) / 2.0
                a = slopes[label]
                own = a[0] * x + a[1] * y + a[2]
                b = slopes[max(other, 0)]
                if other >= 0:
                    there = b[0] * x + b[1] * y + b[2]
                    wide = (b[0] - a[0]) * (x1 - x0) + (b[1] - a[1]) * (y1 - y0)
                    ahead = there - own + wide * BEYOND_PX / step
                else:
                    there = q[m, n]
                    own = a[0] * x1 + a[1] * y1 + a[2]
                    wide, ahead = 0.0, 0.0
                noise = sigmas * (weight[v, u] ** -0.5)
                if abs(there - own) < noise + abs(wide) and other >= 0:
                    kind = CONCAVE if ahead > 0.0 else CONVEX
                else:
                    kind = OCCLUDING if there < own else HIDDEN
                found[count, 0] = label
                found[count, 1] = side
                found[count, 2] = kind
                found[count, 3] = other
                back = 0
                beyond = first if first > 0 else step  # the nearest pixel with depth
                between = first > 0 and step > MIXED_PX + 1  # a surface of no region
                if between:
                    step = first
                if between or kind == OCCLUDING:  # pixels of the region may reach onto it
                    m, n = v + beyond * dv, u + beyond * du
                    x1 = slope_x[m if rows_x > 1 else 0, n]
                    y1 = slope_y[m, n if columns_y > 1 else 0]
                    off = q[m, n] - (a[0] * x1 + a[1] * y1 + a[2])
                    if abs(off) * math.sqrt(weight[m, n]) < MOST_FOLD_SIGMAS:
                        back = fitting(
                            labels, q, weight, slope_x, slope_y, a, (v, u), (dv, du), off
                        )
                found[count, 4] = (v - back * dv) * width + u - back * du
                found[count, 5] = step if back == 0 else 1
                count += 1
    return count
