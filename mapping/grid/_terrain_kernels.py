"""Compiled loops of the terrain map: points with heights into cells, free space along rays, height fusion.

See `egocentric_grid` and `heights`; NumPy versions are in the tests.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from perception.primitives.compiled import njit

BLOCK = 512  # points indexed at a time: they stay in the first-level cache for the second loop
RAY = -1  # floor count of a cell without points that a ray has cleared


class Placement(NamedTuple):
    """Where the window of a grid is.

    Args:
        row, column: Cell of the torus that holds window cell [0, 0].
        x_m, y_m: Lower left corner of the window, world frame, m.
        cell_m: Side of a cell, m.
    """

    row: int
    column: int
    x_m: float
    y_m: float
    cell_m: float


class HeightRule(NamedTuple):
    """How the heights of a frame are fused.

    Args:
        measured: Whether the points have heights.
        obstacle_points: Fewer obstacle points in a cell are noise.
        base_m2: Variance of a frame's heights besides noise, floor and pose, m^2.
        gate: Squared Mahalanobis distance beyond which the surface is a new one.
    """

    measured: bool
    obstacle_points: int
    base_m2: float
    gate: float


@njit(cache=True)
def add_run(
    counts: np.ndarray,
    sums: np.ndarray,
    cell: np.int32,
    run: int,
    total: float,
    squares: float,
    variance: float,
) -> None:
    """Add the sums of consecutive points in one cell."""
    counts[cell] += run
    sums[cell, 0] += total
    sums[cell, 1] += squares
    sums[cell, 2] += variance


@njit(cache=True)
def gather(
    flat: np.ndarray,
    obstacle: np.ndarray,
    moving: np.ndarray,
    sigma: np.ndarray,
    anchor: np.ndarray,
    per_m: float,
    first: np.ndarray,
    rows: int,
    columns: int,
    counts: np.ndarray,
    sums: np.ndarray,
) -> None:
    """Count the points of each kind in each cell of a window, and sum their heights.

    Window and lattice are those of `_evidence_kernels.count_points`. A first loop over indices vectorises.
    Neighbouring pixels mostly fall into one cell: the second loop sums them in registers and writes once
    per run.

    Args:
        flat: (3 n,) float64: x, y, height of each point, m.
        obstacle: (n,) uint8, 1 for an obstacle.
        moving: (n,) uint8, 1 for a moving obstacle; or empty.
        sigma: (n,) float64, standard deviation of each point, m; or empty.
        anchor: (2,), lower left corner of lattice cell (0, 0), m.
        per_m: Cells per metre.
        first: (2,), lattice cell (x, y) of the window's corner.
        rows, columns: Size of the window.
        counts: (3 rows columns + 1,) int32, all zero: kinds, rows, columns, then points outside.
        sums: (3 rows columns + 1, 3) float64, all zero: heights, squared heights, squared sigmas.
    """
    ax, ay, fx, fy = anchor[0], anchor[1], first[0], first[1]
    cells = np.int32(rows * columns)
    outside = np.int32(3 * cells)
    block = np.empty(BLOCK, np.int32)
    n = flat.shape[0] // 3
    last, run, total, squares, variance = outside, 0, 0.0, 0.0, 0.0
    for start in range(0, n, BLOCK):
        size = min(BLOCK, n - start)
        part = flat[3 * start : 3 * (start + size)]
        rising = obstacle[start : start + size]
        for i in range(size):
            x = np.floor((part[3 * i] - ax) * per_m) - fx
            y = np.floor((part[3 * i + 1] - ay) * per_m) - fy
            z = part[3 * i + 2]
            inside = (x >= 0.0) & (x < columns) & (y >= 0.0) & (y < rows) & (z - z == 0.0)
            cell = np.int32(y) * np.int32(columns) + np.int32(x)
            block[i] = cell if inside else outside
        for i in range(size):
            block[i] = min(outside, block[i] + cells * np.int32(rising[i]))
        if moving.shape[0] > 0:
            walking = moving[start : start + size]
            for i in range(size):
                block[i] = min(outside, block[i] + cells * np.int32(rising[i] & walking[i]))
        noise = sigma[start : start + size]
        for i in range(size):
            cell, z = block[i], part[3 * i + 2]
            if cell != last:
                add_run(counts, sums, last, run, total, squares, variance)
                last, run, total, squares, variance = cell, 0, 0.0, 0.0, 0.0
            run += 1
            total += z
            squares += z * z
            if noise.shape[0] > 0:
                variance += noise[i] * noise[i]
    add_run(counts, sums, last, run, total, squares, variance)


@njit(cache=True)
def clear_before_floor(counts: np.ndarray, sensor: np.ndarray, stretch: float) -> None:
    """Clear the cells in front of a seen floor cell, where the ray runs lower than any obstacle.

    Args:
        counts: (3, rows, columns) int32; the floor count of such a cell without points becomes `RAY`.
        sensor: (2,), position (x, y) of the sensor in the window, in cells (cell centres at + 0.5).
        stretch: Height of the lowest obstacle over that of the sensor: the share of the ray below it.
    """
    rows, columns = counts.shape[1], counts.shape[2]
    sensor_x, sensor_y = sensor[0], sensor[1]
    reach = max(abs(sensor_x), abs(sensor_x - columns)) + max(abs(sensor_y), abs(sensor_y - rows))
    shortest = 1.0 / max(stretch, 1e-6)  # rays whose stretch is shorter than a cell clear nothing
    if reach < shortest:
        return
    for row in range(rows):
        for column in range(columns):
            if counts[0, row, column] <= 0:
                continue
            dx, dy = sensor_x - (column + 0.5), sensor_y - (row + 0.5)
            length = np.sqrt(dx * dx + dy * dy)
            if length < shortest:
                continue
            for k in range(1, int(length * stretch) + 1):
                c = int(np.floor(column + 0.5 + k * dx / length))
                r = int(np.floor(row + 0.5 + k * dy / length))
                if c < 0 or c >= columns or r < 0 or r >= rows:
                    break
                if counts[0, r, c] == 0 and counts[1, r, c] == 0 and counts[2, r, c] == 0:
                    counts[0, r, c] = RAY


@njit(cache=True)
def floor_form(tangents: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Variance of n.p + rho at (x, y, 1) for a level plane with the covariance of `Plane`; (3, 3)."""
    lever = np.zeros((3, 3))
    lever[:2, :2] = tangents[:, :2]
    lever[2, 2] = 1.0
    result = np.zeros((3, 3))
    add_form(result, lever, covariance, 1.0)
    return result


