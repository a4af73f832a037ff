"""Compiled inner loops of the square-root sigma-point filter.

A covariance is represented by its lower root L, P = L L^T, with a positive diagonal. Every step forms a wide matrix M of
deviations with P = M M^T and reduces M to the next root by reflections (an LQ decomposition). Nothing is subtracted,
so the covariance stays positive definite. Only a centre point with negative weight is subtracted again, unless the
result would not be positive; then the covariance stays larger.

Scratch arrays come from the caller, so no loop allocates. False means that the input was refused.
"""

from __future__ import annotations

import math

import numpy as np

from ..primitives.compiled import njit

SHARE = 1e-7
"""Least diagonal of a root relative to the length of its row: the resolution of a covariance matrix."""

LEAST = 1e-12
"""Least standard deviation of an entry, in its unit."""


@njit(cache=True)
def wrapped(angle: float) -> float:
    """The same angle in [-pi, pi)."""
    if -math.pi <= angle < math.pi:
        return angle
    turned = (angle + math.pi) % (2.0 * math.pi) - math.pi
    return turned if turned < math.pi else -math.pi


@njit(cache=True)
def root_of(matrix: np.ndarray, size: int, root: np.ndarray) -> bool:
    """Lower root of a positive semidefinite matrix; False if it is not one or not finite."""
    for i in range(size):
        for j in range(i):
            root[j, i] = 0.0
        for j in range(i + 1):
            total = 0.5 * (matrix[i, j] + matrix[j, i])
            for k in range(j):
                total -= root[i, k] * root[j, k]
            if j < i:
                root[i, j] = total / root[j, j] if root[j, j] > 0.0 else 0.0
            else:
                if not total >= -1e-9 * abs(matrix[i, i]) or not math.isfinite(total):
                    return False
                root[i, i] = math.sqrt(total) if total > 0.0 else 0.0
    return True


@njit(cache=True, forceinline=True, fastmath={"reassoc", "contract"})  # NaN stays NaN
def lower(wide: np.ndarray, pivots: int, rows: int, columns: int, filled: int) -> None:
    """Reduce the first rows of a matrix to lower ones with the same M M^T, in place.

    Householder reflections from the right, row by row. Diagonals are positive and not below the resolution.

    Args:
        wide: At least (rows, columns).
        pivots: Number of rows to reduce.
        rows, columns: Size of the matrix.
        filled: Columns of the first row behind which it is zero; one more for every further row.
    """
    for i in range(pivots):
        end = min(filled + i, columns)
        norm = 0.0
        for c in range(i + 1, end):
            norm += wide[i, c] * wide[i, c]
        if norm > 0.0:
            head = wide[i, i]
            length = math.sqrt(head * head + norm)
            pivot = head + length if head >= 0.0 else head - length
            beta = 2.0 / (pivot * pivot + norm)
            for r in range(i + 1, rows):
                dot = wide[r, i] * pivot
                for c in range(i + 1, end):
                    dot += wide[r, c] * wide[i, c]
                dot *= beta
                wide[r, i] -= dot * pivot
                for c in range(i + 1, end):
                    wide[r, c] -= dot * wide[i, c]
            wide[i, i] = -length if head >= 0.0 else length
            for c in range(i + 1, end):
                wide[i, c] = 0.0
        if wide[i, i] < 0.0:
            for r in range(i, rows):
                wide[r, i] = -wide[r, i]
        before = 0.0
        for c in range(i):
            before += wide[i, c] * wide[i, c]
        diagonal = wide[i, i]
        if not (diagonal * diagonal >= SHARE * SHARE * before and diagonal >= LEAST):
            wide[i, i] = max(SHARE * math.sqrt(before), LEAST)


@njit(cache=True)
def take_away(root: np.ndarray, size: int, away: np.ndarray, work: np.ndarray) -> bool:
    """Root of root root^T - away away^T, in place; False, and unchanged, if that is not positive definite.

    Args:
        root: (size, at least size), lower.
        away: (size,); overwritten.
        work: (size, size) at least, scratch.
    """
    for i in range(size):
        for j in range(i + 1):
            work[i, j] = root[i, j]
    for k in range(size):
        diagonal = work[k, k]
        left = (diagonal - away[k]) * (diagonal + away[k])
        if not left > (SHARE * diagonal) ** 2:
            return False
        r = math.sqrt(left)
        c, s = r / diagonal, away[k] / diagonal
        work[k, k] = r
        for i in range(k + 1, size):
            work[i, k] = (work[i, k] - s * away[i]) / c
            away[i] = c * away[i] - s * work[i, k]
    for i in range(size):
        for j in range(i + 1):
            root[i, j] = work[i, j]
    return True


