"""Probability of contact with what may move, on a plan.

The error of the pose, that of the size, and the modes of motion of every obstacle count together. The horizon of the
bound is short: what lies beyond it the robot decides anew, with new detections. Of an obstacle that more likely stands only the
chance that it goes counts: its place is kept clear by the distances of the guard and by the occupied cells.

Source: ours; chance constraints as in Blackmore, Ono and Williams 2011, over a mixture of motion modes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from perception.primitives.gaussian import Gaussian
from perception.primitives.motion import GOING
from perception.primitives.obstacle import MOVING, Obstacle
from perception.primitives.robot_model import RobotModel

from . import _risk_kernels
from ._guard_arguments import Gait
from .guard_settings import RISK_S, SIZE_SIGMA_M, GuardConfig
from .hypotheses import Ahead, may_move
from .prediction import MotionPatterns


class Risk:
    """The obstacles that may move, predicted for the next seconds."""

    def __init__(
        self,
        robot: Gaussian,
        obstacles: Sequence[Obstacle],
        stamp_s: float,
        config: GuardConfig,
        model: RobotModel,
        patterns: MotionPatterns,
        horizon_s: float = RISK_S,
    ) -> None:
        """Predict them.

        Args:
            robot: Gaussian over (x, y, yaw) where plans begin, half a step from now, world frame, m and rad.
            obstacles: Tracks at the present time, world frame.
            stamp_s: Present time.
            config: Settings of the guard.
            model: Size of the body, length of a step.
            patterns: Motion patterns learnt from the tracks.
            horizon_s: For how long.
        """
        half = model.gait.step_s / 2.0
        self.steps = max(round(horizon_s / model.gait.step_s), 1)
        """Footsteps in that time."""
        times = half * np.arange(1, 2 * self.steps + 1)
        movers = [one for one in obstacles if may_move(one)]
        doubt = robot.covariance[:2, :2] + np.eye(2) * SIZE_SIGMA_M**2
        modes = max((5 if one.motion is not None else 2 for one in movers), default=1)
        shape = (len(movers), len(times), modes)
        self._weights, self._means = np.zeros(shape), np.zeros((*shape, 2))
        self._covariances = np.zeros((*shape, 2, 2))
        for k, one in enumerate(movers):
            ahead = Ahead.of(one, stamp_s, times, patterns, config)
            own = slice(ahead.weights.shape[1])
            self._weights[k, :, own], self._means[k, :, own] = ahead.weights, ahead.means
            if one.moving < MOVING:
                self._weights[k, :, : GOING if one.motion is not None else 1] = 0.0
            self._covariances[k, :, own] = ahead.covariances + doubt
        self._radii = np.array([model.radius_m + one.radius_m for one in movers], np.float64)

    def of(
        self,
        plans: Float[np.ndarray, "c 8"],
        robot: Float[np.ndarray, "3"],
        target: Float[np.ndarray, "2"],
        gait: Gait,
    ) -> Float[np.ndarray, "c"]:
        """Probability of contact on every plan of the guard."""
        found: np.ndarray = _risk_kernels.risks(
            robot,
            np.ascontiguousarray(plans),
            target,
            gait,
            self._weights,
            self._means,
            self._covariances,
            self._radii,
        )
        return found
