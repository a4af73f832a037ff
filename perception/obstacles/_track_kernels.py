"""Compiled steps of one track: linear prediction and sigma-point update of seven entries.

Means and covariances are changed in place; the matrices are so small that plain loops are fastest. The entries of
a track are x, y, vx, vy of the obstacle, then the error of the viewpoint in x, y, yaw.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..primitives.compiled import njit

SIZE = 7
REACH = math.sqrt(3.0)
"""Distance of a sigma point from the mean in standard deviations; matches the fourth moment of a Gaussian."""

OTHERS = 1.0 / 6.0
"""Weight of every point but the centre, of mean and covariance."""

MIDDLE_MEAN = 1.0 - SIZE / 3.0
MIDDLE = MIDDLE_MEAN + 3.0 - 3.0 / SIZE
"""Weights of the centre: of the mean, of the covariance (alpha^2 = 3 / 7, beta = 2, kappa = 0)."""


class Belief(NamedTuple):
    """Mean (7,) and covariance (7, 7) under one hypothesis."""

    x: np.ndarray
    P: np.ndarray


class Telegraph(NamedTuple):
    """Moments of a velocity that reverses at random: a random telegraph signal.

    Args:
        straight: Probability that it has not reversed.
        seconds: Time passed, s.
        move_s: If it has: mean displacement in units of the first velocity, s.
        keep: If it has: mean velocity in the same units.
        noise_place, noise_both, noise_speed: If it has: covariance of (displacement, velocity).
    """

    straight: float
    seconds: float
    move_s: float
    keep: float
    noise_place: float
    noise_both: float
    noise_speed: float


@njit(cache=True)
def telegraph(seconds: float, every_s: float) -> Telegraph:
    """Moments after some time of a velocity of mean square 1 that reverses every `every_s` on average.

    With a = 2 / every_s, e = exp(-a t) and m = (1 - e) / a, the velocity has mean e and mean square 1, the
    displacement has mean m and mean square 2 (t - m) / a, and their product has mean m. The share
    exp(-t / every_s) without a reversal, displaced by t, is then removed from these moments.

    Source: Papoulis, "Probability, Random Variables and Stochastic Processes" (1965), section 9-2.
    """
    t = max(seconds, 1e-3)  # avoids 0 / 0; the limit is smooth
    a = 2.0 / every_s
    e, m, straight = math.exp(-a * t), -math.expm1(-a * t) / a, math.exp(-t / every_s)
    share = -math.expm1(-t / every_s)
    keep, move = (e - straight) / share, (m - straight * t) / share
    square, product = (2.0 * (t - m) / a - straight * t * t) / share, (m - straight * t) / share
    return Telegraph(
        straight, t, move, keep, square - move * move, product - move * keep, 1.0 - keep * keep
    )


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
def stop(moving: Belief, static: Belief) -> None:
    """Write the static belief: the moving one given a noise-free measurement of v = 0."""
    (x, P), (static_x, static_P) = moving, static
    a, b, d = P[2, 2], 0.5 * (P[2, 3] + P[3, 2]), P[3, 3]
    det = a * d - b * b
    for i in range(SIZE):
        p, q = P[i, 2], P[i, 3]
        g, h = (d * p - b * q) / det, (a * q - b * p) / det
        static_x[i] = x[i] - g * x[2] - h * x[3]
        for j in range(SIZE):
            static_P[i, j] = P[i, j] - g * P[2, j] - h * P[3, j]
    static_x[2] = static_x[3] = 0.0
    for i in range(SIZE):
        static_P[i, 2] = static_P[2, i] = static_P[i, 3] = static_P[3, i] = 0.0


@njit(cache=True)
def flow(belief: Belief, drift: float, speed: float, keep: float) -> None:
    """Position plus drift times velocity; velocity times speed; viewpoint error times keep."""
    x, P = belief
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
    moving: Belief,
    static: Belief,
    stopping: int,
    dt: float,
    keep: float,
    push: float,
    view: np.ndarray,
    widened: float,
) -> None:
    """Predict both hypotheses: constant velocity, and static, where only the viewpoint error changes.

    Args:
        moving, static: Changed.
        stopping: 0: there is no static belief; 1: there is; 2: it starts now.
        dt: s.
        keep: Share of the viewpoint error that remains.
        push: Square of the random acceleration, m^2/s^4.
        view, widened: (3, 3) covariance of the robot pose, and what is added to its position, m^2.
    """
    P, static_P = moving.P, static.P
    if stopping == 2:
        stop(moving, static)
    fresh = 1.0 - keep * keep
    flow(moving, dt, 1.0, keep)
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
        flow(static, 0.0, 1.0, keep)
        for i in range(3):
            for j in range(3):
                static_P[4 + i, 4 + j] += fresh * view[i, j]
        for k in range(2):
            static_P[4 + k, 4 + k] += fresh * widened


@njit(cache=True)
def turn(moving: Belief, seconds: float, every_s: float, turned: Belief) -> float:
    """Write the belief given at least one reversal in the time; returns the probability of none."""
    (x, P), (turned_x, turned_P) = moving, turned
    signal = telegraph(seconds, every_s)
    n00, n01, n11 = signal.noise_place, signal.noise_both, signal.noise_speed
    turned_x[:] = x
    turned_P[:] = P
    flow(turned, signal.move_s - signal.seconds, signal.keep, 1.0)
    for k in range(2):
        for j in range(2):
            power = x[2 + k] * x[2 + j] + P[2 + k, 2 + j]
            turned_P[k, j] += n00 * power
            turned_P[k, 2 + j] += n01 * power
            turned_P[2 + k, j] += n01 * power
            turned_P[2 + k, 2 + j] += n11 * power
    return signal.straight


@njit(cache=True)
def look(
    belief: Belief, robot: np.ndarray, points: np.ndarray, seen: np.ndarray,
    mean: np.ndarray, covariance: np.ndarray,
) -> None:  # fmt: skip
    """Predicted position in the body frame: sigma points, their measurements, mean and covariance of these.

    Args:
        belief: Unchanged.
        robot: (3,), x, y, yaw.
        points, seen: (15, 7) and (15, 2), written.
        mean, covariance: (2,) and (2, 2), written.
    """
    x, P = belief
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
    moving: Belief,
    static: Belief,
    is_static: bool,
    robot: np.ndarray,
    unseen_s: float,
    every_s: float,
    means: np.ndarray,
    covariances: np.ndarray,
) -> float:
    """Predicted measurements: gone straight, turned, static; returns the probability of having gone straight.

    Args:
        moving, static: Unchanged.
        is_static: Whether there is a static belief.
        robot: (3,), x, y, yaw.
        unseen_s, every_s: Time since the last detection, and between reversals on average, s.
        means, covariances: (3, 2) and (3, 2, 2), written.
    """
    points, seen = np.empty((2 * SIZE + 1, SIZE)), np.empty((2 * SIZE + 1, 2))
    turned = Belief(np.empty(SIZE), np.empty((SIZE, SIZE)))
    straight = turn(moving, unseen_s, every_s, turned)
    look(moving, robot, points, seen, means[0], covariances[0])
    look(turned, robot, points, seen, means[1], covariances[1])
    if is_static:
        look(static, robot, points, seen, means[2], covariances[2])
    return straight


@njit(cache=True)
def density(
    weights: np.ndarray, means: np.ndarray, covariances: np.ndarray, fresh: float,
    positions: np.ndarray, noises: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Probability density of each detection, per square metre, under the weighted hypotheses.

    Args:
        weights, means, covariances: (3,), (3, 2) and (3, 2, 2), from `expect`; weight 0: ignored.
        fresh: Added to the variance of the turned hypothesis, m^2.
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
def learn(belief: Belief, robot: np.ndarray, position: np.ndarray, noise: np.ndarray) -> None:
    """Sigma-point update of a belief, in place, by a position (2,) and its covariance (2, 2)."""
    x, P = belief
    points, seen = np.empty((2 * SIZE + 1, SIZE)), np.empty((2 * SIZE + 1, 2))
    mean, S, R, root = np.empty(2), np.empty((2, 2)), noise.copy(), np.empty((2, 2))
    look(belief, robot, points, seen, mean, S)
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


@njit(cache=True)
def mix(
    moving: Belief,
    static: Belief,
    is_static: bool,
    moves: float,
    seconds: float,
    every_s: float,
    mean: np.ndarray,
    covariance: np.ndarray,
) -> None:
    """Mixture of static, gone straight, and turned: mean (4,) and covariance (4, 4), written, of (x, y, vx, vy).

    Args:
        moving, static: The latter is overwritten unless `is_static`.
        is_static: Whether there is a static belief; else it is derived from the moving one.
        moves: Probability of moving.
        seconds, every_s: Time in which it may have reversed, and between reversals on average, s.
    """
    turned = Belief(np.empty(SIZE), np.empty((SIZE, SIZE)))
    straight = turn(moving, seconds, every_s, turned)
    if not is_static:
        stop(moving, static)
    (x, P), (static_x, static_P), (turned_x, turned_P) = moving, static, turned
    a, b, c = 1.0 - moves, moves * straight, moves * (1.0 - straight)
    for i in range(4):
        mean[i] = a * static_x[i] + b * x[i] + c * turned_x[i]
    for i in range(4):
        for j in range(4):
            covariance[i, j] = (
                a * (static_P[i, j] + (static_x[i] - mean[i]) * (static_x[j] - mean[j]))
                + b * (P[i, j] + (x[i] - mean[i]) * (x[j] - mean[j]))
                + c * (turned_P[i, j] + (turned_x[i] - mean[i]) * (turned_x[j] - mean[j]))
            )
    covariance[2, 2] += 1e-8  # keeps the covariance positive
    covariance[3, 3] += 1e-8
    make_positive(covariance, np.empty((4, 4)))