@njit(cache=True)
def draw(mean: np.ndarray, root: np.ndarray, reach: float, points: np.ndarray) -> None:
    """Sigma points: the mean, then mean plus and minus each column of the root, `reach` standard deviations out."""
    size = mean.shape[0]
    for j in range(size):
        points[0, j] = mean[j]
    for k in range(size):
        for j in range(size):
            step = reach * root[j, k]
            points[1 + k, j] = mean[j] + step
            points[1 + size + k, j] = mean[j] - step


@njit(cache=True)
def average(
    points: np.ndarray, size: int, weights: np.ndarray, angles: np.ndarray, mean: np.ndarray
) -> None:
    """Weighted mean of points (k, size); angles are averaged on the circle."""
    count = points.shape[0]
    for j in range(size):
        if angles[j]:
            sine = cosine = 0.0
            for k in range(count):
                sine += weights[k] * math.sin(points[k, j])
                cosine += weights[k] * math.cos(points[k, j])
            mean[j] = math.atan2(sine, cosine)
        else:
            total = 0.0
            for k in range(count):
                total += weights[k] * points[k, j]
            mean[j] = total


@njit(cache=True, forceinline=True)
def deviations(
    points: np.ndarray,
    middle: np.ndarray,
    weights: np.ndarray,
    angles: np.ndarray,
    wrap: bool,
    first: int,
    wide: np.ndarray,
    away: np.ndarray,
) -> None:
    """Write the weighted deviations of points from their mean, a column each; that of a negative weight apart.

    Args:
        points: (k, n).
        middle: (n,), their mean.
        weights: (k,), of covariance; only the first may be negative.
        angles: (n,), which entries are angles.
        wrap: Whether to wrap their differences; those of points drawn round the mean need not be.
        first: Row of `wide`, and entry of `away`, of the first entry.
        wide: Written; without the point of negative weight.
        away: Written: the deviation of that point, if there is one.
    """
    plus = 1 if weights[0] < 0.0 else 0
    for k in range(points.shape[0]):
        share = math.sqrt(abs(weights[k]))
        for j in range(points.shape[1]):
            difference = points[k, j] - middle[j]
            if wrap and angles[j]:
                difference = wrapped(difference)
            if k == 0 and plus:
                away[first + j] = share * difference
            else:
                wide[first + j, k - plus] = share * difference


@njit(cache=True)
def predicted(
    points: np.ndarray,
    weights_mean: np.ndarray,
    weights: np.ndarray,
    noise_root: np.ndarray,
    angles: np.ndarray,
    mean: np.ndarray,
    root: np.ndarray,
    wide: np.ndarray,
    away: np.ndarray,
    work: np.ndarray,
) -> bool:
    """Mean and root of moved points and noise; False, and unchanged, if they are not finite.

    Args:
        points: (2 n + 1, n), after the motion.
        weights_mean, weights: (2 n + 1,), of mean and covariance; only the first may be negative.
        noise_root: (n, n), lower.
        angles: (n,), which entries are angles.
        mean, root: (n,) and (n, n), written.
        wide, away, work: (n, 3 n + 1), (2, n) and (n, n), scratch.
    """
    size, count = points.shape[1], points.shape[0]
    fresh = away[1]
    average(points, size, weights_mean, angles, fresh)
    plus = 1 if weights[0] < 0.0 else 0
    deviations(points, fresh, weights, angles, True, 0, wide, away[0])
    for j in range(size):
        for k in range(size):
            wide[j, count - plus + k] = noise_root[j, k]
    lower(wide, size, size, count - plus + size, count - plus + size)
    if plus:
        take_away(wide, size, away[0], work)
    if not all_finite(fresh, wide, size, size):
        return False
    for j in range(size):
        mean[j] = fresh[j]
        for k in range(size):
            root[j, k] = wide[j, k] if k <= j else 0.0
    return True


