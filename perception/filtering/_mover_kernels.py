"""Compiled step of many moving obstacles, each a constant-velocity square-root sigma-point filter."""

from __future__ import annotations

import math

import numpy as np

from ..primitives.compiled import njit
from ._square_root_kernels import all_finite, corrected, draw, lower, root_of, wrapped


@njit(cache=True)
def coast(
    mean: np.ndarray, root: np.ndarray, dt: float, noise_root: np.ndarray, wide: np.ndarray
) -> bool:
    """Constant-velocity prediction of (x, y, vx, vy); it is linear, so it acts on the root itself.

    Sigma points would give the same result in three times the time.
    """
    for k in range(4):
        wide[0, k] = root[0, k] + dt * root[2, k]
        wide[1, k] = root[1, k] + dt * root[3, k]
        wide[2, k], wide[3, k] = root[2, k], root[3, k]
        for j in range(4):
            wide[j, 4 + k] = noise_root[j, k]
    lower(wide, 4, 4, 8, 5)
    x, y = mean[0] + dt * mean[2], mean[1] + dt * mean[3]
    if not (math.isfinite(x) and math.isfinite(y) and all_finite(mean, wide, 4, 4)):
        return False
    mean[0], mean[1] = x, y
    for j in range(4):
        for k in range(j + 1):
            root[j, k] = wide[j, k]
    return True


@njit(cache=True)
def see_position(
    mean: np.ndarray,
    root: np.ndarray,
    measured: np.ndarray,
    noise_root: np.ndarray,
    wide: np.ndarray,
) -> int:
    """Update by a measured position (2,), and return the status as in `corrected`; linear, so it acts on the root itself.

    The columns of the root that belong to the velocity alone do not change.

    Args:
        mean, root: (4,) and (4, 4), changed.
        measured, noise_root: (2,) and (2, 2), lower.
        wide: (6, 4), scratch.
    """
    for k in range(2):
        for j in range(2):
            wide[j, k] = noise_root[j, k]
            wide[j, 2 + k] = root[j, k]
        for j in range(4):
            wide[2 + j, k] = 0.0
            wide[2 + j, 2 + k] = root[j, k]
    lower(wide, 4, 6, 4, 4)
    ahead = (measured[0] - mean[0]) / wide[0, 0]
    left = (measured[1] - mean[1] - wide[1, 0] * ahead) / wide[1, 1]
    total = ahead * ahead + left * left
    for j in range(6):
        for k in range(4):
            total += abs(wide[j, k])
    if not math.isfinite(total):
        return -1
    for j in range(4):
        mean[j] += wide[2 + j, 0] * ahead + wide[2 + j, 1] * left
        for k in range(min(j + 1, 2)):
            root[j, k] = wide[2 + j, 2 + k]
    return 1


@njit(cache=True)
def step_movers(
    means: np.ndarray,
    roots: np.ndarray,
    dt: float,
    noise: np.ndarray,
    measured: np.ndarray,
    measured_noise: np.ndarray,
    viewpoint: np.ndarray,
    polar: bool,
    sigma_points: tuple[float, np.ndarray, np.ndarray],
) -> np.ndarray:
    """Predict all moving obstacles and update each with one position; returns the status of each as in `corrected`.

    Args:
        means, roots: (k, 4) and (k, 4, 4), changed: x, y, vx, vy.
        dt: Time passed, s.
        noise: (4, 4), covariance added in that time.
        measured, measured_noise: (k, 2) and (k, 2, 2); NaN where there is no detection.
        viewpoint: (3,), x, y, yaw; used if polar.
        polar: Whether range and bearing are measured, else x and y.
        sigma_points: `SigmaPoints`: reach, weights of mean and covariance.
    """
    count = means.shape[0]
    status = np.full(count, -1, np.int8)
    points, seen, wide = np.empty((9, 4)), np.empty((9, 2)), np.empty((6, 13))
    away, work, noise_root = np.empty((2, 6)), np.empty((6, 6)), np.empty((4, 4))
    seen_root, innovation, angles = np.zeros((2, 2)), np.empty(2), np.zeros(6, np.bool_)
    angles[5], narrow = True, np.empty((6, 4))
    reach, weights_mean, weights = sigma_points
    if not root_of(noise, 4, noise_root):
        return status
    for i in range(count):
        mean, root = means[i], roots[i]
        if not coast(mean, root, dt, noise_root, wide):
            continue
        if not root_of(measured_noise[i], 2, seen_root):
            continue
        if not polar:
            status[i] = see_position(mean, root, measured[i], seen_root, narrow)
            continue
        draw(mean, root, reach, points)
        for k in range(9):
            x, y = points[k, 0] - viewpoint[0], points[k, 1] - viewpoint[1]
            seen[k, 0] = math.hypot(x, y)
            seen[k, 1] = wrapped(math.atan2(y, x) - viewpoint[2])
        status[i], _ = corrected(
            points,
            seen,
            weights_mean,
            weights,
            measured[i],
            seen_root,
            angles[:4],
            angles[4:],
            math.inf,
            mean,
            root,
            innovation,
            wide,
            away,
            work,
        )
    return status
