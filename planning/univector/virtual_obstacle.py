"""The virtual obstacle on the path of a mover, which turns the robot aside early and gently.

It stands where the robot's perpendicular meets the obstacle's path, as large as the obstacle itself where the
obstacle is, and shrinks to nothing at a distance that grows with speed and with the gaze evaluations. The
curve between is Schlick's rational bias, symmetric and through (xi, xi); it brings the printed factor
(1 - xi)^2 / xi^2 with it.

Source: seed 001, eq. (11) (lost, reconstructed) and the velocity of the foot.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from perception.primitives.errors import InputError

from .fields import FieldConfig


@dataclass(frozen=True)
class VirtualObstacle:
    """A disc on the path of a mover.

    Args:
        place: p_vo, in O_R, m.
        radius_m: R_vo.
        velocity: Of the foot of the perpendicular while the robot walks, in O_R, m/s.
    """

    place: Float[np.ndarray, "2"]
    radius_m: float
    velocity: Float[np.ndarray, "2"]


def shrunken_radius(extended_m: float, share: float, convexity: float) -> float:
    """R_calc: radius at a share h_vo of the distance at which it vanishes, m.

    Args:
        extended_m: S_oe of the obstacle itself.
        share: h_vo, at least 0; from 1 on there is nothing left.
        convexity: xi in (0, 1); 0.5 is a straight line, a triangle from above; larger bulges.

    Raises:
        InputError: A share below 0 or a convexity outside (0, 1).

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
    """The one of a mover; None if the robot is behind it, beyond its reach, or the mover stands.

    Args:
        place, velocity: Of the obstacle in O_R, its own velocity, m and m/s.
        speed_mps: Of the robot, ahead.
        extended_m: S_oe.
        psi: psi_sf + psi_ob, in [0, 2]; 0 where not used.
        config: Convexity, and how the distance grows.

    Source: seed 001, section 4, eq. (11).
    """
    size = float(np.hypot(*velocity))
    if size < 1e-9:
        return None
    along = velocity / size
    ahead = -float(place @ along)  # of the obstacle, where the perpendicular falls
    if ahead <= 0.0:
        return None
    relative = velocity - np.array([speed_mps, 0.0])
    vanishes = config.virtual_v_s * float(np.hypot(*relative)) + config.virtual_psi_m * psi
    share = ahead / vanishes if vanishes > 0.0 else math.inf
    foot = place + ahead * along
    radius = min(shrunken_radius(extended_m, share, config.convexity), float(np.hypot(*foot)))
    if radius <= 0.0:
        return None
    return VirtualObstacle(foot, radius, speed_mps * along[0] * along)
