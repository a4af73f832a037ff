"""Compiled loops over the borders of regions: the straight lines there."""

from __future__ import annotations

import math

import numpy as np

from ..primitives.compiled import njit
from ._border_kernels import DOWN, LEFT, RIGHT, UP

LEAST_SAMPLES, MOST_SAMPLES = 10, 120  # ours: pixels of an edge; more are thinned
MOST_EDGES = 2  # ours: of one kind on one side of a region
TRIALS = 12  # ours: samples from which lines to two others are tried
INLIER_PX = 1.5  # ours: a sample within this many pixels' width of a line is on it
BESIDE_PX = 5.0  # ours: a sample within this many is on no other line
LEAST_SHARE = 0.2  # ours: of the samples of a side that an edge explains
GAP_M, GAP_SPACINGS = 0.15, 5.0  # ours: of an edge; beyond both, what follows is another edge
LEAST_WIDTH_M = 1e-4  # of a pixel on a plane, as far as it counts
PARTS = 8  # ours: of an edge, whose scatter tells its covariance
LINE = 15  # both ends (3 each), variances of angle and offset and their covariance, pixel width, region, kind, other, noise, samples


@njit(cache=True, nogil=True)
def samples(
    rows: np.ndarray,
    q: np.ndarray,
    weight: np.ndarray,
    slope_x: np.ndarray,
    slope_y: np.ndarray,
    plane: np.ndarray,
    middle: np.ndarray,
    tangents: np.ndarray,
    at: np.ndarray,
    steps: np.ndarray,
    noise: np.ndarray,
    kept: np.ndarray,
) -> int:
    """Places of pairs of pixels of one region on its plane, along its tangents from its middle.

    Args:
        rows: (n, FIELDS), from `_border_kernels.borders`.
        q, weight, slope_x, slope_y: As there.
        plane, middle, tangents: Normal and offset (4,), a point (3,), and (2, 3).
        at, steps, noise, kept: (n, 2), (n, 2), (n,) and (n,), written: place of the border, width of a pixel
            across it, standard deviation of depth, and row; as far as the plane is met.

    Returns:
        Number of places.
    """
    width = q.shape[1]
    rows_x, columns_y = slope_x.shape[0], slope_y.shape[1]
    count = 0
    for k in range(rows.shape[0]):
        side, step = rows[k, 1], rows[k, 5]
        v, u = rows[k, 4] // width, rows[k, 4] % width
        m = v + (-step if side == UP else step if side == DOWN else 0)
        n = u + (-step if side == LEFT else step if side == RIGHT else 0)
        x0 = slope_x[v if rows_x > 1 else 0, u]
        y0 = slope_y[v, u if columns_y > 1 else 0]
        x1 = (x0 + slope_x[m if rows_x > 1 else 0, n]) / 2.0
        y1 = (y0 + slope_y[m, n if columns_y > 1 else 0]) / 2.0
        first = plane[0] * x0 + plane[1] * y0 + plane[2]
        second = plane[0] * x1 + plane[1] * y1 + plane[2]
        if first > -1e-6 or second > -1e-6:
            continue
        z0, z1 = -plane[3] / first, -plane[3] / second
        for i in range(2):
            a, b, c = tangents[i, 0], tangents[i, 1], tangents[i, 2]
            inner = a * x0 * z0 + b * y0 * z0 + c * z0
            outer = a * x1 * z1 + b * y1 * z1 + c * z1
            steps[count, i] = 2.0 * (outer - inner)
            at[count, i] = outer - a * middle[0] - b * middle[1] - c * middle[2]
        noise[count] = weight[v, u] ** -0.5 / q[v, u] ** 2
        kept[count] = k
        count += 1
    return count


@njit(cache=True, nogil=True, forceinline=True)
def off_line(
    at: np.ndarray, steps: np.ndarray, k: int, x: float, y: float, off: float
) -> tuple[float, float]:
    """Distance of a sample from the line of this normal and offset, and the width of its pixel across it, m."""
    wide = max(abs(steps[k, 0] * x + steps[k, 1] * y), LEAST_WIDTH_M)
    return abs(at[k, 0] * x + at[k, 1] * y - off), wide