@njit(cache=True, forceinline=True)
def whiten(
    root: np.ndarray,
    measured: np.ndarray,
    expected: np.ndarray,
    angles: np.ndarray,
    innovation: np.ndarray,
) -> tuple[float, float]:
    """Whiten an innovation by the root of its covariance; returns its squared norm and the log density.

    Args:
        root: At least (m, m), lower; further rows and columns are not read.
        measured, expected: (m,).
        angles: (m,), which entries are angles.
        innovation: (m,), written.
    """
    width = measured.shape[0]
    squared, log_density = 0.0, -0.5 * width * math.log(2.0 * math.pi)
    for j in range(width):
        difference = measured[j] - expected[j]
        if angles[j]:
            difference = wrapped(difference)
        for k in range(j):
            difference -= root[j, k] * innovation[k]
        innovation[j] = difference / root[j, j]
        squared += innovation[j] * innovation[j]
        log_density -= math.log(root[j, j])
    return squared, log_density - 0.5 * squared


@njit(cache=True, forceinline=True)
def move(
    mean: np.ndarray,
    root: np.ndarray,
    innovation: np.ndarray,
    angles: np.ndarray,
    fresh: np.ndarray,
) -> None:
    """The mean after an update.

    Args:
        mean: (n,), before it.
        root: (m + n, at least m), lower, of measurement and state together.
        innovation: (m,), whitened.
        angles: (n,), which entries are angles.
        fresh: (n,) at least, written.
    """
    width = innovation.shape[0]
    for j in range(mean.shape[0]):
        fresh[j] = mean[j]
        for k in range(width):
            fresh[j] += root[width + j, k] * innovation[k]
        if angles[j]:
            fresh[j] = wrapped(fresh[j])


@njit(cache=True)
def corrected(
    points: np.ndarray,
    seen: np.ndarray,
    weights_mean: np.ndarray,
    weights: np.ndarray,
    measured: np.ndarray,
    noise_root: np.ndarray,
    angles: np.ndarray,
    angles_seen: np.ndarray,
    gate: float,
    mean: np.ndarray,
    root: np.ndarray,
    innovation: np.ndarray,
    wide: np.ndarray,
    away: np.ndarray,
    work: np.ndarray,
) -> tuple[int, float]:
    """Update with a measurement; returns (status, log density).

    The status is 1 after an update, 0 if the normalised innovation squared exceeds the gate, -1 if the
    measurement is not finite. Mean and root change only with status 1.

    Args:
        points: (2 n + 1, n), drawn from mean and root.
        seen: (2 n + 1, m), predicted measurement of each.
        weights_mean, weights: (2 n + 1,), of mean and covariance; only the first may be negative.
        measured, noise_root: (m,) and (m, m), lower.
        angles, angles_seen: (n,) and (m,), which entries are angles.
        gate: Largest normalised innovation squared.
        mean, root: (n,) and (n, n), changed.
        innovation: (m,), written: whitened.
        wide, away, work: (m + n, 2 n + 1 + m), (2, m + n) and (m + n, m + n), scratch.
    """
    size, count, width = points.shape[1], points.shape[0], seen.shape[1]
    expected = away[1]
    average(seen, width, weights_mean, angles_seen, expected)
    plus = 1 if weights[0] < 0.0 else 0
    columns = count - plus + width
    deviations(seen, expected, weights, angles_seen, True, 0, wide, away[0])
    deviations(points, mean, weights, angles, False, width, wide, away[0])
    for k in range(width):
        for j in range(width):
            wide[j, count - plus + k] = noise_root[j, k]
        for j in range(size):
            wide[width + j, count - plus + k] = 0.0
    lower(wide, width + size, width + size, columns, columns)
    if plus:
        take_away(wide, width + size, away[0], work)
    squared, log_density = whiten(wide, measured, expected, angles_seen, innovation)
    if not math.isfinite(squared):
        return -1, -math.inf
    if squared > gate:
        return 0, log_density
    fresh = away[0]
    move(mean, wide, innovation, angles, fresh)
    for j in range(size):
        if not math.isfinite(fresh[j]):
            return -1, -math.inf
        for k in range(j + 1):
            if not math.isfinite(wide[width + j, width + k]):
                return -1, -math.inf
    for j in range(size):
        mean[j] = fresh[j]
        for k in range(j + 1):
            root[j, k] = wide[width + j, width + k]
    return 1, log_density


@njit(cache=True)
def all_finite(mean: np.ndarray, root: np.ndarray, size: int, columns: int) -> bool:
    """Whether the first `size` entries and rows are finite."""
    for j in range(size):
        if not math.isfinite(mean[j]):
            return False
        for k in range(columns):
            if not math.isfinite(root[j, k]):
                return False
    return True
