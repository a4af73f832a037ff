"""Compiled loops of the collision test: bands of colliding speeds, their widening, the nearest approach.

All in O_R. Positions and velocities are (2,), a covariance is (4, 4) over (x, y, vx, vy); a band is its two bounds,
(NaN, NaN) if no speed collides.
"""

from __future__ import annotations

import math

import numpy as np

from perception.primitives.compiled import njit

NONE = (math.nan, math.nan)
ROUNDS = 4  # iterations for a root whose radius depends on it, to below a millimetre


@njit(cache=True)
def colliding_speeds(place: np.ndarray, velocity: np.ndarray, radius: float) -> tuple[float, float]:
    """The band between the roots of the quadratic."""
    px, py, vx, vy = place[0], place[1], velocity[0], velocity[1]
    D = px * px + py * py - radius * radius
    if D <= 0.0:
        return -np.inf, np.inf
    pv = px * vx + py * vy
    a = px * px - D
    b = -2.0 * px * pv + 2.0 * D * vx
    c = pv * pv - D * (vx * vx + vy * vy)
    if abs(a) < 1e-12:  # the path touches the disc: one root goes to infinity
        if abs(b) <= 1e-12 or (b > 0.0) != (px > 0.0):
            return NONE
        return (-c / b, np.inf) if b > 0.0 else (-np.inf, -c / b)
    square = b * b - 4.0 * a * c
    if square < 0.0 and a < 0.0:
        return NONE
    root = math.sqrt(max(square, 0.0))  # if the path crosses the disc it is not negative
    one, other = (-b - root) / (2.0 * a), (-b + root) / (2.0 * a)
    first, second = min(one, other), max(one, other)
    if (
        a > 0.0
    ):  # the path crosses the disc: every speed above the root, or below it if the disc is behind
        return (second, np.inf) if px > 0.0 else (-np.inf, first)
    middle = (first + second) / 2.0
    return (first, second) if px * middle > pv else NONE  # p.w > 0


@njit(cache=True)
def contact(place: np.ndarray, velocity: np.ndarray, speed: float) -> float:
    """Time of the nearest approach; 0 without relative motion."""
    wx, wy = speed - velocity[0], -velocity[1]
    square = wx * wx + wy * wy
    return (place[0] * wx + place[1] * wy) / square if square > 0.0 else 0.0


@njit(cache=True)
def miss_deviation(
    place: np.ndarray, velocity: np.ndarray, covariance: np.ndarray, speed: float, horizon_s: float
) -> float:
    """Standard deviation of the relative position across the relative motion, at the nearest approach."""
    wx, wy = speed - velocity[0], -velocity[1]
    size = math.hypot(wx, wy)
    if size < 1e-9:
        away = max(math.hypot(place[0], place[1]), 1e-9)
        nx, ny = place[0] / away, place[1] / away
    else:
        nx, ny = -wy / size, wx / size
    t = min(max(contact(place, velocity, speed), 0.0), horizon_s)
    row = (nx, ny, t * nx, t * ny)
    square = 0.0
    for i in range(4):
        for j in range(4):
            square += row[i] * covariance[i, j] * row[j]
    return math.sqrt(max(square, 0.0))


@njit(cache=True)
def nearest_speed(place: np.ndarray, velocity: np.ndarray) -> float:
    """The speed whose relative velocity points at the obstacle; the x velocity of the obstacle if there is none."""
    if abs(place[1]) <= 1e-9:
        return velocity[0]
    return velocity[0] - velocity[1] * place[0] / place[1]


@njit(cache=True)
def widened_band(
    place: np.ndarray,
    velocity: np.ndarray,
    radius: float,
    covariance: np.ndarray,
    sigmas: float,
    max_sigma: float,
    horizon_s: float,
) -> tuple[float, float]:
    """The band widened at both ends by the standard deviations there."""

    def widened(speed: float) -> tuple[float, float]:
        sigma = miss_deviation(place, velocity, covariance, speed, horizon_s)
        return colliding_speeds(place, velocity, radius + sigmas * min(sigma, max_sigma))

    band = colliding_speeds(place, velocity, radius)
    start = band
    if math.isnan(band[0]):  # the enlarged disc may collide: start at the speed that comes nearest
        start = widened(nearest_speed(place, velocity))
    low, high = start
    for _ in range(ROUNDS):
        wider = widened(low) if math.isfinite(low) else NONE
        if math.isnan(wider[0]):
            break
        low = wider[0]
    for _ in range(ROUNDS):
        wider = widened(high) if math.isfinite(high) else NONE
        if math.isnan(wider[0]):
            break
        high = wider[1]
    return (low, high) if low < high else band


@njit(cache=True)
def travelled(speed: float, acceleration: float, bound: float, time: float) -> float:
    """Distance at a time: constant acceleration until the bound is reached, then constant speed."""
    if acceleration == 0.0 or speed == bound:
        return speed * time
    changing = max((bound - speed) / acceleration, 0.0)
    early, rest = min(time, changing), max(time - changing, 0.0)
    return speed * early + 0.5 * acceleration * (early * early) + bound * rest


@njit(cache=True)
def least_distance(
    place: np.ndarray,
    velocity: np.ndarray,
    speed: float,
    acceleration: float,
    bound: float,
    horizon_s: float,
    samples: int,
) -> float:
    """Least distance over equally spaced samples up to the horizon."""
    least = np.inf
    for k in range(samples):
        time = horizon_s if k == samples - 1 else k * (horizon_s / (samples - 1))
        x = place[0] + velocity[0] * time - travelled(speed, acceleration, bound, time)
        least = min(least, math.hypot(x, place[1] + velocity[1] * time))
    return least
