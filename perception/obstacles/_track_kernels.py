"""Compiled steps of one track: mixing, linear prediction and sigma-point update of one filter for each motion mode.

Means and covariances are changed in place; the matrices are so small that plain loops are fastest. The entries of
a filter are x, y, vx, vy of the obstacle, then the error of the viewpoint in x, y, yaw.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..primitives.compiled import njit

SIZE = 7
MODES = 5
STILL, PAUSING, STRAIGHT, CURVING, TURNED = range(MODES)
"""Modes of motion; see `track`."""

REST = 1e-10
"""Variance of the velocity of a mode that stands, m^2/s^2: keeps its covariance positive."""

LONGEST_STEP_S = 0.5
"""A forecast changes modes at least this often, s."""

REACH = math.sqrt(3.0)
"""Distance of a sigma point from the mean in standard deviations; matches the fourth moment of a Gaussian."""

OTHERS = 1.0 / 6.0
"""Weight of every point but the centre, of mean and covariance."""

MIDDLE_MEAN = 1.0 - SIZE / 3.0
MIDDLE = MIDDLE_MEAN + 3.0 - 3.0 / SIZE
"""Weights of the centre: of the mean, of the covariance (alpha^2 = 3 / 7, beta = 2, kappa = 0)."""


class Belief(NamedTuple):
    """Weights (m,), means (m, 7) and covariances (m, 7, 7) of the modes."""

    w: np.ndarray
    x: np.ndarray
    P: np.ndarray


@njit(cache=True)
def factor(matrix: np.ndarray, root: np.ndarray) -> bool:
    """Lower Cholesky factor of a matrix given by its lower triangle; False if it is not positive definite."""
    for j in range(matrix.shape[0]):
        for i in range(j, matrix.shape[0]):
            total = matrix[i, j]
            for k in range(j):
                total -= root[i, k] * root[j, k]
            if i > j:
                root[i, j] = total / root[j, j]
            elif total > 0.0:
                root[j, j] = math.sqrt(total)
            else:
                return False
        for i in range(j):
            root[i, j] = 0.0
    return True


@njit(cache=True)
def make_positive(matrix: np.ndarray, root: np.ndarray) -> None:
    """`models.positive` in place; the lower factor of the result is written to `root`."""
    size = matrix.shape[0]
    for i in range(size):
        for j in range(i):
            matrix[i, j] = matrix[j, i] = 0.5 * (matrix[i, j] + matrix[j, i])
    if factor(matrix, root):
        return
    values, vectors = np.linalg.eigh(matrix)
    floor = max(values[-1], 1e-12) * 1e-12
    trace = 0.0
    for i in range(size):
        for j in range(i + 1):
            total = 0.0
            for k in range(size):
                total += vectors[i, k] * max(values[k], floor) * vectors[j, k]
            matrix[i, j] = matrix[j, i] = total
        trace += matrix[i, i]
    for i in range(size):
        matrix[i, i] += 1e-12 * max(trace, 1e-12)
    if not factor(matrix, root):
        values, vectors = np.linalg.eigh(matrix)
        for k in range(size):
            for i in range(size):
                root[i, k] = math.sqrt(max(values[k], floor)) * vectors[i, k]


@njit(cache=True)
def merge(
    weights: np.ndarray, x: np.ndarray, P: np.ndarray, mean: np.ndarray, cov: np.ndarray
) -> None:
    """Mean (n,) and covariance (n, n), written, of a mixture of the first n entries of Gaussians; weights sum to 1."""
    size = len(mean)
    mean[:] = 0.0
    cov[:] = 0.0
    for m in range(len(weights)):
        for i in range(size):
            mean[i] += weights[m] * x[m, i]
    for m in range(len(weights)):
        w = weights[m]
        if w > 0.0:
            for i in range(size):
                for j in range(size):
                    away = (x[m, i] - mean[i]) * (x[m, j] - mean[j])
                    cov[i, j] += w * (P[m, i, j] + away)


@njit(cache=True)
def changes(rates: np.ndarray, dt: float) -> np.ndarray:
    """(m, m) probability of each change in a time, s, from the rates (m, m) of a single one, 1/s, from row to column."""
    found = np.zeros_like(rates)
    for i in range(len(rates)):
        total = 0.0
        for j in range(len(rates)):
            total += rates[i, j] if j != i else 0.0
        found[i, i] = math.exp(-total * dt)
        for j in range(len(rates)):
            if j != i and total > 0.0:
                found[i, j] = (1.0 - found[i, i]) * rates[i, j] / total
    return found


@njit(cache=True)
def switch(belief: Belief, chances: np.ndarray, fresh: np.ndarray) -> None:
    """The interacting step: every mode begins from the mixture of those that change into it.

    A mode that stands begins without velocity; `TURNED`, from another mode, with any velocity.

    Args:
        belief: Changed.
        chances: (m, m) probability of each change, from row to column; rows sum to 1.
        fresh: (2, 2) covariance of a new velocity, m^2/s^2.
    """
    w, x, P = belief
    modes, size = x.shape
    before_x, before_P = x.copy(), P.copy()
    after = np.zeros(modes)
    share = np.empty(modes)
    for j in range(modes):
        for i in range(modes):
            share[i] = chances[i, j] * w[i]
            after[j] += share[i]
        if (
            after[j] < 1e-12
        ):  # nothing changes into it that counts: it stays as it was, with that weight
            after[j] = 1e-12
            continue
        own_x, own_P = before_x.copy(), before_P.copy()
        for i in range(modes):
            share[i] /= after[j]
            if j < STRAIGHT or (j == TURNED and i != TURNED):
                for k in range(2, 4):
                    own_x[i, k] = 0.0
                    for j_other in range(size):
                        own_P[i, k, j_other] = own_P[i, j_other, k] = 0.0
                    own_P[i, k, k] = REST
                if j == TURNED:
                    own_P[i, 2:4, 2:4] = fresh
        merge(share, own_x, own_P, x[j], P[j])
    w[:] = after / after.sum()


@njit(cache=True)
def drift(belief: Belief, dt: float, pushes: np.ndarray) -> None:
    """Predict the motion of every mode: constant velocity with white acceleration.

    Args:
        belief: Changed; of at least four entries.
        dt: s.
        pushes: (m,) power density of the acceleration per axis, m^2/s^3.
    """
    size = belief.x.shape[1]
    for m in range(len(belief.w)):
        x, P = belief.x[m], belief.P[m]
        push = pushes[m]
        for k in range(2):
            x[k] += dt * x[2 + k]
            for j in range(size):
                P[k, j] += dt * P[2 + k, j]
            for j in range(size):
                P[j, k] += dt * P[j, 2 + k]
        for k in range(2):
            P[k, k] += push * dt * dt * dt / 3.0
            P[k, 2 + k] += push * dt * dt / 2.0
            P[2 + k, k] += push * dt * dt / 2.0
            P[2 + k, 2 + k] += push * dt


@njit(cache=True)
def go_on(
    belief: Belief, chances: np.ndarray, fresh: np.ndarray, dt: float, pushes: np.ndarray
) -> None:
    """Predict: modes change before and after they drift, as a change may come at any time between two frames.

    Args:
        belief: Changed.
        chances: Of the changes in half of the time, as in `switch`.
        fresh: As in `switch`.
        dt, pushes: As in `drift`.
    """
    switch(belief, chances, fresh)
    drift(belief, dt, pushes)
    switch(belief, chances, fresh)


@njit(cache=True)
def renewal(
    before: np.ndarray, drift: np.ndarray, now: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """What remains of the viewpoint's error from one frame to the next, and the covariance of what is new.

    Since the frame before, it drifted and was then corrected as far as its covariance says. A correction by a Kalman
    filter with gain K leaves the share I - K of the error, which is `now (before + drift)^-1`. Where the covariance
    grew by more than the drift, all of it remains.

    Args:
        before, now: (3, 3) covariances of the error in the frame before and in this one.
        drift: (3,) variances by which it drifted in between.

    Returns:
        keep: (3, 3), error now = keep @ error before + new.
        fresh: (3, 3) covariance of the new part.
    """
    root, inverse = np.empty((3, 3)), np.zeros((3, 3))
    drifted = before + np.diag(drift)
    make_positive(drifted, root)
    for j in range(3):
        for i in range(j, 3):
            total = 1.0 if i == j else 0.0
            for k in range(j, i):
                total -= root[i, k] * inverse[k, j]
            inverse[i, j] = total / root[i, i]
        for i in range(j):
            root[i, j] = 0.0
    values, vectors = np.linalg.eigh(inverse @ now @ inverse.T)
    keep = (root @ vectors * np.minimum(np.maximum(values, 0.0), 1.0)) @ vectors.T @ inverse
    return keep, now - keep @ before @ keep.T


@njit(cache=True)
def look_from(belief: Belief, keep: np.ndarray, fresh: np.ndarray) -> None:
    """Predict the error of the viewpoint in every mode.

    Args:
        belief: Changed.
        keep, fresh: Of `renewal`.
    """
    root = np.empty((SIZE, SIZE))
    for m in range(len(belief.w)):
        x, P = belief.x[m], belief.P[m]
        x[4:] = keep @ np.ascontiguousarray(x[4:])
        P[4:, :] = keep @ np.ascontiguousarray(P[4:, :])
        P[:, 4:] = np.ascontiguousarray(P[:, 4:]) @ keep.T
        P[4:, 4:] += fresh
        make_positive(P, root)


@njit(cache=True)
def forecast(
    belief: Belief, rates: np.ndarray, fresh: np.ndarray, pushes: np.ndarray, times: np.ndarray,
    weights: np.ndarray, means: np.ndarray, covariances: np.ndarray,
) -> None:  # fmt: skip
    """Predicted modes at times (n,), s, ascending from 0, without detections.

    Args:
        belief: Of four entries, unchanged.
        rates: (m, m), 1/s, from row to column.
        fresh: (2, 2) covariance of a new velocity, m^2/s^2.
        pushes: As in `drift`.
        weights, means, covariances: (n, m), (n, m, 4) and (n, m, 4, 4), written.
    """
    now = Belief(belief.w.copy(), belief.x.copy(), belief.P.copy())
    before = 0.0
    for k in range(len(times)):
        parts = math.ceil((times[k] - before) / LONGEST_STEP_S - 1e-9)
        for _ in range(parts):
            dt = (times[k] - before) / parts
            go_on(now, changes(rates, 0.5 * dt), fresh, dt, pushes)
        before = times[k]
        weights[k], means[k], covariances[k] = now.w, now.x, now.P


@njit(cache=True)
def look(
    x: np.ndarray, P: np.ndarray, robot: np.ndarray, points: np.ndarray, seen: np.ndarray,
    mean: np.ndarray, covariance: np.ndarray,
) -> None:  # fmt: skip
    """Predicted position in the body frame: sigma points, their measurements, mean and covariance of these.

    Args:
        x, P: Mean and covariance of one mode, unchanged.
        robot: (3,), x, y, yaw.
        points, seen: (15, 7) and (15, 2), written.
        mean, covariance: (2,) and (2, 2), written.
    """
    work, root = P.copy(), np.empty((SIZE, SIZE))
    make_positive(work, root)
    mean[:] = 0.0
    for k in range(2 * SIZE + 1):
        for j in range(SIZE):
            points[k, j] = x[j]
            if 1 <= k <= SIZE:
                points[k, j] += REACH * root[j, k - 1]
            elif k > SIZE:
                points[k, j] -= REACH * root[j, k - 1 - SIZE]
        dx = points[k, 0] - robot[0] - points[k, 4]
        dy = points[k, 1] - robot[1] - points[k, 5]
        yaw = robot[2] + points[k, 6]
        c, s = math.cos(yaw), math.sin(yaw)
        seen[k, 0], seen[k, 1] = c * dx + s * dy, c * dy - s * dx
        weight = MIDDLE_MEAN if k == 0 else OTHERS
        mean[0] += weight * seen[k, 0]
        mean[1] += weight * seen[k, 1]
    covariance[:] = 0.0
    for k in range(2 * SIZE + 1):
        weight = MIDDLE if k == 0 else OTHERS
        a, b = seen[k, 0] - mean[0], seen[k, 1] - mean[1]
        covariance[0, 0] += weight * a * a
        covariance[0, 1] += weight * a * b
        covariance[1, 1] += weight * b * b
    covariance[1, 0] = covariance[0, 1]


@njit(cache=True)
def expect(belief: Belief, robot: np.ndarray, means: np.ndarray, covariances: np.ndarray) -> None:
    """Predicted measurements of every mode: (m, 2) and (m, 2, 2), written; the robot is at (3,) x, y, yaw."""
    points, seen = np.empty((2 * SIZE + 1, SIZE)), np.empty((2 * SIZE + 1, 2))
    for m in range(len(belief.w)):
        look(belief.x[m], belief.P[m], robot, points, seen, means[m], covariances[m])


@njit(cache=True)
def density(
    weights: np.ndarray, means: np.ndarray, covariances: np.ndarray,
    positions: np.ndarray, noises: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Probability density of each detection, per square metre, under the weighted modes.

    Args:
        weights, means, covariances: (m,), (m, 2) and (m, 2, 2), from `expect`.
        positions, noises: (n, 2) and (n, 2, 2) of the detections.
    """
    found = np.zeros(len(positions))
    for m in range(len(weights)):
        for i in range(len(positions)):
            a = noises[i, 0, 0] + covariances[m, 0, 0]
            b = 0.5 * (noises[i, 0, 1] + noises[i, 1, 0]) + covariances[m, 0, 1]
            d = noises[i, 1, 1] + covariances[m, 1, 1]
            x, y = positions[i, 0] - means[m, 0], positions[i, 1] - means[m, 1]
            det = a * d - b * b
            square = (d * x * x - 2.0 * b * x * y + a * y * y) / det
            found[i] += weights[m] * math.exp(-0.5 * square) / (2.0 * math.pi * math.sqrt(det))
    return found


