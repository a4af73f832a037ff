"""Motion and measurement models of the walking robot, and operations on angles and covariances.

Besides the pose, the state has the systematic errors of dead reckoning, which landmarks make observable: forward slip,
lateral slip and heading drift per step, gyro bias, offset of the head's pan joint, and a common range bias. The last
entry is the turn since the previous frame, which the gyro measures.

Functions that run once per sigma point have their shapes in words: a run-time check of shapes would take ten times as
long as they do.

Source: Yoo and Kim 2010 (seed 001), section 3 (sigma-point filter); slip and drift as states are ours.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from ..primitives.pose import Pose2, wrap_angle

X, Y, YAW, SLIP, LATERAL_SLIP, DRIFT, GYRO_BIAS, PAN, RANGE, TURN = range(10)
"""Entries of the state: m, m, rad, m per step, m per step, rad per step, rad/s, rad, 1, rad.

RANGE is the common range bias in standard deviations of each range, for example of tags printed too small.
"""

WALKER_SIZE = 10


def walk(state: np.ndarray, dt: float, motion: Pose2, steps: float) -> np.ndarray:
    """State after the motion measured by step odometry.

    Args:
        state: (10,), see the entries above.
        dt: Time passed, s; unused, part of the filter's interface.
        motion: Body frame now in the previous body frame, by step odometry.
        steps: Footsteps made, such as 0.5.

    Returns:
        Next state; forward slip, lateral slip and drift are added in proportion to the steps.
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
    """Predicted gyro measurement, integrated over dt seconds, of a state (10,): (1,), rad."""
    return state[TURN : TURN + 1] + state[GYRO_BIAS] * dt


def range_bearing(state: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Range and bearing of known positions.

    Args:
        state: (n,), starts with (x, y, yaw), m and rad, world frame.
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
    """Predicted measurement of known positions: `range_bearing` with pan offset and range bias.

    Args:
        state: (10,), see the entries above.
        places: (k, 2), world frame, m.
        sigmas: (k,), standard deviation of each range, m.

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
    """Weighted mean of directions (k, ...) along the first axis, weights (k,); rad in [-pi, pi]."""
    return np.asarray(np.arctan2(weights @ np.sin(angles_rad), weights @ np.cos(angles_rad)))


def walker_mean(
    points: Float[np.ndarray, "k 10"], weights: Float[np.ndarray, "k"]
) -> Float[np.ndarray, "10"]:
    """Mean of sigma points; the yaw is averaged on the circle."""
    mean = weights @ points
    mean[YAW] = circular_mean(points[:, YAW], weights)
    return mean


def walker_difference(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a - b of states (10,), the yaw wrapped."""
    difference = a - b
    difference[YAW] = (difference[YAW] + math.pi) % (2.0 * math.pi) - math.pi
    return difference


def walker_sum(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a + b of states (10,), the yaw wrapped."""
    total = a + b
    total[YAW] = wrap_angle(total[YAW])
    return total


def sighting_mean(
    points: Float[np.ndarray, "k m"], weights: Float[np.ndarray, "k"]
) -> Float[np.ndarray, "m"]:
    """Mean of (range, bearing, ...); bearings are averaged on the circle."""
    mean = weights @ points
    mean[1::2] = circular_mean(points[:, 1::2], weights)
    return mean


def sighting_difference(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a - b of (range, bearing, ...), the bearings wrapped."""
    difference = a - b
    difference[1::2] = (difference[1::2] + math.pi) % (2.0 * math.pi) - math.pi
    return difference


def spread(size: int) -> float:
    """alpha of the scaled unscented transform (with beta 2, kappa 0) for a state of this size.

    The points lie sqrt(3) standard deviations out, which matches the fourth moment of a Gaussian. No weight of the
    covariance is negative, so a predicted covariance stays positive definite.
    """
    return math.sqrt(3.0 / size)


def symmetric(matrix: Float[np.ndarray, "n n"]) -> Float[np.ndarray, "n n"]:
    """The nearest symmetric matrix."""
    return (matrix + matrix.T) / 2.0


def square_root(matrix: Float[np.ndarray, "n n"]) -> Float[np.ndarray, "n n"]:
    """U with U.T @ U = matrix, for any symmetric matrix; negative eigenvalues become slightly positive.

    Cholesky, or eigenvalues where rounding has left the matrix not positive definite.
    """
    matrix = symmetric(matrix)
    try:
        return np.asarray(np.linalg.cholesky(matrix).T)
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(matrix)
        floor = max(float(values[-1]), 1e-12) * 1e-12
        return np.asarray(np.sqrt(np.maximum(values, floor))[:, None] * vectors.T)


def positive(matrix: Float[np.ndarray, "n n"]) -> Float[np.ndarray, "n n"]:
    """The matrix, symmetric, and positive definite even after rounding errors."""
    matrix = symmetric(matrix)
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        root = square_root(matrix)
        matrix = symmetric(root.T @ root)
        matrix += np.eye(len(matrix)) * (1e-12 * max(float(np.trace(matrix)), 1e-12))
    return matrix
