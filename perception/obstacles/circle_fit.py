"""Where the middle of a round thing is that the view shows only a part of.

What stands close before a camera is never wholly in view: a person half a metre away fills it. But its front
is seen all the better, and of something round a piece of the front tells middle and radius. The front is the
median of what lies in each narrow sector round the sensor, which flying pixels do not move. A circle is laid
through it; that is believed if the front follows it to a few millimetres and bends enough to say how large it is.
A wall does not bend, and a corner does not follow.

Source: ours; circle by Gauss-Newton on the distances after Gander, Golub and Strebel 1994.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..primitives.errors import ConfigError

ROUNDS = 15  # of Gauss-Newton; four or five are enough as a rule
DONE_M = 1e-6
FLAT = 3.0  # ours: times the largest radius, to begin with, is a wall


@dataclass(frozen=True)
class FrontConfig:
    """What is believed to be round."""

    sector_rad: float = math.radians(1.5)  # ours: a centimetre at 0.4 m
    sector_points: int = 8  # ours: fewer are a stray pixel or two
    sectors: int = 6  # ours: three would make a circle of any noise
    least_m: float = 0.10  # ours: width of the front; a short piece of a corner is round, too
    rough_m: float = (
        0.003  # ours: RMS; in walks 0.2 to 2.2 mm for round things, from 5.7 for others
    )
    smooth_m: float = 0.003  # ours: no front is taken for surer, sectors err alike
    radius_m: tuple[float, float] = (0.03, 0.35)  # ours: up to what the tracks call a thing
    radius_sigma_m: float = 0.03  # ours: vaguer than that and it may be flat

    def __post_init__(self) -> None:
        for name in ("sector_rad", "least_m", "rough_m", "smooth_m", "radius_sigma_m"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"round front: {name}={value} must be positive and finite")
        if self.sectors < 4 or self.sector_points < 1:
            raise ConfigError(
                f"round front: sectors={self.sectors} must be at least 4 and "
                f"sector_points={self.sector_points} at least 1"
            )
        if not 0.0 < self.radius_m[0] < self.radius_m[1]:
            raise ConfigError(f"round front: radius_m={self.radius_m} must be (least, most)")


@dataclass(frozen=True)
class RoundFront:
    """A circle through what is seen of a thing.

    Args:
        centre: (2,), m, in the frame of the points.
        covariance: (2, 2) of the centre, m^2, by the noise of the front alone.
        radius_m: Of the circle.
    """

    centre: Float[np.ndarray, "2"]
    covariance: Float[np.ndarray, "2 2"]
    radius_m: float


def fit(
    xy: Float[np.ndarray, "n 2"],
    sensor_xy: Float[np.ndarray, "2"],
    config: FrontConfig | None = None,
) -> RoundFront | None:
    """The circle whose front was seen; None if it is not round, or too little of it was seen.

    Args:
        xy: Points of one thing, from above, m.
        sensor_xy: Where the sensor stands, in the same frame, m.
        config: What is believed.
    """
    config = config or FrontConfig()
    if len(xy) == 0:
        return None
    front = outline(xy, sensor_xy, config)
    if len(front) < config.sectors:
        return None
    if float(np.linalg.norm(front[-1] - front[0])) < config.least_m:
        return None
    circle = _algebraic(front)
    least, most = config.radius_m
    if float(circle[2]) > FLAT * most:  # Kasa's circle is too small, if anything
        return None
    for _ in range(ROUNDS):
        offsets, J = _distances(front, circle)
        change = np.linalg.lstsq(J, -offsets, rcond=None)[0]
        circle = circle + change
        if float(np.abs(change).max()) < DONE_M:
            break
    offsets, J = _distances(front, circle)
    rough = math.sqrt(float(offsets @ offsets) / len(front))
    covariance = max(rough, config.smooth_m) ** 2 * np.linalg.pinv(J.T @ J, hermitian=True)
    radius, sigma = float(circle[2]), math.sqrt(float(covariance[2, 2]))
    if rough > config.rough_m or sigma > config.radius_sigma_m:
        return None
    if not least < radius < most - 2.0 * sigma or not _faces(circle, front, sensor_xy):
        return None
    return RoundFront(circle[:2], covariance[:2, :2], radius)


def outline(
    xy: Float[np.ndarray, "n 2"], sensor_xy: Float[np.ndarray, "2"], config: FrontConfig
) -> Float[np.ndarray, "m 2"]:
    """Median place of the points of each sector round the sensor, from right to left."""
    away = xy - sensor_xy
    middle = away.mean(axis=0)
    left = np.array([-middle[1], middle[0]])
    bearing = np.arctan2(away @ left, away @ middle)  # none lies behind: the middle is ahead
    distance = np.hypot(away[:, 0], away[:, 1])
    sector = np.floor(bearing / config.sector_rad).astype(np.int64)
    order = np.lexsort((distance, sector))
    _, first, count = np.unique(sector[order], return_index=True, return_counts=True)
    medians = order[first + count // 2][count >= config.sector_points]
    return np.asarray(xy[medians])


def _algebraic(front: Float[np.ndarray, "m 2"]) -> Float[np.ndarray, "3"]:
    """x, y, radius of the circle of least squared power: to begin with (Kasa 1976)."""
    mean = front.mean(axis=0)
    local = front - mean
    A = np.column_stack([2.0 * local, np.ones(len(local))])
    x, y, rest = np.linalg.lstsq(A, np.sum(local**2, axis=1), rcond=None)[0].tolist()
    return np.array([mean[0] + x, mean[1] + y, math.sqrt(max(rest + x * x + y * y, 1e-9))])


def _distances(
    front: Float[np.ndarray, "m 2"], circle: Float[np.ndarray, "3"]
) -> tuple[Float[np.ndarray, "m"], Float[np.ndarray, "m 3"]]:
    """How far each point lies outside the circle, and how that changes with x, y and radius."""
    away = front - circle[:2]
    distance = np.maximum(np.hypot(away[:, 0], away[:, 1]), 1e-9)
    return distance - circle[2], np.column_stack([-away / distance[:, None], -np.ones(len(front))])


def _faces(
    circle: Float[np.ndarray, "3"],
    front: Float[np.ndarray, "m 2"],
    sensor_xy: Float[np.ndarray, "2"],
) -> bool:
    """Whether the front bulges towards the sensor, which stands outside: the inside of a corner does not."""
    centre = circle[:2]
    outside = float(np.linalg.norm(centre - sensor_xy)) > float(circle[2])
    return outside and float((front.mean(axis=0) - centre) @ (sensor_xy - centre)) > 0.0
