"""Paired differences: how large they are, with an interval, and whether chance explains them.

The test is Wilcoxon's signed rank test: if neither side is better, each difference is as likely to have one sign as the
other. Its distribution is exact, also with equal sizes; zeros are left out. The estimate is that of Hodges and Lehmann,
the median of the means of all pairs of differences, and the interval is the one that belongs to the test. A single
recording that went astray moves none of them far. Several figures are judged together: Holm's correction keeps the
probability of calling any of them different, where none is, below the given rate.

Sources: F. Wilcoxon 1945; J. L. Hodges, E. L. Lehmann 1963; S. Holm 1979; M. Hollander, D. A. Wolfe, E. Chicken,
*Nonparametric statistical methods*, 2014, sections 3.1 to 3.3.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.stats import norm, rankdata

EXACT = 200  # ours: differences up to which the distribution is exact; beyond, the normal one is as good
LEVEL = 0.95  # of the intervals
HALVINGS = 80  # of an interval that holds a mean of two differences


@dataclass(frozen=True)
class Paired:
    """Differences of pairs.

    Args:
        number: Pairs.
        equal: Pairs without any difference.
        typical: Hodges-Lehmann estimate of the difference; NaN without pairs.
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
    means = len(d) * (len(d) + 1) // 2
    middle = (_mean_of_pair(d, (means + 1) // 2) + _mean_of_pair(d, means // 2 + 1)) / 2.0
    cut = _critical(len(d), (1.0 - LEVEL) / 2.0)
    low, high = -math.inf, math.inf
    if cut >= 0:
        low, high = _mean_of_pair(d, cut + 1), _mean_of_pair(d, means - cut)
    return Paired(len(d), len(d) - len(nonzero), middle, low, high, probability(nonzero))


def probability(differences: Float[np.ndarray, "n"]) -> float:
    """Two-sided p-value of the signed rank test; the differences are not zero."""
    ranks = rankdata(np.abs(differences))
    positive = float(ranks[differences > 0.0].sum())
    if len(ranks) > EXACT:
        sigma = math.sqrt(float(np.sum(ranks**2)) / 4.0)
        away = max(0.0, abs(positive - float(ranks.sum()) / 2.0) - 0.5)
        return min(1.0, 2.0 * float(norm.sf(away / sigma)))
    chances = _distribution(np.round(2.0 * ranks).astype(np.int64))
    at = round(2.0 * positive)
    return float(min(1.0, 2.0 * min(chances[: at + 1].sum(), chances[at:].sum())))


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


def _distribution(doubled: np.ndarray) -> Float[np.ndarray, "m"]:
    """Probability of each sum of those (doubled) ranks that are positive, if every sign is a toss of a coin."""
    chances = np.zeros(int(doubled.sum()) + 1)
    chances[0] = 1.0
    for rank in doubled:
        moved = np.zeros_like(chances)
        moved[rank:] = chances[: len(chances) - rank]
        chances = (chances + moved) / 2.0
    return chances


def _critical(number: int, tail: float) -> int:
    """Largest rank sum whose probability of being reached or undercut is at most `tail`; -1 if there is none."""
    if number > EXACT:
        sigma = math.sqrt(number * (number + 1) * (2 * number + 1) / 24.0)
        return math.floor(number * (number + 1) / 4.0 + float(norm.ppf(tail)) * sigma - 0.5)
    below = np.cumsum(_distribution(2 * np.arange(1, number + 1))[::2])
    return int(np.searchsorted(below, tail, side="right")) - 1


def _mean_of_pair(d: Float[np.ndarray, "n"], place: int) -> float:
    """The mean of two differences (also of one with itself) that is at a place, from 1, in the order of all of them.

    It is found by halving an interval and counting, so that the n (n + 1) / 2 means are never made.
    """
    low, high = float(d[0]), float(d[-1])
    for _ in range(HALVINGS):
        middle = low + (high - low) / 2.0
        if not low < middle < high:
            break
        up_to = int(np.searchsorted(d, 2.0 * middle - d, side="right").sum())
        if (up_to + int(np.searchsorted(d, middle, side="right"))) // 2 >= place:
            high = middle
        else:
            low = middle
    return high
