"""Compiled steps of one track: seven entries, moved on by matrices, seen through sigma points.

State and covariance are changed in place; matrices are so small that plain loops are fastest. A track's
entries are x, y, vx, vy, and the error of the viewpoint in x, y, yaw.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

SIZE = 7
REACH = math.sqrt(3.0)
"""Deviations from the mean to a sigma point: a Gaussian has its fourth moment there."""

OTHERS = 1.0 / 6.0
"""Weight of every point but the middle one, of the mean and of the covariance."""

MIDDLE_MEAN = 1.0 - SIZE / 3.0
MIDDLE = MIDDLE_MEAN + 3.0 - 3.0 / SIZE
"""Weights of the middle point: of the mean, of the covariance (alpha^2 = 3 / 7, beta = 2, kappa = 0)."""


@njit(cache=True)
def telegraph(
    seconds: float, every_s: float
) -> tuple[float, float, float, float, float, float, float]:
    """Moments of a speed that flips its sign, as `turning` tells them: straight, seconds, move, keep, noise.

    The noise is its three entries: of the place, of both, of the velocity.
    """
    t = max(seconds, 1e-3)  # the limit for no time is smooth, its quotients are not
    a = 2.0 / every_s
    e, m, straight = math.exp(-a * t), -math.expm1(-a * t) / a, math.exp(-t / every_s)
    share = -math.expm1(-t / every_s)
    keep, move = (e - straight) / share, (m - straight * t) / share
    square, product = (2.0 * (t - m) / a - straight * t * t) / share, (m - straight * t) / share
    return straight, t, move, keep, square - move * move, product - move * keep, 1.0 - keep * keep


@njit(cache=True)
def factor(matrix: np.ndarray, root: np.ndarray) -> bool:
    """Cholesky's lower factor, of the lower triangle; False if the matrix is not positive definite."""
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
    """As `models.positive`, in place; the lower factor of the result is written to `root`."""
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
def stop(x: np.ndarray, P: np.ndarray, still_x: np.ndarray, still_P: np.ndarray) -> None:
    """The state if the thing stands: after a sighting v = 0 without noise."""
    a, b, d = P[2, 2], 0.5 * (P[2, 3] + P[3, 2]), P[3, 3]
    det = a * d - b * b
    for i in range(SIZE):
        p, q = P[i, 2], P[i, 3]
        g, h = (d * p - b * q) / det, (a * q - b * p) / det
        still_x[i] = x[i] - g * x[2] - h * x[3]
        for j in range(SIZE):
            still_P[i, j] = P[i, j] - g * P[2, j] - h * P[3, j]
    still_x[2] = still_x[3] = 0.0
    for i in range(SIZE):
        still_P[i, 2] = still_P[2, i] = still_P[i, 3] = still_P[3, i] = 0.0


@njit(cache=True)
def flow(x: np.ndarray, P: np.ndarray, drift: float, speed: float, keep: float) -> None:
    """Place plus drift times velocity; velocity times speed; viewpoint times keep: mean and covariance."""
    for k in range(2):
        x[k] += drift * x[2 + k]
        x[2 + k] *= speed
        for j in range(SIZE):
            P[k, j] += drift * P[2 + k, j]
            P[2 + k, j] *= speed
        for j in range(SIZE):
            P[j, k] += drift * P[j, 2 + k]
            P[j, 2 + k] *= speed
    for k in range(4, SIZE):
        x[k] *= keep
        for j in range(SIZE):
            P[k, j] *= keep
        for j in range(SIZE):
            P[j, k] *= keep