@njit(cache=True)
def pose_form(x: float, y: float, covariance: np.ndarray) -> np.ndarray:
    """Form over (x, y, 1) of the positional variance by a pose at (x, y, any), mean of both axes; (3, 3)."""
    result = np.zeros((3, 3))
    along = np.zeros((3, 3))  # displacement of a place along x, per pose error
    along[0, 2], along[2, 1], along[2, 2] = 1.0, -1.0, y
    add_form(result, along, covariance, 0.5)
    along[:] = 0.0  # along y
    along[1, 2], along[2, 0], along[2, 2] = 1.0, 1.0, -x
    add_form(result, along, covariance, 0.5)
    return result


@njit(cache=True)
def add_form(result: np.ndarray, lever: np.ndarray, covariance: np.ndarray, weight: float) -> None:
    """Add weight times L^T P L, all (3, 3)."""
    for i in range(3):
        for j in range(3):
            for k in range(3):
                for m in range(3):
                    result[i, j] += weight * lever[k, i] * covariance[k, m] * lever[m, j]


@njit(cache=True)
def form(matrix: np.ndarray, x: float, y: float) -> float:
    """(x, y, 1) M (x, y, 1) for a symmetric (3, 3) M."""
    return (
        x * (matrix[0, 0] * x + 2.0 * (matrix[0, 1] * y + matrix[0, 2]))
        + y * (matrix[1, 1] * y + 2.0 * matrix[1, 2])
        + matrix[2, 2]
    )


@njit(cache=True)
def measure(
    count: int, total: float, squares: float, noise: float, base: float
) -> tuple[float, float, float]:
    """Mean height of the points of a cell, their variance, and the variance of the mean."""
    mean = total / count
    spread = max(0.0, squares / count - mean * mean)
    each = max(spread * count / max(1, count - 1), noise / count)
    return mean, spread, each / count + base


