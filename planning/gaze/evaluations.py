"""The four partial evaluations of the gaze, each in [0, 1].

psi_lm: share of stale ground round the robot. psi_sf: uncertainty of the robot's position. psi_ob: uncertainty,
speed and nearness of an obstacle. psi_way: free distance ahead; with much of it the gaze goes to the way point, else
to the obstacles.

Source: Yoo 2010 (seed 001), section 3, eq. (1) to (4). Eq. (1) is printed as a ratio without bound; `literal` keeps
it, limited to 1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from perception.primitives.errors import ConfigError
from perception.primitives.gaussian import deviation
from perception.primitives.settings import setting


@dataclass(frozen=True)
class EvaluationConfig:
    """Thresholds of the evaluations."""

    nearest_m: float = setting(
        0.30, "m", "inner radius d_nm of the ground whose confidence is sampled", "seed 001"
    )
    farthest_m: float = setting(
        1.30, "m", "outer radius d_fm of the ground whose confidence is sampled", "seed 001"
    )
    self_sigma_m: float = setting(
        0.10, "m", "standard deviation T_sf of the robot's position at which psi_sf is 1", "ours"
    )
    obstacle_rate_mps: float = setting(
        0.02, "m/s", "threshold T_o at which psi_ob is 1: deviation times speed by distance", "ours"
    )
    obstacle_weight: float = 1.0  # ours; factor omega_o of psi_ob
    way_free_m: float = setting(1.0, "m", "free distance d_nThres at which psi_way is 1", "ours")

    def __post_init__(self) -> None:
        if not 0.0 <= self.nearest_m < self.farthest_m:
            raise ConfigError(
                f"gaze: nearest_m={self.nearest_m} must not be negative and lie below "
                f"farthest_m={self.farthest_m}"
            )
        for name in ("self_sigma_m", "obstacle_rate_mps", "obstacle_weight", "way_free_m"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"gaze: {name}={value} must be positive and finite")


def of_map(stale: int, fresh: int, literal: bool = False) -> float:
    """psi_lm: share of the sampling region out of view that is stale.

    Args:
        stale, fresh: N_lp and N_cp, sample points out of view with confidence below lambda_cf, and the others.
        literal: The printed ratio N_lp / N_cp, limited to 1; 1 without fresh points.

    Returns:
        In [0, 1]; 0 if all points are in view.

    Source: seed 001, eq. (1); r / (1 + r) of the printed ratio r has the same order and a bound.
    """
    if stale == 0:
        return 0.0
    return min(stale / fresh, 1.0) if literal and fresh else stale / (stale + (not literal) * fresh)


def of_self(covariance: Float[np.ndarray, "3 3"], config: EvaluationConfig) -> float:
    """psi_sf: standard deviation of the position along its worst axis, divided by T_sf, at most 1.

    Args:
        covariance: Of (x, y, yaw), m and rad; the heading is not used.

    Source: seed 001, eq. (2).
    """
    return min(deviation(covariance[:2, :2]) / config.self_sigma_m, 1.0)


def of_obstacles(
    positions: Float[np.ndarray, "n 2"],
    velocities: Float[np.ndarray, "n 2"],
    covariances: Float[np.ndarray, "n 2 2"],
    config: EvaluationConfig,
) -> Float[np.ndarray, "n"]:
    """psi_ob of each obstacle: deviation times speed by distance, divided by T_o, at most 1; 0 for static ones.

    Args:
        positions: Relative to the robot, in any axes, m.
        velocities: In the world, not relative to the robot, m/s.
        covariances: Of the positions, m^2.

    Source: seed 001, eq. (3).
    """
    sigma = np.array([deviation(P) for P in covariances]).reshape(-1)
    speed, away = np.linalg.norm(velocities, axis=1), np.linalg.norm(positions, axis=1)
    alpha = config.obstacle_weight * sigma * speed / np.maximum(away, 1e-6)
    return np.minimum(alpha / config.obstacle_rate_mps, 1.0)


def of_way(
    positions: Float[np.ndarray, "n 2"], radii: Float[np.ndarray, "n"], config: EvaluationConfig
) -> float:
    """psi_way: distance to the nearest extended obstacle, divided by d_nThres, at most 1.

    Args:
        positions: Of the obstacles ahead or approaching, and of their virtual obstacles, relative to the robot, m.
        radii: Extended radii S_oe, m.

    Source: seed 001, eq. (4).
    """
    if len(positions) == 0:
        return 1.0
    gap = float(np.min(np.linalg.norm(positions, axis=1) - radii))
    return min(max(gap, 0.0) / config.way_free_m, 1.0)
