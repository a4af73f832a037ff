"""Whether gyro and steps agree about the turn of the body, and how precise steps are.

The gyro is far more precise than a step, so the noise of steps is learnt from it; over whole steps, since the parts of a
step slip together. When the two differ by more than noise, either the gyro has another bias or the feet slide, of which
nobody can tell at first. Then bias and drift of the heading are both as uncertain as the two differ, and what is seen
decides. Until bias and drift are usual again, the slip of the steps is uncertain too; then the slip from before holds
again. A fault may end as suddenly as it came: when the turns agree again with bias and drift as they were before it, these
hold again as well.

Source: ours.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from jaxtyping import Float

from ..filtering.consistency import chi_square_quantile
from ..filtering.models import DRIFT, GYRO_BIAS, LATERAL_SLIP, SLIP, TURN, YAW, X, Y
from ..monitoring.agreement import Bias
from ..primitives.gaussian import Gaussian
from ..primitives.pose import Pose2
from .noise_factor import NoiseFactor

TURNS = 6  # ours: turns that are tested together; two seconds
LEAST_NIS = 0.9  # ours: nearly all that a step errs by is new
WHOLE_STEP = 0.9  # ours: of a footstep; parts are told in rounded shares
SLIDES = 0.5  # ours: share of a step by which feet may slide that turn otherwise than the gyro
UNUSUAL = 4.0  # ours: deviations of drift and bias from which on one of them is still doubted
MOST_BIAS, MOST_DRIFT, MOST_SLIP = 1.0, 1.0, 0.2
"""Ours: rad/s, rad per step and m per step; nobody walks beyond."""
LIKELY = chi_square_quantile(1.0 - 1e-7, 1)
"""Ours: of a turn alone; a walk has thousands, and a foot may slip once."""
TURNED = np.ix_((YAW, TURN), (YAW, TURN))
PLACE, SLIPS = [X, Y], [SLIP, LATERAL_SLIP]
LASTING = [*SLIPS, DRIFT, GYRO_BIAS]
"""Entries of the state that a fault makes uncertain."""


class TurnCheck:
    """Compares the turns of a walk, from frame to frame."""

    def __init__(self, start: Gaussian) -> None:
        """Begin before the first turn.

        Args:
            start: Whole state; the standard deviations of its drift and gyro bias are the usual ones.
        """
        self._before = _lasting(start)  # while all was well
        self._usual = np.diag(self._before.covariance)[2:]
        self.factor = NoiseFactor(LEAST_NIS)
        """Of the noise of steps."""
        self.agree = True
        """Whether gyro and steps agree about the latest turn, and about those before together."""
        self._bias, self._as_before = Bias(1, TURNS), Bias(1, TURNS)
        self._walked: deque[float] = deque(maxlen=TURNS)  # m, of the latest turns
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
    ) -> Gaussian | None:
        """Compare the turn by the gyro with that by the steps.

        Args:
            state: Before the turn, entries as in `filtering.models`.
            turn_rad: By the gyro.
            sigma_rad: Its standard deviation.
            motion: By the steps, body frame.
            steps: Footsteps made.
            dt: Time passed, s, positive.
            noise: Covariance that the motion adds to the state; receives what the two differ by.

        Returns:
            As before a fault that is over, the first entries of `LASTING`: the slips, and if the turns show it drift
            and bias too; None otherwise.
        """
        along, entries = np.array([steps, dt]), LASTING[2:]
        differs, new = turn_rad - motion.yaw, float(noise[TURN, TURN]) + sigma_rad**2
        present = Gaussian(state.mean[entries], state.covariance[np.ix_(entries, entries)])
        off, variance, fit = _compared(self._bias, present, along, differs, new)
        spread = np.square(present.mean) + np.diag(present.covariance)
        agreed, self.agree = self.agree, fit and bool(np.all(spread <= UNUSUAL**2 * self._usual))
        self._walked.append(math.hypot(motion.x, motion.y))
        if self.agree:
            self._learn(off, variance, steps)
            if not agreed:
                return Gaussian(self._before.mean[:2], self._before.covariance[:2, :2])
            self._before = _lasting(state)
            return None
        if agreed:
            self._as_before = Bias(1, TURNS, agrees=False)
            noise[TURNED] += float(self._bias.total[0]) ** 2
            noise[PLACE, PLACE] += (SLIDES * sum(self._walked)) ** 2
        if steps > 0.0 and self._ended(along, differs, new):
            self._bias = Bias(1, TURNS)
            return self._before
        if not fit:
            noise[TURNED] += min(abs(off), math.pi) ** 2
            noise[GYRO_BIAS, GYRO_BIAS] += min(abs(off) / dt, MOST_BIAS) ** 2
        if steps > 0.0:
            if not fit:
                noise[DRIFT, DRIFT] += min(abs(off) / steps, MOST_DRIFT) ** 2
            slide_m = min(SLIDES * math.hypot(motion.x, motion.y) / steps, MOST_SLIP)
            lacks = slide_m**2 - np.diag(state.covariance)[SLIPS]
            noise[SLIPS, SLIPS] += np.maximum(lacks, 0.0)
        return None

    def _ended(self, along: Float[np.ndarray, "2"], differs: float, new: float) -> bool:
        """Whether the turns of a whole window are those of drift and bias as before the fault."""
        before = Gaussian(self._before.mean[2:], self._before.covariance[2:, 2:])
        _, _, fit = _compared(self._as_before, before, along, differs, new)
        return fit and self._as_before.full

    def _learn(self, off: float, variance: float, steps: float) -> None:
        """Learn the noise of steps at the end of each."""
        if steps > 0.0:
            self._step += (off, variance, steps)
            if self._step[2] >= WHOLE_STEP:
                self.factor.learn(float(self._step[0] ** 2 / self._step[1]))
                self._step[:] = 0.0


def _lasting(state: Gaussian) -> Gaussian:
    """The entries `LASTING` of a whole state."""
    return Gaussian(state.mean[LASTING], state.covariance[np.ix_(LASTING, LASTING)])


def _compared(
    window: Bias, state: Gaussian, along: Float[np.ndarray, "2"], differs: float, new: float
) -> tuple[float, float, bool]:
    """Innovation of a turn with drift and bias of that state, its variance, and whether it fits, alone and in a window."""
    off = differs - float(along @ state.mean)
    variance = float(along @ state.covariance @ along) + new
    together = window.update(np.array([off]), np.array([[variance]]))
    return off, variance, together and off**2 <= LIKELY * variance