@njit(cache=True)
def slope2_about(
    height: float,
    heights: np.ndarray,
    raised: np.ndarray,
    place: Placement,
    at: tuple[int, int],
    shape: tuple[int, int],
) -> float:
    """Squared slope of the surface about a cell of a window, by the heights of its neighbours on the same surface."""
    row, column = (place.row + at[0]) % heights.shape[0], (place.column + at[1]) % heights.shape[1]
    total = 0.0
    for axis in range(2):
        rise, run = 0.0, 0.0
        for side in (-1, 1):
            i, j = at[0] + side * (1 - axis), at[1] + side * axis
            if not (0 <= i < shape[0] and 0 <= j < shape[1]):
                continue
            r, c = (place.row + i) % heights.shape[0], (place.column + j) % heights.shape[1]
            if raised[r, c] == raised[row, column] and not np.isnan(heights[r, c]):
                rise += side * (heights[r, c] - height)
                run += place.cell_m
        if run > 0.0:
            total += (rise / run) ** 2
    return total


@njit(cache=True)
def fuse_heights(
    counts: np.ndarray,
    sums: np.ndarray,
    log_odds: np.ndarray,
    heights: np.ndarray,
    variances: np.ndarray,
    raised: np.ndarray,
    place: Placement,
    floor_form: np.ndarray,
    pose_form: np.ndarray,
    rule: HeightRule,
) -> None:
    """Fuse the heights of a frame into the cells, after `fold_evidence`; clears counts and sums.

    Args:
        counts: (3, rows, columns) int32 of the window.
        sums: (3 rows columns + 1, 3) float64, of `gather`; here the sigmas are those of the heights.
        log_odds: (map rows, map columns) float32, torus as for `fold_evidence`.
        heights, variances: Same shape, float32, m and m^2; NaN: not measured; changed.
        raised: Same shape, bool: the height is that of an obstacle; changed.
        place: The window.
        floor_form: (3, 3), variance of the floor's height at (x, y, 1), m^2.
        pose_form: (3, 3), variance of a place along one axis at (x, y, 1), m^2.
        rule: How heights are fused.
    """
    rows, columns = counts.shape[1], counts.shape[2]
    cells = rows * columns
    for row in range(rows):
        r = (place.row + row) % log_odds.shape[0]
        for column in range(columns):
            flat = row * columns + column
            floor, static, mobile = (
                counts[0, row, column],
                counts[1, row, column],
                counts[2, row, column],
            )
            if floor == 0 and static == 0 and mobile == 0:
                continue
            c = (place.column + column) % log_odds.shape[1]
            occupied = log_odds[r, c] > 0.0
            if raised[r, c] != occupied:  # the surface measured here has gone
                heights[r, c] = np.nan
                variances[r, c] = np.nan
                raised[r, c] = occupied
            rising = static + mobile >= rule.obstacle_points
            first, count = (cells, static + mobile) if rising else (0, floor)
            if rule.measured and rising == occupied and count > 0:
                total, squares, noise = 0.0, 0.0, 0.0
                for kind in range(2 if rising else 1):
                    total += sums[first + kind * cells + flat, 0]
                    squares += sums[first + kind * cells + flat, 1]
                    noise += sums[first + kind * cells + flat, 2]
                mean, spread, own = measure(count, total, squares, noise, rule.base_m2)
                x = place.x_m + (column + 0.5) * place.cell_m
                y = place.y_m + (row + 0.5) * place.cell_m
                uneven = max(0.0, spread * count / max(1, count - 1) - noise / count)
                slope2 = max(
                    12.0 * uneven / (place.cell_m * place.cell_m),  # of a plane so uneven
                    slope2_about(mean, heights, raised, place, (row, column), (rows, columns)),
                )
                shared = form(floor_form, x, y) + slope2 * form(pose_form, x, y)
                old, old_variance = heights[r, c], variances[r, c]
                new = own + shared
                apart = (mean - old) ** 2
                if mobile > 0 or not apart <= rule.gate * (old_variance + new):  # also where NaN
                    heights[r, c], variances[r, c] = mean, new
                else:
                    gain = old_variance / (old_variance + new)
                    heights[r, c] = old + gain * (mean - old)
                    variances[r, c] = max((1.0 - gain) * old_variance, min(shared, old_variance))
            for kind in range(3):
                counts[kind, row, column] = 0
                sums[kind * cells + flat, :] = 0.0
    sums[3 * cells, :] = 0.0