@njit(cache=True)
def weigh(
    weights: np.ndarray, means: np.ndarray, covariances: np.ndarray,
    position: np.ndarray, noise: np.ndarray, stray: float,
) -> None:  # fmt: skip
    """Multiply the weights (m,) by the densities of a detection, in place; they sum to 1 again.

    Args:
        weights, means, covariances: As in `density`.
        position, noise: (2,) and (2, 2) of the detection.
        stray: Density of stray detections, per square metre, of which 1 % are.
    """
    found = np.empty_like(weights)
    for m in range(len(weights)):
        one = weights[m : m + 1] / weights[m]
        near = density(
            one, means[m : m + 1], covariances[m : m + 1],
            position.reshape((1, 2)), noise.reshape((1, 2, 2)),
        )  # fmt: skip
        found[m] = weights[m] * (0.99 * near[0] + 0.01 * stray)
    weights[:] = found / found.sum()


@njit(cache=True)
def learn(
    x: np.ndarray, P: np.ndarray, robot: np.ndarray, position: np.ndarray, noise: np.ndarray
) -> None:
    """Sigma-point update of one mode, in place, by a position (2,) and its covariance (2, 2)."""
    points, seen = np.empty((2 * SIZE + 1, SIZE)), np.empty((2 * SIZE + 1, 2))
    mean, S, R, root = np.empty(2), np.empty((2, 2)), noise.copy(), np.empty((2, 2))
    look(x, P, robot, points, seen, mean, S)
    make_positive(R, root)
    S += R
    det = S[0, 0] * S[1, 1] - S[0, 1] * S[1, 0]
    gain = np.zeros((SIZE, 2))
    for j in range(SIZE):
        u = v = 0.0
        for k in range(1, 2 * SIZE + 1):  # the centre is the mean
            u += OTHERS * (points[k, j] - x[j]) * (seen[k, 0] - mean[0])
            v += OTHERS * (points[k, j] - x[j]) * (seen[k, 1] - mean[1])
        gain[j, 0] = (u * S[1, 1] - v * S[1, 0]) / det
        gain[j, 1] = (v * S[0, 0] - u * S[0, 1]) / det
    ahead, left = position[0] - mean[0], position[1] - mean[1]
    for j in range(SIZE):
        x[j] += gain[j, 0] * ahead + gain[j, 1] * left
        first = gain[j, 0] * S[0, 0] + gain[j, 1] * S[1, 0]
        second = gain[j, 0] * S[0, 1] + gain[j, 1] * S[1, 1]
        for k in range(SIZE):
            P[j, k] -= first * gain[k, 0] + second * gain[k, 1]
    make_positive(P, np.empty((SIZE, SIZE)))
