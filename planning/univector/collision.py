"""Which speeds lead into a moving obstacle: the robot goes straight ahead, the obstacle straight on.

All in O_R, the robot's axes: the robot at the origin, x ahead. With w the robot's velocity relative to the
obstacle there is a collision if p.w > 0 and (p.w)^2 > |w|^2 (|p|^2 - S^2): a polynomial of second order in the
robot's speed, whose roots bound the band of colliding speeds. The paper supposes exact velocities, and says
so; here the extended radius grows by the deviation of the miss, from the covariance of relative place and
velocity at the time of the nearest approach.

Source: seed 001, section 4 (collision test, reconstructed); the deviation of the miss is ours.
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
    """The open interval of robot speeds that collide, v_c2 < v < v_c1, m/s; may be unbounded."""

    low: float
    high: float

    def contains(self, speed_mps: float) -> bool:
        """Whether a speed leads to a collision."""
        return self.low < speed_mps < self.high


def colliding_speeds(
    place: Float[np.ndarray, "2"], velocity: Float[np.ndarray, "2"], radius_m: float
) -> Band | None:
    """The band of speeds ahead that would bring the robot into the disc, ever.

    Args:
        place, velocity: Of the obstacle in O_R, its own velocity, m and m/s.
        radius_m: S_oe.

    Returns:
        None if no speed collides. All speeds if the robot is in the disc already.
    """
    return _band(kernels.colliding_speeds(place, velocity, radius_m))


def _band(bounds: tuple[float, float]) -> Band | None:
    return None if math.isnan(bounds[0]) else Band(*bounds)


def contact(
    place: Float[np.ndarray, "2"], velocity: Float[np.ndarray, "2"], speed_mps: float
) -> float:
    """t_c: time of the nearest approach at a speed, s; at a root of the band the disc is just touched.

    Args:
        place, velocity: Of the obstacle in O_R (x ahead), m and m/s.
        speed_mps: Of the robot, ahead.

    Returns:
        Negative if it is over; 0 if robot and obstacle stand still to each other.

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
    """Deviation of the distance at which the obstacle is missed, m.

    Args:
        place, velocity: In O_R.
        covariance: Of (x, y, vx, vy) relative to the robot, in O_R.
        speed_mps: Of the robot.
        horizon_s: Doubt of the velocity grows no longer than this.

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
    """The band widened so far that a speed outside misses by the extra deviations, too.

    Args:
        place, velocity, covariance: As in `miss_deviation`.
        radius_m: S_oe without doubt.
        sigmas: How many deviations are added, each bound with its own.
        max_sigma_m: A deviation counts no more than this.
        horizon_s: As in `miss_deviation`.

    Source: ours; seed 001 leaves uncertain velocities open.
    """
    given = place, velocity, radius_m, covariance
    return _band(kernels.widened_band(*given, sigmas, max_sigma_m, horizon_s))
