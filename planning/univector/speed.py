"""Change of speed to pass before a moving obstacle or behind it, or to leave its path.

(a) Outside the band that the obstacle sweeps the robot accelerates to pass before it, or decelerates to let it pass.
(b) Inside the band it accelerates to leave it in time. (c) If neither is within the limits, or the obstacle comes along
the path of the robot, `virtual_obstacle` turns the robot aside.

The printed law reaches the point of contact at the time of contact with constant acceleration. On the way there the
robot comes nearer than at constant speed, so the acceleration is raised until the whole path is clear; `literal` keeps
the law.

Source: Yoo 2010 (seed 001), section 4, velocity modification, cases (a) to (c); raising it is ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from perception.primitives.robot_model import DARWIN_OP, GaitLimits

from . import _collision_kernels as kernels
from .collision import Band, contact
from .fields import HORIZON_S, acceleration_mps2

SAMPLES = 161  # ours: over the horizon; at 5 cm/s relative speed every 2.5 mm
HALVINGS = 12  # ours: of the bisection


@dataclass(frozen=True)
class Change:
    """The change of speed for one moving obstacle.

    Args:
        case: "clear", "accelerate", "decelerate", "escape", or "virtual" if no speed avoids it.
        acceleration_mps2: Until top speed or standstill.
    """

    case: str
    acceleration_mps2: float = 0.0


CLEAR = Change("clear")
VIRTUAL = Change("virtual")


def least_distance(
    place: Float[np.ndarray, "2"],
    velocity: Float[np.ndarray, "2"],
    speed_mps: float,
    acceleration_mps2: float,
    bound_mps: float,
    horizon_s: float,
) -> float:
    """Least distance to the middle of an obstacle within the horizon, m.

    Args:
        place, velocity: Of the obstacle in O_R, m and m/s.
        speed_mps, acceleration_mps2: Of the robot, along x.
        bound_mps: Speed at which the acceleration ends.
        horizon_s: How far ahead.
    """
    return float(
        kernels.least_distance(
            place, velocity, speed_mps, acceleration_mps2, bound_mps, horizon_s, SAMPLES
        )
    )


def contact_acceleration(
    place: Float[np.ndarray, "2"],
    velocity: Float[np.ndarray, "2"],
    speed_mps: float,
    contact_speed_mps: float,
) -> float:
    """a_i of the printed law, which reaches the point of contact at the time of contact, m/s^2.

    Args:
        place, velocity: Of the obstacle in O_R (x ahead), m and m/s.
        speed_mps: Present forward speed of the robot.
        contact_speed_mps: v_ci, a root of the band.

    Returns:
        Infinite if the contact is past or never comes.

    Source: seed 001, section 4 (change of velocity).
    """
    t = contact(place, velocity, contact_speed_mps)
    if t <= 0.0 or not math.isfinite(contact_speed_mps):
        return math.inf
    return 2.0 * (contact_speed_mps * t - speed_mps * t) / t**2


def escape_acceleration(
    place: Float[np.ndarray, "2"],
    velocity: Float[np.ndarray, "2"],
    radius_m: float,
    speed_mps: float,
) -> float:
    """a of case (b), which reaches the edge of the swept band ahead when the obstacle does, m/s^2.

    Args:
        place, velocity: Of the obstacle in O_R (x ahead), m and m/s.
        radius_m: S_oe.
        speed_mps: Present forward speed of the robot.

    Returns:
        Infinite if the band has no edge ahead, or the obstacle is beyond it.

    Source: seed 001, section 4, case (b).
    """
    size = float(np.hypot(*velocity))
    n = np.array([-velocity[1], velocity[0]]) / max(size, 1e-12)
    if abs(n[0]) < 1e-9:
        return math.inf
    edge = max((float(n @ place) + sign * radius_m) / float(n[0]) for sign in (1.0, -1.0))
    t = float(velocity @ (np.array([edge, 0.0]) - place)) / max(size, 1e-12) ** 2
    return math.inf if edge <= 0.0 or t <= 0.0 else 2.0 * (edge - speed_mps * t) / t**2


def change(
    place: Float[np.ndarray, "2"],
    velocity: Float[np.ndarray, "2"],
    radius_m: float,
    band: Band | None,
    speed_mps: float,
    gait: GaitLimits = DARWIN_OP.gait,
    literal: bool = False,
) -> Change:
    """The change of speed for one moving obstacle.

    Args:
        place, velocity: Of the obstacle in O_R, m and m/s.
        radius_m: S_oe, with the standard deviation of the miss if it is used.
        band: Colliding speeds, or None.
        speed_mps: Forward speed of the robot.
        gait: Top speed and largest change of speed of the robot.
        literal: The printed law.

    Source: seed 001, section 4, velocity modification.
    """
    if band is None or not band.contains(speed_mps):
        return CLEAR
    size = float(np.hypot(*velocity))
    across = abs(float(velocity[0] * place[1] - velocity[1] * place[0])) / max(size, 1e-12)
    inside = across <= radius_m
    if not literal and least_distance(place, velocity, speed_mps, 0.0, 0.0, HORIZON_S) >= radius_m:
        return VIRTUAL if inside else CLEAR  # the collision is beyond the horizon
    if inside:
        wanted = [("escape", escape_acceleration(place, velocity, radius_m, speed_mps))]
    else:
        wanted = [
            ("accelerate", _bounded(place, velocity, speed_mps, band.high, gait.max_speed_mps)),
            ("decelerate", contact_acceleration(place, velocity, speed_mps, max(band.low, 0.0))),
        ]
    limit = acceleration_mps2(gait)
    for case, first in wanted:
        if not abs(first) <= limit:
            continue
        if literal:
            return Change(case, first)
        sign = -1.0 if case == "decelerate" else 1.0
        found = _until_clear(place, velocity, radius_m, speed_mps, first, sign, gait)
        if found is not None:
            return Change(case, found)
    return VIRTUAL


def _bounded(
    place: np.ndarray, velocity: np.ndarray, speed_mps: float, root: float, top: float
) -> float:
    """a_1; infinite if v_c1 is above top speed."""
    return contact_acceleration(place, velocity, speed_mps, root) if root <= top else math.inf


def _until_clear(
    place: np.ndarray,
    velocity: np.ndarray,
    radius_m: float,
    speed_mps: float,
    first: float,
    sign: float,
    gait: GaitLimits,
) -> float | None:
    """The least acceleration of this sign, from that of the law on, without contact; None beyond the limit."""

    def clear(a: float) -> bool:
        bound = gait.max_speed_mps if a > 0.0 else 0.0
        least = least_distance(place, velocity, speed_mps, a, bound, HORIZON_S)
        return least >= radius_m - 1e-9

    low, high = sign * max(sign * first, 0.0), sign * acceleration_mps2(gait)
    if clear(low):
        return low
    if not clear(high):
        return None
    for _ in range(HALVINGS):
        middle = (low + high) / 2.0
        low, high = (low, middle) if clear(middle) else (middle, high)
    return high
