"""Probability of contact with what may move, on a plan.

The error of the pose, that of the size, and the modes of motion of every obstacle count together. The horizon of the
bound, and of what is claimed, is short: what lies beyond it the robot decides anew, with new detections. The cost of a
plan counts the risk until its end. Of an obstacle that more likely stands only the chance that it goes counts: its place
is kept clear by the distances of the guard and by the occupied cells.

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
from ._guard_arguments import Movers
from .ahead import Ahead, may_move
from .guard_settings import (
    ESCAPE_M,
    EXPECTED_CONTACT_M,
    RISK_S,
    SIZE_SIGMA_M,
    GuardConfig,
)
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
    ) -> None:
        """Predict them.

        Args:
            robot: Gaussian over (x, y, yaw) where plans begin, half a step from now, world frame, m and rad.
            obstacles: Tracks at the present time, world frame.
            stamp_s: Present time.
            config: Settings of the guard.
            model: Size of the body, length of a step.
            patterns: Motion patterns learnt from the tracks.
        """
        half = model.gait.step_s / 2.0
        self.steps = min(max(round(RISK_S / model.gait.step_s), 1), config.steps)
        """Footsteps in the time of the bound."""
        escape_s = ESCAPE_M * model.breadth / model.gait.max_speed_mps
        self._rests = max(round(escape_s / model.gait.step_s), 1)
        times = half * np.arange(1, 2 * (config.steps + self._rests) + 1)
        movers = [one for one in obstacles if may_move(one)]
        doubt = robot.covariance[:2, :2] + np.eye(2) * SIZE_SIGMA_M**2
        ways = [Ahead.of(one, stamp_s, times, patterns) for one in movers]
        shape = (len(movers), len(times), max((one.weights.shape[1] for one in ways), default=1))
        weights, means = np.zeros(shape), np.zeros((*shape, 2))
        covariances = np.zeros((*shape, 2, 2))
        for k, (one, ahead) in enumerate(zip(movers, ways, strict=True)):
            own = slice(ahead.weights.shape[1])
            weights[k, :, own], means[k, :, own] = ahead.weights, ahead.means
            if one.moving < MOVING:
                weights[k, :, : GOING if one.motion is not None else 1] = 0.0
            covariances[k, :, own] = ahead.covariances + doubt
        radii = np.array([model.radius_m + one.radius_m for one in movers], np.float64)
        widest = _risk_kernels.spreads(covariances)
        self._movers = Movers(weights, means, covariances, widest, radii)

    def of(
        self,
        places: Float[np.ndarray, "c n 3"],
        robot: Float[np.ndarray, "3"],
        to_the_end: bool = False,
    ) -> Float[np.ndarray, "c"]:
        """Probability of contact on every plan, in the time of the bound or until its end.

        Args:
            places: The body in the middle and at the end of every step, x, y, yaw, world frame, m and rad.
            robot: The body where plans begin.
            to_the_end: Until the end of the plans, and some steps of standing.
        """
        samples, rests = (places.shape[1], self._rests) if to_the_end else (2 * self.steps, 0)
        found: np.ndarray = _risk_kernels.risks(robot, places, samples, rests, self._movers)
        return found

    def cheapest(
        self,
        places: Float[np.ndarray, "c n 3"],
        costs: Float[np.ndarray, "c"],
        robot: Float[np.ndarray, "3"],
    ) -> int:
        """Number of the plan with the least expected cost: its own, m, and that of a contact until its end."""
        found: int = _risk_kernels.cheapest(
            robot, places, self._rests, self._movers, costs, EXPECTED_CONTACT_M
        )
        return found
