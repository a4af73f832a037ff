"""Model predictive path integral control among moving discs, a baseline for the guard.

Turns and speeds are sampled about the last plan; the plan becomes their mean, weighted by cost. Costs: distance to the
target, contact with a disc at constant velocity, contact with an occupied cell.

Source: Williams et al. 2017, "Information theoretic MPC for model-based reinforcement learning" (ICRA), algorithm 2.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import Obstacle
from perception.primitives.robot_model import RobotModel
from planning.commands import WalkCommand
from planning.footsteps import limited_step

from .dynamic_window import BASELINE_MARGIN_M

SAMPLES, STEPS = 400, 20  # several hundred trajectories of 4 s, as Trevisan et al. 2025
SPREAD = (0.3, 0.5)  # standard deviations: of the speed in top speeds, of the turn in largest turns
TEMPERATURE = 0.5  # lambda
CONTACT_COST = 100.0  # per sample in contact


class PathIntegral:
    """Keeps the plan of the last step."""

    def __init__(self, robot: RobotModel) -> None:
        self._robot, self._rng = robot, np.random.default_rng(0)
        self._plan = np.tile([robot.gait.cruise_mps, 0.0], (STEPS, 1))

    def choose(
        self,
        desired: WalkCommand,
        robot: Gaussian,
        obstacles: Sequence[Obstacle],
        occupied: Float[np.ndarray, "n 2"],
        target: Float[np.ndarray, "2"],
        stamp_s: float,
        unseen: Float[np.ndarray, "k 2"] | None = None,
    ) -> WalkCommand:
        """The first step of the weighted plan."""
        gait, dt = self._robot.gait, self._robot.gait.step_s
        self._plan = np.concatenate([self._plan[1:], self._plan[-1:]])
        scale = np.array([SPREAD[0] * gait.max_speed_mps, SPREAD[1] * gait.max_turn_rad])
        tried = self._plan + scale * self._rng.standard_normal((SAMPLES, STEPS, 2))
        tried[0] = self._plan
        tried[..., 0] = np.clip(tried[..., 0], -gait.max_back_mps, gait.max_speed_mps)
        tried[..., 1] = np.clip(tried[..., 1], -gait.max_turn_rad, gait.max_turn_rad)
        yaw = robot.mean[2] + np.cumsum(tried[..., 1], axis=1) - tried[..., 1]
        x = robot.mean[0] + np.cumsum(dt * tried[..., 0] * np.cos(yaw), axis=1)
        y = robot.mean[1] + np.cumsum(dt * tried[..., 0] * np.sin(yaw), axis=1)
        cost = np.hypot(x - target[0], y - target[1]).sum(axis=1) * dt
        times = dt * np.arange(1, STEPS + 1)
        for one in obstacles:
            ahead = one.position + times[:, None] * one.velocity
            near = self._robot.radius_m + one.radius_m + BASELINE_MARGIN_M
            cost += CONTACT_COST * (np.hypot(x - ahead[:, 0], y - ahead[:, 1]) < near).sum(axis=1)
        reach = gait.max_speed_mps * times[-1]
        cells = occupied[np.hypot(*(occupied - robot.mean[:2]).T) < reach]
        if len(cells):
            gap = np.min(
                [np.hypot(x - cx, y - cy) for cx, cy in cells[:: max(len(cells) // 40, 1)]], axis=0
            )
            cost += CONTACT_COST * (gap < self._robot.radius_m + BASELINE_MARGIN_M).sum(axis=1)
        weights = np.exp(-(cost - cost.min()) / TEMPERATURE)
        self._plan = np.einsum("k,kti->ti", weights / weights.sum(), tried)
        speed, turn = self._plan[0].tolist()
        return limited_step(gait, speed, 0.0, turn)