@njit(cache=True, nogil=True)
def largest_line(at: np.ndarray, steps: np.ndarray) -> tuple[int, float, float, float]:
    """Samples on the line that has most of them, its normal and its offset."""
    count = at.shape[0]
    most, best_x, best_y, best_off = 0, 0.0, 0.0, 0.0
    for trial in range(2 * TRIALS):
        one = int((trial % TRIALS) * (count - 1) / (TRIALS - 1))
        two = (one + (count // 2 if trial < TRIALS else count // 5)) % count
        x, y = at[two, 0] - at[one, 0], at[two, 1] - at[one, 1]
        length = math.hypot(x, y)
        if length < 1e-6:
            continue
        x, y = -y / length, x / length
        off = at[one, 0] * x + at[one, 1] * y
        near = 0
        for k in range(count):
            away, wide = off_line(at, steps, k, x, y, off)
            if away < INLIER_PX * wide:
                near += 1
        if near > most:
            most, best_x, best_y, best_off = near, x, y, off
    return most, best_x, best_y, best_off


@njit(cache=True, nogil=True)
def fit_line(
    at: np.ndarray, steps: np.ndarray, crossed: np.ndarray, line: np.ndarray
) -> tuple[float, float, float, float, float, float]:
    """Least squares line with its covariance, by the scatter of its parts.

    Args:
        at, steps: (n, 2), of the samples on it.
        crossed: (n,), row or column of each.
        line: (LINE,), written: variances and covariance of angle and offset in the middle of its ends, width of a pixel.

    Returns:
        Middle of its ends, direction, and half its length.
    """
    count = at.shape[0]
    x, y = 0.0, 0.0  # normal
    cx, cy, total = 0.0, 0.0, 0.0
    w = np.ones(count)
    for turn in range(3):  # the first one without weights
        if turn > 0:
            for k in range(count):
                wide = max(abs(steps[k, 0] * x + steps[k, 1] * y), LEAST_WIDTH_M)
                w[k] = 1.0 / (wide * wide)
        total, cx, cy = w.sum(), 0.0, 0.0
        for k in range(count):
            cx += w[k] * at[k, 0]
            cy += w[k] * at[k, 1]
        cx, cy = cx / total, cy / total
        a, b, c = 0.0, 0.0, 0.0
        for k in range(count):
            dx, dy = at[k, 0] - cx, at[k, 1] - cy
            a += w[k] * dx * dx
            b += w[k] * dx * dy
            c += w[k] * dy * dy
        angle = 0.5 * math.atan2(2.0 * b, a - c)
        x, y = -math.sin(angle), math.cos(angle)
    run, away = np.empty(count), np.empty(count)
    for k in range(count):
        dx, dy = at[k, 0] - cx, at[k, 1] - cy
        run[k] = dx * y - dy * x
        away[k] = dx * x + dy * y
    order = np.argsort(run)
    parts = min(PARTS, count // 4)
    squares, lever = 0.0, 0.0
    begin = 0
    for part in range(parts):
        end = begin + count // parts + (1 if part < count % parts else 0)
        sum_w, offset, place = 0.0, 0.0, 0.0
        for k in order[begin:end]:
            sum_w += w[k]
            offset += w[k] * away[k]
            place += w[k] * run[k]
        squares += (offset / sum_w) ** 2
        lever += (place / sum_w) ** 2
        begin = end
    rounded = 1  # how often the border is rounded independently, to whole pixels
    for k in range(1, count):
        rounded += crossed[order[k]] != crossed[order[k - 1]]
    unit = 1.0 / math.sqrt(total / count)
    low, high = run.min(), run.max()
    step = unit / rounded
    scatter = squares / max(parts - 4, 1)  # variance of Student's t; two parameters are fitted
    at_centre = max(scatter / parts, step * step / 12.0)
    turned = max(scatter / max(lever, 1e-9), (step / max(high - low, 1e-9)) ** 2)
    shift = (low + high) / 2.0
    line[6], line[7], line[8] = turned, at_centre + shift * shift * turned, shift * turned
    line[9] = unit
    return cx + shift * y, cy - shift * x, y, -x, (high - low) / 2.0, float(count)


@njit(cache=True, nogil=True, forceinline=True)
def samples_on(
    at: np.ndarray, steps: np.ndarray, count: int, x: float, y: float, off: float, most: int
) -> np.ndarray:
    """The samples on the line of this normal and offset; `most` is their number."""
    on, inside = np.empty(most, np.int64), 0
    for k in range(count):
        away, wide = off_line(at, steps, k, x, y, off)
        if away < INLIER_PX * wide:
            on[inside] = k
            inside += 1
    return on


@njit(cache=True, nogil=True)
def unbroken(at: np.ndarray, on: np.ndarray, x: float, y: float) -> np.ndarray:
    """Of the samples on a line of this normal, the most without a gap: a passage between two walls is no wall."""
    count = on.shape[0]
    run = np.empty(count)
    for k in range(count):
        run[k] = at[on[k], 0] * y - at[on[k], 1] * x
    order = np.argsort(run)
    gap = max(GAP_M, GAP_SPACINGS * (run[order[-1]] - run[order[0]]) / count)
    begin, first, last = 0, 0, 0
    for k in range(1, count + 1):
        if k == count or run[order[k]] - run[order[k - 1]] > gap:
            if k - begin > last - first:
                first, last = begin, k
            begin = k
    return on[order[first:last]]


@njit(cache=True, nogil=True, forceinline=True)
def keep_beside(
    at: np.ndarray,
    steps: np.ndarray,
    noise: np.ndarray,
    kept: np.ndarray,
    count: int,
    on: np.ndarray,
    x: float,
    y: float,
    off: float,
) -> int:
    """Of the samples, as `samples` wrote them, keep those far enough from this edge to be on another; their number.

    Args:
        on: The samples that the edge has.
        x, y, off: Its normal and offset.
    """
    low, high = np.inf, -np.inf
    for k in on:
        run = at[k, 0] * y - at[k, 1] * x
        low, high = min(low, run), max(high, run)
    left = 0
    for k in range(count):
        away, wide = off_line(at, steps, k, x, y, off)
        run = at[k, 0] * y - at[k, 1] * x
        if away >= BESIDE_PX * wide or run < low or run > high:
            at[left], steps[left] = at[k], steps[k]
            noise[left], kept[left] = noise[k], kept[k]
            left += 1
    return left


@njit(cache=True, nogil=True, forceinline=True)
def place_ends(
    middle: np.ndarray,
    tangents: np.ndarray,
    fit: tuple[float, float, float, float, float, float],
    line: np.ndarray,
) -> None:
    """Both ends of a line in space, m.

    Args:
        middle, tangents: (3,) and (2, 3), of its region.
        fit: From `fit_line`.
        line: (LINE,), the ends are written.
    """
    cx, cy, dx, dy, half, _ = fit
    for i in range(3):
        centre = middle[i] + cx * tangents[0, i] + cy * tangents[1, i]
        way = half * (dx * tangents[0, i] + dy * tangents[1, i])
        line[i], line[3 + i] = centre - way, centre + way


@njit(cache=True, nogil=True, forceinline=True)
def region_beyond(group: np.ndarray, kept: np.ndarray, on: np.ndarray, regions: int) -> float:
    """The region that is beyond most of these samples; -1 if none is beyond any.

    Args:
        group: (n, FIELDS), the rows of one side and kind.
        kept: Row of each sample.
        on: The samples.
        regions: Number of regions.
    """
    votes = np.zeros(regions, np.int64)
    for k in on:
        other = group[kept[k], 3]
        if other >= 0:
            votes[other] += 1
    return float(np.argmax(votes)) if votes.max() > 0 else -1.0


@njit(cache=True, nogil=True, forceinline=True)
def mean(values: np.ndarray, chosen: np.ndarray) -> float:
    """Mean of some of the values."""
    total = 0.0
    for k in chosen:
        total += values[k]
    return total / chosen.shape[0]


@njit(cache=True, nogil=True)
def more_across(line: np.ndarray) -> bool:
    """Whether a line runs more across the image than down, and so is best crossed by columns."""
    across = abs(line[3] / line[5] - line[0] / line[2])
    down = abs(line[4] / line[5] - line[1] / line[2])
    return across >= down


@njit(cache=True, nogil=True)
def lines_of(
    rows: np.ndarray,
    ends: np.ndarray,
    q: np.ndarray,
    weight: np.ndarray,
    slope_x: np.ndarray,
    slope_y: np.ndarray,
    planes: np.ndarray,
    middles: np.ndarray,
    tangents: np.ndarray,
    least: np.ndarray,
    found: np.ndarray,
) -> int:
    """Lines through the ends of regions, side by side and kind by kind, the largest of each first.

    Args:
        rows: (n, FIELDS), sorted by region, side and kind.
        ends: (m,), where each such group ends.
        q, weight, slope_x, slope_y: As for `samples`.
        planes, middles, tangents: (r, 4), (r, 3), (r, 2, 3), of every region.
        least: (2,), fewest samples along columns and rows.
        found: (k, LINE), written as far as it reaches.

    Returns:
        Number of lines.
    """
    number, begin = 0, 0
    width = q.shape[1]
    at, steps = np.empty((MOST_SAMPLES + 1, 2)), np.empty((MOST_SAMPLES + 1, 2))
    noise, kept = np.empty(MOST_SAMPLES + 1), np.empty(MOST_SAMPLES + 1, np.int64)
    for end in ends:
        group = rows[begin:end]
        begin = end
        side, region = group[0, 1], group[0, 0]
        by_columns = side <= DOWN
        if group.shape[0] < max(least[0] if by_columns else least[1], LEAST_SAMPLES):
            continue
        group = group[:: (group.shape[0] + MOST_SAMPLES - 1) // MOST_SAMPLES]
        count = samples(
            group, q, weight, slope_x, slope_y, planes[region], middles[region], tangents[region],
            at, steps, noise, kept,
        )  # fmt: skip
        fewest = max(float(LEAST_SAMPLES), LEAST_SHARE * group.shape[0])
        lines = 0
        while count >= fewest and lines < MOST_EDGES:
            most, x, y, off = largest_line(at[:count], steps[:count])
            if most < fewest or number == found.shape[0]:
                break
            on = unbroken(at, samples_on(at, steps, count, x, y, off, most), x, y)
            if on.shape[0] < fewest:
                count = keep_beside(at, steps, noise, kept, count, on, x, y, off)
                continue
            crossed = group[kept[on], 4]
            crossed = crossed // width if by_columns else crossed % width
            line = found[number]
            fit = fit_line(at[on], steps[on], crossed, line)
            place_ends(middles[region], tangents[region], fit, line)
            line[10], line[11] = float(region), float(group[0, 2])
            line[12] = region_beyond(group, kept, on, planes.shape[0])
            line[13], line[14] = mean(noise, on), fit[5]
            if more_across(line) == by_columns:  # else the others cross it at a larger angle
                number += 1
                lines += 1
            count = keep_beside(at, steps, noise, kept, count, on, x, y, off)
    return number
