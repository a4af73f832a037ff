"""Consistency: does a covariance keep its promise?

The normalised estimation error squared (NEES) of an honest estimate is chi-square with as many degrees of
freedom as the state has; above its band the estimate is over-confident, below it is timid. Errors along
one run resemble each other, so the mean over a run carries less evidence than its samples suggest: the
band of that mean uses the effective number of independent samples.

Source: Bar-Shalom, Li, Kirubarajan 2001, section 5.4.2; Geyer 1992, section 3.3 (effective number).
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.special import chdtri

from perception.localisation.consistency import calibration

BAND = 0.95


def nees(
    errors: Float[np.ndarray, "n k"], covariances: Float[np.ndarray, "n k k"]
) -> Float[np.ndarray, "n"]:
    """e^T P^-1 e of each sample; infinite where P is no covariance (not positive definite)."""
    try:
        factors = np.linalg.cholesky(covariances)
        if np.all(np.isfinite(factors)):
            whitened = np.linalg.solve(factors, errors[..., np.newaxis])[..., 0]
            return np.asarray(np.sum(np.square(whitened), axis=1))
    except np.linalg.LinAlgError:
        pass  # some are no covariances: one by one
    result = np.full(len(errors), np.inf)
    for i, (error, covariance) in enumerate(zip(errors, covariances, strict=True)):
        try:
            factor = np.linalg.cholesky(covariance)
        except np.linalg.LinAlgError:
            continue
        if np.all(np.isfinite(factor)):
            result[i] = np.sum(np.square(np.linalg.solve(factor, error)))
    return result


def band(dof: int, samples: float = 1.0, share: float = BAND) -> tuple[float, float]:
    """Where the mean of so many independent NEES lies with the given probability, two-sided.

    Args:
        dof: Size of the state.
        samples: How many; need not be whole.
        share: Probability.
    """
    tail = (1.0 - share) / 2.0
    low, high = chdtri(dof * samples, 1.0 - tail), chdtri(dof * samples, tail)
    return float(low / samples), float(high / samples)


def effective_samples(series: Float[np.ndarray, "n"]) -> float:
    """How many independent samples the series is worth, in [1, n].

    n / (1 + 2 sum of the autocorrelation), summed over pairs of neighbouring lags while these are
    positive.
    """
    n = len(series)
    centred = series - np.mean(series)
    power = float(centred @ centred)
    if n < 4 or power <= 0.0:
        return float(max(n, 1))
    spectrum = np.abs(np.fft.rfft(centred, 2 * n)) ** 2
    correlation = np.fft.irfft(spectrum)[:n] / power
    time = -1.0  # sum of pairs, lag 0 included, counts lag 0 twice
    for lag in range(0, n - 1, 2):
        pair = correlation[lag] + correlation[lag + 1]
        if pair <= 0.0:
            break
        time += 2.0 * float(pair)
    return float(np.clip(n / max(time, 1e-9), 1.0, n))


def consistency_metrics(
    series: Float[np.ndarray, "n"], dof: int, prefix: str, kind: str = "nees"
) -> dict[str, float | bool]:
    """Figures of a NEES (or NIS) series; empty for an empty one.

    Args:
        series: Non-negative; infinite where there was no covariance.
        dof: Size of the state, or of the measurement.
        prefix: Of the names.
        kind: "nees" or "nis", for the names.

    Returns:
        <prefix>_anees (mean), _anees_low and _anees_high (95 % band of that mean, by effective samples),
        _consistent (mean inside it), _nees_inside_share (samples inside the two-sided 95 % band of a
        single one), _nees_above_share (samples above it: over-confidence), _effective_samples,
        _calibration_error (mean distance of the calibration curve from the diagonal);
        _no_covariance_share where some covariances were none (left out of the mean).
    """
    usable = series[np.isfinite(series)]
    if len(series) == 0:
        return {}
    low, high = band(dof)
    figures: dict[str, float | bool] = {
        f"{prefix}_{kind}_inside_share": float(np.mean((series >= low) & (series <= high))),
        f"{prefix}_{kind}_above_share": float(np.mean(series > high)),
        f"{prefix}_calibration_error": calibration_error(series, dof),
    }
    if len(usable) < len(series):
        figures[f"{prefix}_no_covariance_share"] = 1.0 - len(usable) / len(series)
    if len(usable):
        effective = effective_samples(usable)
        mean_low, mean_high = band(dof, effective)
        mean = float(np.mean(usable))
        figures |= {
            f"{prefix}_a{kind}": mean,
            f"{prefix}_a{kind}_low": mean_low,
            f"{prefix}_a{kind}_high": mean_high,
            f"{prefix}_effective_samples": effective,
            f"{prefix}_consistent": len(usable) == len(series) and mean_low <= mean <= mean_high,
        }
    return figures


def calibration_error(series: Float[np.ndarray, "n"], dof: int) -> float:
    """Mean distance of the calibration curve from the diagonal: 0 if every region holds what it claims."""
    claimed, found = calibration(series, dof)
    return float(np.mean(np.abs(found - claimed)))


def over_runs(
    series: Float[np.ndarray, "runs n"], dof: int
) -> tuple[Float[np.ndarray, "n"], float]:
    """The textbook test over several runs: the mean NEES of every instant, and the share in its band.

    Args:
        series: NEES of each run at the same instants.
        dof: Size of the state.
    """
    mean = series.mean(axis=0)
    low, high = band(dof, float(len(series)))
    return mean, float(np.mean((mean >= low) & (mean <= high)))
