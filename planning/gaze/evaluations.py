"""The four partial evaluations: how much each reason to look somewhere weighs, each in [0, 1].

psi_lm: the ground round the robot that has become stale. psi_sf: how vague the robot's own place is. psi_ob:
how vague, fast and near an obstacle is. psi_way: how free the way is; on a free way the way point is worth a
look, in a crowd the crowd is.

Source: seed 001, section 3, eq. (1) to (4). Eq. (1) is printed as a ratio without bound; `literal` keeps it, cut
at 1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from perception.primitives.errors import ConfigError


@dataclass(frozen=True)
class EvaluationConfig:
    """Thresholds of the evaluations."""

    nearest_m: float = 0.30  # seed 001: d_nm, sampling region of the map
    farthest_m: float = 1.30  # seed 001: d_fm
    self_sigma_m: float = 0.10  # own (specification): T_sf
    obstacle_rate_mps: float = 0.02  # own (specification): T_o
    obstacle_weight: float = 1.0  # own (specification): omega_o
    way_free_m: float = 1.0  # own (specification): d_nThres

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
        stale, fresh: N_lp and N_cp, sample points out of view whose confidence is below lambda_cf, or not.
        literal: The printed ratio N_lp / N_cp, cut at 1; with nothing fresh it is 1.

    Returns:
        In [0, 1]; 0 if everything is in view.

    Source: seed 001, eq. (1); r / (1 + r) of the printed ratio r has the same order and a bound.
    """
    if stale == 0:
        return 0.0
    return min(stale / fresh, 1.0) if literal and fresh else stale / (stale + (not literal) * fresh)


def of_self(covariance: Float[np.ndarray, "3 3"], config: EvaluationConfig) -> float:
    """psi_sf: deviation of the robot's place along its worst axis, by T_sf, at most 1.

    Args:
        covariance: Of (x, y, yaw), m and rad; the heading does not count.

    Source: seed 001, eq. (2).
    """
    return min(deviation(covariance[:2, :2]) / config.self_sigma_m, 1.0)


def of_obstacles(
    positions: Float[np.ndarray, "n 2"],
    velocities: Float[np.ndarray, "n 2"],
    covariances: Float[np.ndarray, "n 2 2"],
    config: EvaluationConfig,
) -> Float[np.ndarray, "n"]:
    """psi_ob of each obstacle: vague, fast and near, by T_o, at most 1; 0 for what stands.

    Args:
        positions: From the robot, robot axes or any other, m.
        velocities: Their own, not relative to the robot's, m/s.
        covariances: Of the positions, m^2.

    Source: seed 001, eq. (3).
    """
    sigma = np.array([deviation(P) for P in covariances]).reshape(-1)
    speed, away = np.linalg.norm(velocities, axis=1), np.linalg.norm(positions, axis=1)
    alpha = config.obstacle_weight * sigma * speed / np.maximum(away, 1e-6)
    return np.minimum(alpha / config.obstacle_rate_mps, 1.0)


def relevant(
    positions: Float[np.ndarray, "n 2"],
    velocities: Float[np.ndarray, "n 2"],
    robot_velocity: Float[np.ndarray, "2"],
) -> Bool[np.ndarray, "n"]:
    """The obstacles that count (O_dted|bappr): all ahead, and those behind that come nearer.

    Args:
        positions, velocities: In the body frame (x ahead), m and m/s, the velocities their own.
        robot_velocity: In the same axes, m/s.

    Source: seed 001, section 3, the set of eq. (3).
    """
    relative = velocities - robot_velocity
    approaching = np.sum(positions * relative, axis=1) < 0.0
    return np.asarray((positions[:, 0] > 0.0) | approaching)


def of_way(
    positions: Float[np.ndarray, "n 2"], radii: Float[np.ndarray, "n"], config: EvaluationConfig
) -> float:
    """psi_way: distance from the robot to the nearest extended obstacle, by d_nThres, at most 1.

    Args:
        positions: Of the middles from the robot, m; those that `matter`, and their virtual obstacles.
        radii: Extended ones, S_oe, m.

    Source: seed 001, eq. (4).
    """
    if len(positions) == 0:
        return 1.0
    gap = float(np.min(np.linalg.norm(positions, axis=1) - radii))
    return min(max(gap, 0.0) / config.way_free_m, 1.0)


def deviation(covariance: Float[np.ndarray, "2 2"]) -> float:
    """sigma of eq. (2) and (3): root of the largest eigenvalue, m."""
    (a, b), (_, c) = covariance.tolist()
    return math.sqrt(max((a + c) / 2.0 + math.hypot((a - c) / 2.0, b), 0.0))
