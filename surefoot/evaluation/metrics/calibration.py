"""How far claims can be trusted: direction and factor, CRPS, inflation and conformal regions.

Source: Gneiting and Raftery 2007, eq. (21) (CRPS of a Gaussian); Vovk et al. 2005, Lei et al. 2018 (split conformal
prediction); Bar-Shalom et al. 2001, section 5.4 (NEES).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import ndtr

from perception.filtering.consistency import chi_square_quantile

from .consistency import squared

SHARE = 0.90
TOO_SURE, TOO_CAREFUL, IN_BAND = "too sure", "too careful", "as good as claimed"


def crps(
    errors: Float[np.ndarray, "*n"], sigmas: Float[np.ndarray, "*n"]
) -> Float[np.ndarray, "*n"]:
    """Continuous ranked probability score of Gaussian claims, in the unit of the errors; small is good.

    sigma (z (2 Phi(z) - 1) + 2 phi(z) - 1 / sqrt(pi)) with z = error / sigma; the absolute error where sigma is 0.
    """
    known = sigmas > 0.0
    sigma = np.where(known, sigmas, 1.0)
    z = errors / sigma
    density = np.exp(-0.5 * z**2) / math.sqrt(2.0 * math.pi)
    score = sigma * (z * (2.0 * ndtr(z) - 1.0) + 2.0 * density - 1.0 / math.sqrt(math.pi))
    return np.asarray(np.where(known, score, np.abs(errors)))


def verdict(mean: float, low: float, high: float, dof: int) -> tuple[str, float]:
    """Direction of a mean NEES against its band, and the factor between errors and claimed sigmas, at least 1.

    Args:
        mean: Mean NEES.
        low, high: Its band.
        dof: Its degrees of freedom, the mean if the claims are exact.
    """
    ratio = math.sqrt(mean / dof)
    if mean > high:
        return TOO_SURE, ratio
    if mean < low:
        return TOO_CAREFUL, 1.0 / max(ratio, 1e-12)
    return IN_BAND, max(ratio, 1.0 / max(ratio, 1e-12))


def conformal_radius(scores: Float[np.ndarray, "n"]) -> float:
    """Radius that holds a new score with probability `SHARE` at least, if the scores are exchangeable.

    The ceil((n + 1) SHARE)-th smallest score; infinite with too few of them.
    """
    rank = math.ceil((len(scores) + 1) * SHARE)
    return float(np.sort(scores)[rank - 1]) if rank <= len(scores) else math.inf


def coverage_sigma(fitted: int, tested: int) -> float:
    """Standard deviation by chance of the coverage of a conformal region, for independent scores.

    Both ends count: a radius fitted on n scores holds a share that scatters as Beta(n SHARE, n (1 - SHARE)), and m tested
    scores scatter about that share.
    """
    return math.sqrt(SHARE * (1.0 - SHARE) * (1.0 / fitted + 1.0 / tested))


def correlation_time(outside: Sequence[Bool[np.ndarray, "n"]]) -> float:
    """How many successive scores count as one independent score, for the coverage of a region; at least 1.

    1 + 2 sum rho(k), the autocorrelation of being outside, up to the first lag at which it is not positive. Failures
    come in bursts, so that scores may be alike even where their errors are not correlated.

    Args:
        outside: Of each series, whether a score is outside its region, in order of time.

    Source: Geyer 1992, section 3.3 (initial positive sequence).
    """
    away = [np.asarray(one, np.float64) - (1.0 - SHARE) for one in outside]
    variance = sum(float(one @ one) for one in away)
    found = 1.0
    for lag in range(1, max(map(len, away))):
        alike = sum(float(one[:-lag] @ one[lag:]) for one in away if len(one) > lag) / variance
        if alike <= 0.0:
            break
        found += 2.0 * alike
    return found


def by_halves(whitened: Float[np.ndarray, "n k"]) -> dict[str, float]:
    """What is fitted on the first half of a series and tested on the second.

    Args:
        whitened: Whitened errors in order of time, finite.

    Returns:
        inflation: factor for the claimed sigmas that makes the mean NEES of the first half right.
        conformal_radius: radius of the 90 % region, in claimed sigmas, by split conformal prediction.
        gaussian_radius: the same by the chi-square distribution of exact claims.
        coverage_claimed, coverage_inflated, coverage_conformal: shares of the second half inside the 90 % regions.
        Empty with fewer than 20 samples in each half.
    """
    half = len(whitened) // 2
    if half < 20:
        return {}
    dof = whitened.shape[1]
    scores = np.sqrt(squared(whitened))
    first, second = scores[:half], scores[half:]
    inflation = float(np.sqrt(np.mean(first**2) / dof))
    exact = math.sqrt(chi_square_quantile(SHARE, dof))
    radius = conformal_radius(first)
    return {
        "inflation": inflation,
        "conformal_radius": radius,
        "gaussian_radius": exact,
        "coverage_claimed": float(np.mean(second <= exact)),
        "coverage_inflated": float(np.mean(second <= exact * inflation)),
        "coverage_conformal": float(np.mean(second <= radius)),
    }
