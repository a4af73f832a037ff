"""The speeds at which a robot that goes straight collides with an obstacle at constant velocity.

Frame O_R: the robot at the origin, x ahead. With w the velocity of the robot relative to the obstacle there is a
collision if p.w > 0 and (p.w)^2 > |w|^2 (|p|^2 - S^2), a quadratic in the speed of the robot, whose roots bound the band
of colliding speeds. The paper assumes exact velocities. Here the extended radius grows by the standard deviation of the
miss distance, from the covariance of relative position and velocity at the nearest approach.

Source: Yoo 2010 (seed 001), section 4 (collision test, reconstructed); the deviation of the miss is ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from . import _collision_kernels as kernels

EXACT = np.zeros((4, 4))


@dataclass(frozen=True)
class Band:
    """The open interval of colliding speeds, v_c2 < v < v_c1, m/s; may be unbounded."""

    low: float
    high: float

    def contains(self, speed_mps: float) -> bool:
        """Whether a speed collides."""
        return self.low < speed_mps < self.high


def colliding_speeds(
    place: Float[np.ndarray, "2"], velocity: Float[np.ndarray, "2"], radius_m: float
) -> Band | None:
    """The band of forward speeds that bring the robot into the disc at any time.

    Args:
        place, velocity: Of the obstacle, in axes of O_R, m and m/s; the velocity is that in the world.
        radius_m: S_oe.

    Returns:
        None if no speed collides. All speeds if the robot is inside the disc.
    """
    return _band(kernels.colliding_speeds(place, velocity, radius_m))


def _band(bounds: tuple[float, float]) -> Band | None:
    return None if math.isnan(bounds[0]) else Band(*bounds)


def contact(
    place: Float[np.ndarray, "2"], velocity: Float[np.ndarray, "2"], speed_mps: float
) -> float:
    """t_c: time of the nearest approach at a speed, s; at a root of the band it is the time of contact.

    Args:
        place, velocity: Of the obstacle in O_R (x ahead), m and m/s.
        speed_mps: Forward speed of the robot.

    Returns:
        Negative if it is past; 0 without relative motion.

    Source: seed 001, section 4.
    """
    return float(kernels.contact(place, velocity, speed_mps))


def miss_deviation(
    place: Float[np.ndarray, "2"],
    velocity: Float[np.ndarray, "2"],
    covariance: Float[np.ndarray, "4 4"],
    speed_mps: float,
    horizon_s: float,
) -> float:
    """Standard deviation of the miss distance, m.

    Args:
        place, velocity: In O_R.
        covariance: Of (x, y, vx, vy) relative to the robot, in O_R.
        speed_mps: Of the robot.
        horizon_s: Time after which the uncertainty of the velocity has no further effect.

    Source: ours; first order, across the relative motion at the nearest approach.
    """
    return float(kernels.miss_deviation(place, velocity, covariance, speed_mps, horizon_s))


def widened_band(
    place: Float[np.ndarray, "2"],
    velocity: Float[np.ndarray, "2"],
    radius_m: float,
    covariance: Float[np.ndarray, "4 4"],
    sigmas: float,
    max_sigma_m: float,
    horizon_s: float,
) -> Band | None:
    """The band of the disc enlarged by the standard deviation of the miss.

    Args:
        place, velocity, covariance: As in `miss_deviation`.
        radius_m: S_oe without it.
        sigmas: Standard deviations to add, at each bound its own.
        max_sigma_m: Largest standard deviation that is added.
        horizon_s: As in `miss_deviation`.

    Source: ours; seed 001 leaves uncertain velocities open.
    """
    given = place, velocity, radius_m, covariance
    return _band(kernels.widened_band(*given, sigmas, max_sigma_m, horizon_s))
