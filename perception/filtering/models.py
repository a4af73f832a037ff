"""What the sigma-point filters believe of the world: how a walker moves, what its sensors say.

The walker's state holds, beside its pose, what spoils dead reckoning systematically, so that landmarks
teach it: the slip forward, the slip to the left (legs whose joints are off by tenths of a degree walk like a
crab) and the turn that every step adds, the bias of the gyro, the angle by which the head's pan joint sits askew, and
what all ranges have in common. The last entry is the turn made since the frame before; it lets the gyro be what
it is, a measurement of that turn.

Here are also the few operations that a filter over angles needs: mean and difference on the circle, and
a matrix square root that cannot fail. Functions that run once per sigma point tell their shapes in words:
a check of shapes at run time would cost ten times what they do.

Source: seed 001, section 3 (sigma-point filter); slip, crab and drift as states are ours.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from ..primitives.pose import Pose2, wrap_angle

X, Y, YAW, SLIP, LATERAL_SLIP, DRIFT, GYRO_BIAS, PAN, RANGE, TURN = range(10)
"""Entries of the walker's state: m, m, rad, m per step, m per step, rad per step, rad/s, rad, 1, rad.

RANGE is by how many of their own deviations all ranges are too long alike: a lens, a printer or a renderer
that makes every tag a little smaller.
"""

WALKER_SIZE = 10


def walk(state: np.ndarray, dt: float, motion: Pose2, steps: float) -> np.ndarray:
    """The walker after the motion that its joints report.

    Args:
        state: (10,), see the entries above.
        dt: Time passed, s; unused, the filter hands it over.
        motion: Body now in the body frame before, by step odometry.
        steps: How much of a footstep it was.

    Returns:
        The state after it; slip, crab and drift are added in proportion to the steps made.
    """
    ahead, left = motion.x + state[SLIP] * steps, motion.y + state[LATERAL_SLIP] * steps
    turn = motion.yaw + state[DRIFT] * steps
    c, s = math.cos(state[YAW]), math.sin(state[YAW])
    after = state.copy()
    after[X] += c * ahead - s * left
    after[Y] += s * ahead + c * left
    after[YAW] = wrap_angle(state[YAW] + turn)
    after[TURN] = turn
    return after


def gyro_turn(state: np.ndarray, dt: float) -> np.ndarray:
    """What the gyro, summed over dt seconds, says of the turn just made in a state (10,): (1,), rad."""
    return state[TURN : TURN + 1] + state[GYRO_BIAS] * dt


def range_bearing(state: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Where known places are seen from the walker's pose.

    Args:
        state: (n,), starts with (x, y, yaw) of the walker, m and rad, world frame.
        places: (k, 2), world frame, m.

    Returns:
        (2 k,), range_1, bearing_1, range_2, ..., m and rad, left positive.
    """
    offset = places - state[:2]
    seen = np.empty(2 * len(places))
    seen[0::2] = np.hypot(offset[:, 0], offset[:, 1])
    seen[1::2] = wrap_angles(np.arctan2(offset[:, 1], offset[:, 0]) - state[YAW])
    return seen


def sighted(state: np.ndarray, places: np.ndarray, sigmas: np.ndarray) -> np.ndarray:
    """What a walker sees of places: `range_bearing`, through a head askew and a lens not quite right.

    Args:
        state: (10,), see the entries above.
        places: (k, 2), world frame, m.
        sigmas: (k,), deviation claimed for each range, m.

    Returns:
        (2 k,), range_1, bearing_1, range_2, ..., m and rad, left positive.
    """
    seen = range_bearing(state, places)
    seen[0::2] += state[RANGE] * sigmas
    seen[1::2] += state[PAN]
    return seen


def wrap_angles(angles_rad: np.ndarray) -> np.ndarray:
    """The same angles in [-pi, pi), of any shape."""
    return np.asarray((angles_rad + math.pi) % (2.0 * math.pi) - math.pi)


def circular_mean(angles_rad: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Mean of directions (k, ...) by weights (k,) along the first axis, rad in [-pi, pi]."""
    return np.asarray(np.arctan2(weights @ np.sin(angles_rad), weights @ np.cos(angles_rad)))


def walker_mean(
    points: Float[np.ndarray, "k 10"], weights: Float[np.ndarray, "k"]
) -> Float[np.ndarray, "10"]:
    """Mean of sigma points of the walker, its yaw averaged on the circle."""
    mean = weights @ points
    mean[YAW] = circular_mean(points[:, YAW], weights)
    return mean


def walker_difference(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a - b of states (10,), the yaw the short way round."""
    difference = a - b
    difference[YAW] = (difference[YAW] + math.pi) % (2.0 * math.pi) - math.pi
    return difference


def walker_sum(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a + b of states (10,), the yaw in [-pi, pi)."""
    total = a + b
    total[YAW] = wrap_angle(total[YAW])
    return total


def sighting_mean(
    points: Float[np.ndarray, "k m"], weights: Float[np.ndarray, "k"]
) -> Float[np.ndarray, "m"]:
    """Mean of (range, bearing, range, bearing, ...), the bearings averaged on the circle."""
    mean = weights @ points
    mean[1::2] = circular_mean(points[:, 1::2], weights)
    return mean


def sighting_difference(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a - b of (range, bearing, ...), the bearings the short way round."""
    difference = a - b
    difference[1::2] = (difference[1::2] + math.pi) % (2.0 * math.pi) - math.pi
    return difference


def spread(size: int) -> float:
    """alpha of the scaled unscented transform (with beta 2, kappa 0) for a state of this size.

    The points lie sqrt(3) deviations out, where a Gaussian has its fourth moment; no weight of the
    covariance is negative, so that a predicted covariance cannot lose its positivity.
    """
    return math.sqrt(3.0 / size)


def symmetric(matrix: Float[np.ndarray, "n n"]) -> Float[np.ndarray, "n n"]:
    """The nearest symmetric matrix."""
    return (matrix + matrix.T) / 2.0


def square_root(matrix: Float[np.ndarray, "n n"]) -> Float[np.ndarray, "n n"]:
    """U with U.T @ U = matrix, for any symmetric matrix; what is not positive in it is lifted to just above 0.

    Cholesky where that works, else by eigenvalues: rounding can cost a covariance its last digit of
    positivity, and a filter must not fall over that.
    """
    matrix = symmetric(matrix)
    try:
        return np.asarray(np.linalg.cholesky(matrix).T)
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(matrix)
        floor = max(float(values[-1]), 1e-12) * 1e-12
        return np.asarray(np.sqrt(np.maximum(values, floor))[:, None] * vectors.T)


def positive(matrix: Float[np.ndarray, "n n"]) -> Float[np.ndarray, "n n"]:
    """The matrix, symmetric, and positive definite even if rounding had taken that away."""
    matrix = symmetric(matrix)
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        root = square_root(matrix)
        matrix = symmetric(root.T @ root)
        matrix += np.eye(len(matrix)) * (1e-12 * max(float(np.trace(matrix)), 1e-12))
    return matrix