@njit(cache=True)
def move_on(
    x: np.ndarray,
    P: np.ndarray,
    still_x: np.ndarray,
    still_P: np.ndarray,
    stopping: int,
    dt: float,
    keep: float,
    push: float,
    view: np.ndarray,
    widened: float,
) -> None:
    """Straight on for dt seconds; beside it what stands, whose viewpoint alone wanders.

    Args:
        x, P: (7,) and (7, 7), changed.
        still_x, still_P: The same if it stands, changed.
        stopping: 0: there is no such state; 1: there is; 2: it begins now.
        dt: s.
        keep: Of the viewpoint's error.
        push: Square of the random acceleration, m^2/s^4.
        view, widened: (3, 3) of the robot's pose, and what is added to its place, m^2.
    """
    if stopping == 2:
        stop(x, P, still_x, still_P)
    fresh = 1.0 - keep * keep
    flow(x, P, dt, 1.0, keep)
    for i in range(3):
        for j in range(3):
            P[4 + i, 4 + j] += fresh * view[i, j]
    for k in range(2):
        P[4 + k, 4 + k] += fresh * widened
        P[k, k] += 0.25 * dt**4 * push
        P[k, 2 + k] += 0.5 * dt**3 * push
        P[2 + k, k] += 0.5 * dt**3 * push
        P[2 + k, 2 + k] += dt * dt * push
    make_positive(P, np.empty((SIZE, SIZE)))
    if stopping > 0:
        flow(still_x, still_P, 0.0, 1.0, keep)
        for i in range(3):
            for j in range(3):
                still_P[4 + i, 4 + j] += fresh * view[i, j]
        for k in range(2):
            still_P[4 + k, 4 + k] += fresh * widened


@njit(cache=True)
def turn(
    x: np.ndarray, P: np.ndarray, seconds: float, every_s: float, turned_x: np.ndarray,
    turned_P: np.ndarray,
) -> float:  # fmt: skip
    """The state if it turned within the last seconds, written; returns the probability that it did not."""
    straight, t, move, keep, n00, n01, n11 = telegraph(seconds, every_s)
    turned_x[:] = x
    turned_P[:] = P
    flow(turned_x, turned_P, move - t, keep, 1.0)
    for k in range(2):
        for j in range(2):
            power = x[2 + k] * x[2 + j] + P[2 + k, 2 + j]
            turned_P[k, j] += n00 * power
            turned_P[k, 2 + j] += n01 * power
            turned_P[2 + k, j] += n01 * power
            turned_P[2 + k, 2 + j] += n11 * power
    return straight


