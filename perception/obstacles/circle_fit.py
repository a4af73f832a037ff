"""Circle fit: centre and radius of a round obstacle of which only a part is in view.

An obstacle close to the camera exceeds its field of view: a person half a metre away fills it. But its front is seen
with many points, and a part of a round front determines centre and radius. The front is the median of the points in
each narrow sector about the sensor, which flying pixels do not move. The fitted circle is accepted if the front
deviates from it by a few millimetres at most and is curved enough to determine the radius. Walls are not
curved, and corners deviate.

Source: ours; circle by Gauss-Newton on the distances after Gander, Golub and Strebel 1994.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

SECTOR_RAD = math.radians(1.5)  # ours: one centimetre at 0.4 m
SECTOR_POINTS = 8  # ours: sectors with fewer points are left out
SECTORS = 6  # ours: at least this many; three would fit any noise
LEAST_M = 0.10  # ours: least width of the front; a short piece of a corner looks round too
ROUGH_M = 0.003
"""Ours: largest RMS of the fit; in walks 0.2 to 2.2 mm for round obstacles, 5.7 mm and more for others."""
SMOOTH_M = 0.003  # ours: least RMS in the covariance; errors of sectors are correlated
RADIUS_M = (0.03, 0.35)  # ours: up to the largest tracked obstacle
RADIUS_SIGMA_M = 0.03
"""Ours: largest standard deviation of the radius; above, the front may be flat."""
FLAT = 3.0  # ours: an initial radius this many times the largest one is a wall
ITERATIONS = 15  # of Gauss-Newton; usually four or five suffice
DONE_M = 1e-6  # change at which the iteration stops


@dataclass(frozen=True)
class CircleFit:
    """A circle fitted to the visible front of an obstacle.

    Args:
        centre: (2,), m, in the frame of the points.
        covariance: (2, 2) of the centre, m^2, by the noise of the front alone.
        radius_m: Its radius.
    """

    centre: Float[np.ndarray, "2"]
    covariance: Float[np.ndarray, "2 2"]
    radius_m: float


def fit(
    xy: Float[np.ndarray, "n 2"],
    sensor_xy: Float[np.ndarray, "2"],
) -> CircleFit | None:
    """Fit a circle; None if the front is not round, or too little of it is visible.

    Args:
        xy: Points of one obstacle on the ground plane, m.
        sensor_xy: Position of the sensor in the same frame, m.
    """
    if len(xy) == 0:
        return None
    front = outline(xy, sensor_xy)
    if len(front) < SECTORS:
        return None
    if float(np.linalg.norm(front[-1] - front[0])) < LEAST_M:
        return None
    circle = _algebraic(front)
    least, most = RADIUS_M
    if float(circle[2]) > FLAT * most:  # Kasa's circle tends to be too small
        return None
    for _ in range(ITERATIONS):
        offsets, J = _distances(front, circle)
        change = np.linalg.lstsq(J, -offsets, rcond=None)[0]
        circle = circle + change
        if float(np.abs(change).max()) < DONE_M:
            break
    offsets, J = _distances(front, circle)
    rough = math.sqrt(float(offsets @ offsets) / len(front))
    covariance = max(rough, SMOOTH_M) ** 2 * np.linalg.pinv(J.T @ J, hermitian=True)
    radius, sigma = float(circle[2]), math.sqrt(float(covariance[2, 2]))
    if rough > ROUGH_M or sigma > RADIUS_SIGMA_M:
        return None
    if not least < radius < most - 2.0 * sigma or not _faces(circle, front, sensor_xy):
        return None
    return CircleFit(circle[:2], covariance[:2, :2], radius)


def outline(
    xy: Float[np.ndarray, "n 2"], sensor_xy: Float[np.ndarray, "2"]
) -> Float[np.ndarray, "m 2"]:
    """Median point, by distance, of each sector about the sensor, from right to left."""
    away = xy - sensor_xy
    middle = away.mean(axis=0)
    left = np.array([-middle[1], middle[0]])
    bearing = np.arctan2(away @ left, away @ middle)  # within +-pi / 2 of the mean
    distance = np.hypot(away[:, 0], away[:, 1])
    sector = np.floor(bearing / SECTOR_RAD).astype(np.int64)
    order = np.lexsort((distance, sector))
    _, first, count = np.unique(sector[order], return_index=True, return_counts=True)
    medians = order[first + count // 2][count >= SECTOR_POINTS]
    return np.asarray(xy[medians])


def _algebraic(front: Float[np.ndarray, "m 2"]) -> Float[np.ndarray, "3"]:
    """x, y, radius of the initial circle, which minimises the squared power (Kasa 1976)."""
    mean = front.mean(axis=0)
    local = front - mean
    A = np.column_stack([2.0 * local, np.ones(len(local))])
    x, y, rest = np.linalg.lstsq(A, np.sum(local**2, axis=1), rcond=None)[0].tolist()
    return np.array([mean[0] + x, mean[1] + y, math.sqrt(max(rest + x * x + y * y, 1e-9))])


def _distances(
    front: Float[np.ndarray, "m 2"], circle: Float[np.ndarray, "3"]
) -> tuple[Float[np.ndarray, "m"], Float[np.ndarray, "m 3"]]:
    """Distance of each point outside the circle, and its Jacobian with respect to x, y and radius."""
    away = front - circle[:2]
    distance = np.maximum(np.hypot(away[:, 0], away[:, 1]), 1e-9)
    return distance - circle[2], np.column_stack([-away / distance[:, None], -np.ones(len(front))])


def _faces(
    circle: Float[np.ndarray, "3"],
    front: Float[np.ndarray, "m 2"],
    sensor_xy: Float[np.ndarray, "2"],
) -> bool:
    """Whether the circle is convex towards the sensor, unlike the inside of a corner."""
    centre = circle[:2]
    outside = float(np.linalg.norm(centre - sensor_xy)) > float(circle[2])
    return outside and float((front.mean(axis=0) - centre) @ (sensor_xy - centre)) > 0.0
