"""Where an obstacle will be: its modes of motion predicted without detections.

Source: Blom and Bar-Shalom 1988 (interacting multiple models); ours: a velocity taken anew stays apart from the
one observed, so that the forecast keeps its sharp part.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..primitives.motion import MODES
from ..primitives.obstacle import Obstacle
from . import _track_kernels
from ._track_kernels import CURVING, REST, STILL, STRAIGHT, TURNED
from .habits import pushes

AS_OBSERVED = (STRAIGHT, CURVING)
"""Modes that keep the velocity observed."""


@dataclass(frozen=True, eq=False)
class Forecast:
    """Modes at n times.

    Args:
        probabilities: (n, m); rows sum to 1.
        means: (n, m, 4) over (x, y, vx, vy), world frame, m and m/s.
        covariances: (n, m, 4, 4).
    """

    probabilities: Float[np.ndarray, "n m"]
    means: Float[np.ndarray, "n m 4"]
    covariances: Float[np.ndarray, "n m 4 4"]


def forecast(obstacle: Obstacle, times_s: Float[np.ndarray, "n"]) -> Forecast:
    """The modes of a tracked obstacle at times from the present on, ascending.

    Its probability of moving, which weighs more than the filter knows, replaces that of the filter.

    Raises:
        ValueError: The obstacle has no modes.
    """
    motion = obstacle.motion
    if motion is None:
        raise ValueError(f"track {obstacle.track} has no modes of motion")
    rates = motion.rates.copy()
    rates[TURNED, AS_OBSERVED] = 0.0
    weights, x, P = motion.probabilities.copy(), motion.means.copy(), motion.covariances.copy()
    stands = 1.0 - obstacle.moving
    if stands > weights[STILL]:  # what only seems to move stands where it is now
        mean, covariance = np.empty(4), np.empty((4, 4))
        _track_kernels.merge(weights, x, P, mean, covariance)
        mean[2:] = covariance[2:] = covariance[:, 2:] = 0.0
        covariance[[2, 3], [2, 3]] = REST
        shares = np.array([weights[STILL], stands - weights[STILL]]) / stands
        rates[STILL] *= shares[0]
        pair = np.stack([x[STILL], mean]), np.stack([P[STILL], covariance])
        _track_kernels.merge(shares, *pair, x[STILL], P[STILL])
    weights[STILL] = 0.0
    weights *= obstacle.moving / weights.sum()
    weights[STILL] = stands
    n, m = len(times_s), len(MODES)
    probabilities, means = np.empty((n, m)), np.empty((n, m, 4))
    covariances = np.empty((n, m, 4, 4))
    belief = _track_kernels.Belief(weights, x, P)
    found = probabilities, means, covariances
    fresh = np.ascontiguousarray(motion.fresh)
    _track_kernels.forecast(belief, rates, fresh, pushes(fresh), times_s, *found)
    return Forecast(*found)
