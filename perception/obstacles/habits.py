"""How one obstacle is used to move: how often it turns, stops and curves, how long it pauses, how fast it goes.

All of it is learnt from the obstacle itself, from priors that are wide enough for anything that moves. Rooms set the way
between turns, not the time: what is faster turns and stops more often. Turns and starts are not events that a detection
shows; they are counted by the probability of the mode `turned`.

Source: ours; rates are means of gamma distributions, the conjugate prior of a rate.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from ._track_kernels import CURVING, MODES, PAUSING, STILL, STRAIGHT, TURNED

# mean times in a mode, s
STILL_S = 60.0  # ours: a wide prior; until a still obstacle goes, before it has stood
PARKED_S = 10.0  # ours: a wide prior; of standing after which a pausing obstacle is still
PAUSE_S = 3.0  # ours: a wide prior; until a pausing obstacle goes on, before any pause is seen
EVENTS = 0.25  # ours: weak; turns, stops and starts that the prior of their rates is worth
HABIT_M = 6.4  # ours: a wide prior; way at the usual speed until a moving obstacle turns, and until it pauses, before it has shown either
CURVE_S = 30.0  # ours: a wide prior; between straight and curving, if it does both as often
SETTLE_S = 1.0  # ours: a wide prior; until a new velocity counts as straight or curving
SPEED_S = 2.0  # ours: a wide prior; time in motion that the prior speed is worth
CURVES_PER_S = 0.3  # ours: growth of the variance of the velocity while curving, in shares of its mean square speed
STRAIGHT_M2PS3 = 5e-6  # ours: power density of the acceleration while straight: 7 mm/s after 10 s
LONGEST_S = 1.0  # ours: a detection tells of so much of the time since the one before


class Habits:
    """The counts of one obstacle."""

    def __init__(self, speed_sigma_mps: float) -> None:
        """Know nothing but the usual speed per axis, m/s."""
        usual_mps = math.sqrt(2.0) * speed_sigma_mps
        self._turns = self._starts = EVENTS
        self._moved_s, self._paused_s = EVENTS * HABIT_M / usual_mps, EVENTS * PAUSE_S
        self._stood_s = STILL_S
        self._straight_s = self._curved_s = CURVE_S
        self._square, self._square_s = 2.0 * speed_sigma_mps**2, SPEED_S
        self._directions = np.eye(2)  # worth two legs
        self._turned = 1.0  # share of the probability of `TURNED` that went before

    @property
    def fresh(self) -> Float[np.ndarray, "2 2"]:
        """Covariance of a velocity taken anew, m^2/s^2: its mean square speed, in the directions it went."""
        return self._square / float(np.trace(self._directions)) * self._directions

    def rates(self, mover: float) -> Float[np.ndarray, "5 5"]:
        """Rate of every change of mode, 1/s, from row to column.

        Args:
            mover: Probability that it is one that is known to move; what stands then only pauses, and there are as
                many stops as starts.
        """
        rates = np.zeros((MODES, MODES))
        goes_on = self._starts / self._paused_s  # the longer it has stood, the longer it will
        rates[STILL, TURNED] = mover * goes_on + (1.0 - mover) / self._stood_s
        rates[PAUSING, TURNED] = goes_on
        rates[PAUSING, STILL] = 1.0 / PARKED_S
        rates[STRAIGHT:, TURNED] = self._turns / self._moved_s
        rates[STRAIGHT:, PAUSING] = self._starts / self._moved_s
        curves = self._curved_s / (self._straight_s + self._curved_s)
        rates[STRAIGHT, CURVING] = 2.0 * curves / CURVE_S
        rates[CURVING, STRAIGHT] = 2.0 * (1.0 - curves) / CURVE_S
        rates[TURNED, [STRAIGHT, CURVING]] = 0.5 / SETTLE_S
        return rates

    def pass_time(
        self, weights: Float[np.ndarray, "5"], rates: Float[np.ndarray, "5 5"], dt: float
    ) -> None:
        """Tell turns from starts: note which modes change into `TURNED` within a short time dt, s."""
        coming = weights[:TURNED] * rates[:TURNED, TURNED] * dt
        turned = float(coming[STRAIGHT:].sum()) + self._turned * float(weights[TURNED])
        self._turned = turned / (float(coming.sum()) + float(weights[TURNED]))

    def learn(
        self,
        weights: Float[np.ndarray, "5"],
        velocity: Float[np.ndarray, "2"],
        seconds: float,
        mover: float,
    ) -> None:
        """Count what a detection shows; stops and starts only of one that is known to move.

        Args:
            weights: Probabilities of the modes after it.
            velocity: If it does not stand, m/s.
            seconds: Since the detection before.
            mover: As for `rates`.
        """
        seconds = min(seconds, LONGEST_S)
        self._stood_s += float(weights[STILL]) * seconds
        if mover < 1.0:
            return
        settled = float(weights[TURNED]) * seconds / SETTLE_S
        turned = self._turned * settled
        self._turns += turned
        self._starts += settled - turned
        square = float(velocity @ velocity)
        self._directions += turned * np.outer(velocity, velocity) / max(square, 1e-12)
        stands = float(weights[:STRAIGHT].sum())
        self._paused_s += stands * seconds
        self._straight_s += float(weights[STRAIGHT]) * seconds
        self._curved_s += float(weights[CURVING]) * seconds
        moved_s = (1.0 - stands) * seconds
        self._moved_s += moved_s
        self._square_s += moved_s
        self._square += moved_s / self._square_s * (square - self._square)


def pushes(fresh: Float[np.ndarray, "2 2"]) -> Float[np.ndarray, "5"]:
    """Power density of the acceleration per axis in every mode, m^2/s^3.

    While it curves it grows with the usual speed, not with the present one, so that one who slows down may speed up.

    Args:
        fresh: Covariance of a velocity taken anew, m^2/s^2.
    """
    found = np.zeros(MODES)
    found[STRAIGHT:] = STRAIGHT_M2PS3
    found[CURVING] += CURVES_PER_S * float(np.trace(fresh))
    return found
