"""Whether gyro and steps agree about the turn of the body, and how precise steps are.

The gyro is far more precise than a step, so the noise of steps is learnt from it; over whole steps, since the parts of a
step slip together. When the two differ by more than noise, either the gyro has another bias or the feet slide, of which
nobody can tell at first. Then bias and drift of the heading are both as uncertain as the two differ, and what is seen
decides. Until bias and drift are usual again, the slip of the steps is uncertain too.

Source: ours.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from ..filtering.consistency import chi_square_quantile
from ..filtering.models import DRIFT, GYRO_BIAS, LATERAL_SLIP, SLIP, TURN, YAW
from ..monitoring.agreement import DISAGREE, Bias
from ..primitives.gaussian import Gaussian
from ..primitives.pose import Pose2
from .localiser_noise import GYRO_BIAS_SIGMA_RADPS
from .noise_factor import NoiseFactor

TURNS = 6  # ours: turns that are tested together; two seconds
LEAST_NIS = 0.9  # ours: nearly all that a step errs by is new
WHOLE_STEP = 0.9  # ours: of a footstep; parts are told in rounded shares
SLIDES = 0.5  # ours: share of a step by which feet may slide that turn otherwise than the gyro
UNUSUAL = 4.0  # ours: deviations of drift and bias from which on one of them is still doubted
MOST_BIAS, MOST_DRIFT, MOST_SLIP = 1.0, 1.0, 0.2
"""Ours: rad/s, rad per step and m per step; nobody walks beyond."""
TURNED = np.ix_((YAW, TURN), (YAW, TURN))


class TurnCheck:
    """Compares the turns of a walk, from frame to frame."""

    def __init__(self, drift_sigma_rad: float) -> None:
        """Begin before the first turn.

        Args:
            drift_sigma_rad: Usual standard deviation of the drift of the heading, rad per step.
        """
        self._usual = np.square([drift_sigma_rad, GYRO_BIAS_SIGMA_RADPS])
        self.factor = NoiseFactor(LEAST_NIS)
        """Of the noise of steps."""
        self.agree = True
        """Whether gyro and steps agree about the latest turn, and about those before together."""
        self._bias = Bias(1, TURNS)
        self._likely = chi_square_quantile(DISAGREE, 1)
        self._step = np.zeros(3)  # of the present step: difference, its variance, share of the step

    def compare(
        self,
        state: Gaussian,
        turn_rad: float,
        sigma_rad: float,
        motion: Pose2,
        steps: float,
        dt: float,
        noise: Float[np.ndarray, "10 10"],
    ) -> None:
        """Compare the turn by the gyro with that by the steps.

        Args:
            state: Before the turn, entries as in `filtering.models`.
            turn_rad: By the gyro.
            sigma_rad: Its standard deviation.
            motion: By the steps, body frame.
            steps: Footsteps made.
            dt: Time passed, s, positive.
            noise: Covariance that the motion adds to the state; receives what the two differ by.
        """
        along, entries = np.array([steps, dt]), [DRIFT, GYRO_BIAS]
        off = turn_rad - motion.yaw - float(along @ state.mean[entries])
        variance = float(along @ state.covariance[np.ix_(entries, entries)] @ along)
        variance += float(noise[TURN, TURN]) + sigma_rad**2
        together = self._bias.update(np.array([off]), np.array([[variance]]))
        fit = together and off**2 <= self._likely * variance
        spread = np.square(state.mean[entries]) + np.diag(state.covariance)[entries]
        self.agree = fit and bool(np.all(spread <= UNUSUAL**2 * self._usual))
        if self.agree:
            self._learn(off, variance, steps)
            return
        if not fit:
            noise[TURNED] += min(abs(off), math.pi) ** 2
            noise[GYRO_BIAS, GYRO_BIAS] += min(abs(off) / dt, MOST_BIAS) ** 2
        if steps > 0.0:
            if not fit:
                noise[DRIFT, DRIFT] += min(abs(off) / steps, MOST_DRIFT) ** 2
            slide_m = min(SLIDES * math.hypot(motion.x, motion.y) / steps, MOST_SLIP)
            slips = [SLIP, LATERAL_SLIP]
            lacks = slide_m**2 - np.diag(state.covariance)[slips]
            noise[slips, slips] += np.maximum(lacks, 0.0)

    def _learn(self, off: float, variance: float, steps: float) -> None:
        """Learn the noise of steps at the end of each."""
        if steps > 0.0:
            self._step += (off, variance, steps)
            if self._step[2] >= WHOLE_STEP:
                self.factor.learn(float(self._step[0] ** 2 / self._step[1]))
                self._step[:] = 0.0
