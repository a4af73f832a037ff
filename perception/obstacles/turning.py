"""A speed that flips its sign at random: what may have become of a mover while it was out of sight.

Movers go to and fro. Between two sightings such a thing either went straight on or turned, once or several
times; the moments of both follow from how often it turns (a random telegraph signal, integrated).

Source: Papoulis, "Probability, Random Variables and Stochastic Processes" (1965), section 9-2; the share that
never flipped is taken out by us.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from . import _track_kernels


@dataclass(frozen=True)
class Turning:
    """A speed whose sign flips at random, after some time: a random telegraph signal.

    Args:
        straight: Probability that it has not flipped.
        seconds: That time, s.
        move_s: If it has: mean place, in units of the first velocity, s.
        keep: If it has: mean velocity in the same units.
        noise: If it has: covariance of (place, velocity) for a velocity whose mean square is 1.
    """

    straight: float
    seconds: float
    move_s: float
    keep: float
    noise: Float[np.ndarray, "2 2"]


def turning(seconds: float, every_s: float) -> Turning:
    """Moments of a telegraph signal that flips on average every so many seconds.

    With a = 2 / every_s, e = exp(-a t) and m = (1 - e) / a, all flips counted, the velocity has mean e and
    mean square 1, the place has mean m and mean square 2 (t - m) / a, and their product has mean m. The
    share exp(-t / every_s) that never flipped, gone straight to t, is taken out of these.
    """
    straight, t, move, keep, square, product, speed = _track_kernels.telegraph(seconds, every_s)
    return Turning(straight, t, move, keep, np.array([[square, product], [product, speed]]))
