"""The virtual obstacle on the path of a moving obstacle, which turns the robot aside early and gently.

It lies at the foot of the perpendicular from the robot to the path of the obstacle. It has the size of the obstacle at
the obstacle and vanishes at a distance that grows with the relative speed and the gaze evaluations. The curve between
is Schlick's rational bias, symmetric and through (xi, xi), which has the printed factor (1 - xi)^2 / xi^2.

Two points are ours. A robot on the path itself, which the printed radius (at most the distance) leaves without a virtual
obstacle, passes on the side that the sign of eq. (9) takes. The normalisation in eq. (10) gives a disc of any size full
weight, so the heading jumps by 71 deg as soon as one appears; here its weight grows with its radius.

Source: Yoo 2010 (seed 001), eq. (11) (lost, reconstructed) and the velocity of the foot.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from perception.primitives.errors import InputError

from .fields import FieldConfig

REACH_V_S = 12.0  # w_dist eta_vo; ours: growth of the distance with the relative speed
REACH_PSI_M = 0.3  # w_dist eta_imp; ours: growth with the gaze evaluations
ASIDE_M = 1e-6  # ours: distance from the path that a robot exactly on it is given


@dataclass(frozen=True)
class VirtualObstacle:
    """A disc on the path of a moving obstacle.

    Args:
        place: p_vo, in the body frame O_R, m.
        radius_m: R_vo.
        weight: In the field, in (0, 1]: root of the calculated radius divided by S_oe.
        velocity: Velocity of the foot of the perpendicular while the robot walks, in O_R, m/s.
    """

    place: Float[np.ndarray, "2"]
    radius_m: float
    weight: float
    velocity: Float[np.ndarray, "2"]


def shrunken_radius(extended_m: float, share: float, convexity: float) -> float:
    """R_calc: radius at a share h_vo of the distance at which it vanishes, m.

    Args:
        extended_m: S_oe of the obstacle.
        share: h_vo, at least 0; from 1 on the radius is 0.
        convexity: xi in (0, 1); 0.5 shrinks linearly, more is convex.

    Raises:
        InputError: The share is negative or the convexity not in (0, 1).

    Source: seed 001, eq. (11).
    """
    if not (share >= 0.0 and 0.0 < convexity < 1.0):
        raise InputError(
            f"virtual obstacle: share={share} must not be negative and convexity={convexity} "
            "must lie in (0, 1)"
        )
    if share >= 1.0:
        return 0.0
    rho = ((1.0 - convexity) / convexity) ** 2
    return extended_m * (1.0 - share) / (1.0 - share + rho * share)


def virtual_obstacle(
    place: Float[np.ndarray, "2"],
    velocity: Float[np.ndarray, "2"],
    speed_mps: float,
    extended_m: float,
    psi: float,
    config: FieldConfig,
) -> VirtualObstacle | None:
    """The virtual obstacle of a moving obstacle; None behind it, beyond its reach, or if it is static.

    Args:
        place, velocity: Of the obstacle, in axes of O_R, m and m/s; the velocity is that in the world.
        speed_mps: Forward speed of the robot, along x.
        extended_m: S_oe.
        psi: psi_sf + psi_ob, in [0, 2]; 0 if not used.
        config: Convexity.

    Source: seed 001, section 4, eq. (11).
    """
    size = float(np.hypot(*velocity))
    if size < 1e-9:
        return None
    along = velocity / size
    ahead = -float(place @ along)  # of the obstacle, to the foot of the perpendicular
    if ahead <= 0.0:
        return None
    relative = velocity - np.array([speed_mps, 0.0])
    vanishes = REACH_V_S * float(np.hypot(*relative)) + REACH_PSI_M * psi
    share = ahead / vanishes if vanishes > 0.0 else math.inf
    calculated = shrunken_radius(extended_m, share, config.convexity)
    if calculated <= 0.0:
        return None
    foot = place + ahead * along
    if np.hypot(*foot) < ASIDE_M:
        left = np.array([-along[1], along[0]])
        foot = left * (-ASIDE_M if left[1] >= 0.0 else ASIDE_M)
    radius, weight = min(calculated, float(np.hypot(*foot))), math.sqrt(calculated / extended_m)
    return VirtualObstacle(foot, radius, weight, speed_mps * along[0] * along)
