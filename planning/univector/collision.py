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

NO_DOUBT = np.zeros((4, 4))
ROUNDS = 4  # of finding a root whose radius depends on it; the change is then below a millimetre


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
    (px, py), (vx, vy) = place.tolist(), velocity.tolist()
    D = px * px + py * py - radius_m * radius_m
    if D <= 0.0:
        return Band(-math.inf, math.inf)
    pv = px * vx + py * vy
    a = px * px - D
    b = -2.0 * px * pv + 2.0 * D * vx
    c = pv * pv - D * (vx * vx + vy * vy)
    if abs(a) < 1e-12:  # the path touches the disc: one root goes to infinity
        return _half_line(px, -c / b, b > 0.0) if abs(b) > 1e-12 else None
    square = b * b - 4.0 * a * c
    if square < 0.0 and a < 0.0:
        return None
    root = math.sqrt(max(square, 0.0))  # where the path crosses the disc it is never below 0
    first, second = sorted(((-b - root) / (2.0 * a), (-b + root) / (2.0 * a)))
    if a > 0.0:  # the path crosses the disc: any speed high enough, or low enough if it lies behind
        return Band(second, math.inf) if px > 0.0 else Band(-math.inf, first)
    middle = (first + second) / 2.0
    return Band(first, second) if px * middle > pv else None  # p.w > 0


def _half_line(px: float, root: float, above: bool) -> Band | None:
    if above != (px > 0.0):
        return None
    return Band(root, math.inf) if above else Band(-math.inf, root)


def contact(
    place: Float[np.ndarray, "2"], velocity: Float[np.ndarray, "2"], speed_mps: float
) -> float:
    """t_c: time of the nearest approach at a speed, s; at a root of the band the disc is just touched.

    Negative if it is over; 0 if robot and obstacle stand still to each other.
    """
    w = np.array([speed_mps, 0.0]) - velocity
    square = float(w @ w)
    return float(place @ w) / square if square > 0.0 else 0.0


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
    w = np.array([speed_mps, 0.0]) - velocity
    size = float(np.hypot(*w))
    if size < 1e-9:
        n = place / max(float(np.hypot(*place)), 1e-9)
    else:
        n = np.array([-w[1], w[0]]) / size
    t = min(max(contact(place, velocity, speed_mps), 0.0), horizon_s)
    row = np.concatenate([n, t * n])
    return math.sqrt(max(float(row @ covariance @ row), 0.0))


def doubtful_band(
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
    band = colliding_speeds(place, velocity, radius_m)
    start = band
    if start is None:  # only doubt can make it collide: at the speed that comes nearest
        nearest = _nearest_speed(place, velocity)
        extra = miss_deviation(place, velocity, covariance, nearest, horizon_s)
        start = colliding_speeds(place, velocity, radius_m + sigmas * min(extra, max_sigma_m))
    if start is None:
        return None
    bounds = []
    for upper in (False, True):
        bound = start.high if upper else start.low
        for _ in range(ROUNDS):
            if not math.isfinite(bound):
                break
            extra = miss_deviation(place, velocity, covariance, bound, horizon_s)
            wider = colliding_speeds(place, velocity, radius_m + sigmas * min(extra, max_sigma_m))
            if wider is None:
                break
            bound = wider.high if upper else wider.low
        bounds.append(bound)
    return Band(*bounds) if bounds[0] < bounds[1] else band


def _nearest_speed(place: Float[np.ndarray, "2"], velocity: Float[np.ndarray, "2"]) -> float:
    """The speed whose relative velocity points at the obstacle; the obstacle's own along x if none does."""
    px, py = place.tolist()
    return float(velocity[0] - velocity[1] * px / py) if abs(py) > 1e-9 else float(velocity[0])