@njit(cache=True)
def look(
    x: np.ndarray, P: np.ndarray, robot: np.ndarray, points: np.ndarray, seen: np.ndarray,
    mean: np.ndarray, covariance: np.ndarray,
) -> None:  # fmt: skip
    """Where the thing should be seen from the body: sigma points, what they see, and the moments of that.

    Args:
        x, P: (7,) and (7, 7).
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
def expect(
    x: np.ndarray,
    P: np.ndarray,
    still_x: np.ndarray,
    still_P: np.ndarray,
    stands: bool,
    robot: np.ndarray,
    unseen_s: float,
    every_s: float,
    means: np.ndarray,
    covariances: np.ndarray,
) -> float:
    """Where it should be seen: gone straight on, turned, standing; returns the probability of straight on.

    Args:
        x, P, still_x, still_P: As for `move_on`.
        stands: Whether there is a standing state.
        robot: (3,).
        unseen_s, every_s: Time since it was seen, and between turns on average, s.
        means, covariances: (3, 2) and (3, 2, 2), written.
    """
    points, seen = np.empty((2 * SIZE + 1, SIZE)), np.empty((2 * SIZE + 1, 2))
    turned_x, turned_P = np.empty(SIZE), np.empty((SIZE, SIZE))
    straight = turn(x, P, unseen_s, every_s, turned_x, turned_P)
    look(x, P, robot, points, seen, means[0], covariances[0])
    look(turned_x, turned_P, robot, points, seen, means[1], covariances[1])
    if stands:
        look(still_x, still_P, robot, points, seen, means[2], covariances[2])
    return straight


@njit(cache=True)
def density(
    weights: np.ndarray, means: np.ndarray, covariances: np.ndarray, fresh: float,
    positions: np.ndarray, noises: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """How likely each detection is, per square metre, under all hypotheses by their weights.

    Args:
        weights, means, covariances: (3,), (3, 2) and (3, 2, 2), as from `expect`; weight 0: left out.
        fresh: Added to the variance of what turned, m^2.
        positions, noises: (n, 2) and (n, 2, 2) of the detections.
    """
    found = np.zeros(len(positions))
    for h in range(3):
        if weights[h] <= 0.0:
            continue
        wide = fresh if h == 1 else 0.0
        for i in range(len(positions)):
            a = noises[i, 0, 0] + covariances[h, 0, 0] + wide
            b = 0.5 * (noises[i, 0, 1] + noises[i, 1, 0]) + covariances[h, 0, 1]
            d = noises[i, 1, 1] + covariances[h, 1, 1] + wide
            x, y = positions[i, 0] - means[h, 0], positions[i, 1] - means[h, 1]
            det = a * d - b * b
            square = (d * x * x - 2.0 * b * x * y + a * y * y) / det
            found[i] += weights[h] * math.exp(-0.5 * square) / (2.0 * math.pi * math.sqrt(det))
    return found


@njit(cache=True)
def learn(
    x: np.ndarray, P: np.ndarray, robot: np.ndarray, position: np.ndarray, noise: np.ndarray
) -> None:
    """The sigma-point update of x (7,) and P (7, 7), in place, by a position (2,) and its noise (2, 2)."""
    points, seen = np.empty((2 * SIZE + 1, SIZE)), np.empty((2 * SIZE + 1, 2))
    mean, S, R, root = np.empty(2), np.empty((2, 2)), noise.copy(), np.empty((2, 2))
    look(x, P, robot, points, seen, mean, S)
    make_positive(R, root)
    S += R
    det = S[0, 0] * S[1, 1] - S[0, 1] * S[1, 0]
    gain = np.zeros((SIZE, 2))
    for j in range(SIZE):
        u = v = 0.0
        for k in range(1, 2 * SIZE + 1):  # the middle point lies at the mean
            u += OTHERS * (points[k, j] - x[j]) * (seen[k, 0] - mean[0])
            v += OTHERS * (points[k, j] - x[j]) * (seen[k, 1] - mean[1])
        gain[j, 0] = (u * S[1, 1] - v * S[1, 0]) / det
        gain[j, 1] = (v * S[0, 0] - u * S[0, 1]) / det
    away, aside = position[0] - mean[0], position[1] - mean[1]
    for j in range(SIZE):
        x[j] += gain[j, 0] * away + gain[j, 1] * aside
        first = gain[j, 0] * S[0, 0] + gain[j, 1] * S[1, 0]
        second = gain[j, 0] * S[0, 1] + gain[j, 1] * S[1, 1]
        for k in range(SIZE):
            P[j, k] -= first * gain[k, 0] + second * gain[k, 1]
    make_positive(P, np.empty((SIZE, SIZE)))


@njit(cache=True)
def mix(
    x: np.ndarray,
    P: np.ndarray,
    still_x: np.ndarray,
    still_P: np.ndarray,
    stands: bool,
    moves: float,
    seconds: float,
    every_s: float,
    mean: np.ndarray,
    covariance: np.ndarray,
) -> None:
    """Standing, gone straight on, turned: one mean (4,) and covariance (4, 4), written, of (x, y, vx, vy).

    Args:
        x, P, still_x, still_P: As for `move_on`; the last two are overwritten unless it `stands`.
        stands: Whether there is a standing state; else it is taken from the moving one.
        moves: Probability.
        seconds, every_s: Within which it may have turned, and between turns on average, s.
    """
    turned_x, turned_P = np.empty(SIZE), np.empty((SIZE, SIZE))
    straight = turn(x, P, seconds, every_s, turned_x, turned_P)
    if not stands:
        stop(x, P, still_x, still_P)
    a, b, c = 1.0 - moves, moves * straight, moves * (1.0 - straight)
    for i in range(4):
        mean[i] = a * still_x[i] + b * x[i] + c * turned_x[i]
    for i in range(4):
        for j in range(4):
            covariance[i, j] = (
                a * (still_P[i, j] + (still_x[i] - mean[i]) * (still_x[j] - mean[j]))
                + b * (P[i, j] + (x[i] - mean[i]) * (x[j] - mean[j]))
                + c * (turned_P[i, j] + (turned_x[i] - mean[i]) * (turned_x[j] - mean[j]))
            )
    covariance[2, 2] += 1e-8  # nothing stands quite still
    covariance[3, 3] += 1e-8
    make_positive(covariance, np.empty((4, 4)))
