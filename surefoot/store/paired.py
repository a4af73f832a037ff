"""Paired differences: how large they are, with an interval, and whether chance explains them.

The test is the signed rank test with winsorised ranks: if neither side is better, each difference is as likely to have one sign
as the other; large differences count by their rank among the sizes, but the larger half of them alike, so that a few
recordings that went astray do not decide. Its distribution is exact, also with equal sizes; zeros are left out. The
estimate is the shift of the differences at which the statistic vanishes (as Hodges and Lehmann's is of the plain test), and
the interval holds the shifts that the test does not reject. Several figures are judged together: Holm's correction keeps
the probability of calling any of them different, where none is, below the given rate.

Sources: F. Wilcoxon 1945; J. L. Hodges, E. L. Lehmann 1963; G. E. Policello, T. P. Hettmansperger 1976 (winsorised
scores); S. Holm 1979.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.stats import norm

EXACT = 200  # ours: differences up to which the distribution is exact; beyond, the normal one is as good
LEVEL = 0.95  # of the intervals
CAP = 0.5  # ours: share of the ranks from which on they count alike; 1 would be Wilcoxon's test, 0 the sign test
HALVINGS = 60  # of an interval that holds a bound


@dataclass(frozen=True)
class Paired:
    """Differences of pairs.

    Args:
        number: Pairs.
        equal: Pairs without any difference.
        typical: Estimate of the difference; NaN without pairs.
        low, high: 95 % interval of it; infinite with too few pairs.
        probability: Of differences as one-sided as these if neither side is better (two-sided p-value).
    """

    number: int
    equal: int
    typical: float
    low: float
    high: float
    probability: float


def paired(differences: Float[np.ndarray, "n"]) -> Paired:
    """Estimate, interval and test of paired differences."""
    d = np.sort(np.asarray(differences, dtype=np.float64))
    nonzero = d[d != 0.0]
    if len(nonzero) == 0:
        typical = 0.0 if len(d) else math.nan
        return Paired(len(d), len(d), typical, typical, typical, 1.0)
    typical = (_crossing(d, 0, False) + _crossing(d, 0, True)) / 2.0
    most = _accepted(len(d))
    low, high = -math.inf, math.inf
    if most is not None:
        low, high = _crossing(d, most, False), _crossing(d, -most, True)
    return Paired(len(d), len(d) - len(nonzero), typical, low, high, probability(nonzero))


def probability(differences: Float[np.ndarray, "n"]) -> float:
    """Two-sided p-value of the test; the differences are not zero."""
    scores = _scores(np.abs(differences))
    at = abs(int(np.sign(differences) @ scores))
    if len(scores) > EXACT:
        sigma = math.sqrt(float(np.sum(scores.astype(np.float64) ** 2)))
        return min(1.0, 2.0 * float(norm.sf(max(0.0, at - 1.0) / sigma)))
    chances = _distribution(scores)  # of the sum of the positive ones: (at + all) / 2
    return min(1.0, 2.0 * float(chances[(at + int(scores.sum())) // 2 :].sum()))


def fewest(figures: int, rate: float) -> int:
    """The number of differing pairs from which the test can find a difference among so many figures at all."""
    return math.ceil(1.0 + math.log2(max(figures, 1) / rate))


def holm(probabilities: Sequence[float]) -> list[float]:
    """Holm's adjusted p-values: those below a rate are different, with that rate of false alarms over all of them."""
    order = np.argsort(probabilities)
    adjusted, largest = [0.0] * len(order), 0.0
    for place, which in enumerate(order):
        largest = max(largest, min(1.0, (len(order) - place) * probabilities[which]))
        adjusted[which] = largest
    return adjusted


def _scores(sizes: Float[np.ndarray, "n"]) -> Int[np.ndarray, "n"]:
    """Twice the rank of each size, equal ones with their mean rank; not more than that of the cap."""
    ordered = np.sort(sizes)
    below, up_to = (np.searchsorted(ordered, sizes, side=side) for side in ("left", "right"))
    return np.minimum(below + up_to + 1, max(2, round(2.0 * CAP * len(sizes))))


def _distribution(scores: Int[np.ndarray, "n"]) -> Float[np.ndarray, "m"]:
    """Probability of each sum of the scores with a positive sign, if every sign is a toss of a coin."""
    chances = np.zeros(int(scores.sum()) + 1)
    chances[0] = 1.0
    for score in scores:
        moved = np.zeros_like(chances)
        moved[score:] = chances[: len(chances) - score]
        chances = (chances + moved) / 2.0
    return chances


def _accepted(number: int) -> int | None:
    """Largest difference of positive and negative scores that the test accepts at `LEVEL`; None if it accepts all."""
    scores, tail = _scores(np.arange(1.0, number + 1.0)), (1.0 - LEVEL) / 2.0
    every = int(scores.sum())
    if number > EXACT:
        return math.ceil(-float(norm.ppf(tail)) * math.sqrt(float(np.sum(scores.astype(np.float64) ** 2))))  # fmt: skip
    above = np.cumsum(_distribution(scores)[::-1])[::-1]  # of at least this sum
    largest = int(np.flatnonzero(above > tail)[-1])
    return None if largest == every else 2 * largest - every


def _crossing(d: Float[np.ndarray, "n"], level: int, below: bool) -> float:
    """The shift from which on the differences less the shift have a statistic of at most `level`, or below it."""
    low, high = float(d[0]) - 1e-12 - 1e-9 * abs(float(d[0])), float(d[-1])
    for _ in range(HALVINGS):
        middle = low + (high - low) / 2.0
        left = d - middle
        found = int(np.sign(left) @ _scores(np.abs(left)))
        if found < level or (found == level and not below):
            high = middle
        else:
            low = middle
    return high
