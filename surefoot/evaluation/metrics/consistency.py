"""Consistency of a covariance with the errors that it describes.

The normalised estimation error squared (NEES) of a consistent estimate is chi-square distributed with as many
degrees of freedom as the state has; above its band the estimate is over-confident, below it under-confident.
Errors within a run are correlated, and errors that are constant within a run (such as joint or range offsets)
count as one sample per run. The band of the mean therefore uses the effective number of independent samples.

Source: Bar-Shalom, Li, Kirubarajan 2001, section 5.4.2; Geyer 1992, section 3.3 (truncation of the sum
over lags); Isserlis 1918 (the squares of Gaussian errors have the squared correlation).
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from perception.filtering.consistency import band, calibration


def whitened(
    errors: Float[np.ndarray, "n k"], covariances: Float[np.ndarray, "n k k"]
) -> Float[np.ndarray, "n k"]:
    """Errors whitened by their covariance: independent with unit variance if it is consistent.

    Infinite where the covariance is not positive definite.
    """
    try:
        factors = np.linalg.cholesky(covariances)
        if np.all(np.isfinite(factors)):
            return np.asarray(np.linalg.solve(factors, errors[..., np.newaxis])[..., 0])
    except np.linalg.LinAlgError:
        pass  # some are not positive definite: factorise one by one
    result = np.full(errors.shape, np.inf)
    for i, (error, covariance) in enumerate(zip(errors, covariances, strict=True)):
        try:
            factor = np.linalg.cholesky(covariance)
        except np.linalg.LinAlgError:
            continue
        if np.all(np.isfinite(factor)):
            result[i] = np.linalg.solve(factor, error)
    return result


def squared(whitened: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n"]:
    """NEES (or NIS) of each sample, e^T P^-1 e, from whitened errors; infinite without a positive definite P."""
    return np.asarray(np.sum(np.square(whitened), axis=1))


def effective_samples(whitened: Float[np.ndarray, "n k"]) -> float:
    """Number of independent samples whose mean NEES has the same variance, in [1, n].

    Args:
        whitened: Whitened errors in order of time.

    n / (1 + 2 sum of (1 - lag / n) r^2), with r the autocorrelation of each component, summed over pairs of
    neighbouring lags while these are positive. The mean is not subtracted, because a consistent error has mean
    zero: a component that is constant within a run is one sample, however many frames the run has. For
    consistent synthetic errors with such a component the 95 % band then holds in 80 to 96 % of the runs (42 to
    75 % with the mean subtracted).
    """
    n, k = whitened.shape
    power = np.sum(np.square(whitened), axis=0)
    if n < 4 or not np.any(power > 0.0):
        return float(max(n, 1))
    spectrum = np.abs(np.fft.rfft(whitened, 2 * n, axis=0)) ** 2
    correlation = np.fft.irfft(spectrum, axis=0)[:n] / np.where(power > 0.0, power, 1.0)
    time = 0.0  # correlation time, summed over the components
    for r in correlation.T:
        pairs = r[: n - n % 2].reshape(-1, 2).sum(axis=1)
        end = 2 * int(np.argmin(np.append(pairs, 0.0) > 0.0))
        overlap = 1.0 - np.arange(end) / n  # the biased r contains this factor once
        time += max(2.0 * float(np.sum(np.square(r[:end]) / overlap)) - 1.0, 1.0)
    return float(np.clip(n * k / time, 1.0, n))


def consistency_metrics(
    whitened: Float[np.ndarray, "n k"], prefix: str, kind: str = "nees"
) -> dict[str, float | bool]:
    """Figures of errors or innovations; empty without samples.

    Args:
        whitened: Whitened errors in order of time; infinite where the covariance is not positive definite.
        prefix: Prefix of the names of the figures.
        kind: "nees" or "nis", part of the names.

    Returns:
        <prefix>_anees (mean), _anees_low and _anees_high (95 % band of the mean, by effective samples),
        _consistent (mean inside the band), _nees_inside_share (samples inside the two-sided 95 % band of one
        sample), _nees_above_share (samples above it: over-confidence), _effective_samples,
        _calibration_error (mean distance of the calibration curve from the diagonal), and, if some
        covariances are not positive definite, _no_covariance_share (left out of the mean).
    """
    if len(whitened) == 0:
        return {}
    series, dof = squared(whitened), whitened.shape[1]
    usable = np.isfinite(series)
    low, high = band(dof)
    figures: dict[str, float | bool] = {
        f"{prefix}_{kind}_inside_share": float(np.mean((series >= low) & (series <= high))),
        f"{prefix}_{kind}_above_share": float(np.mean(series > high)),
        f"{prefix}_calibration_error": calibration_error(series, dof),
    }
    if not usable.all():
        figures[f"{prefix}_no_covariance_share"] = float(np.mean(~usable))
    if usable.any():
        effective = effective_samples(whitened[usable])
        mean_low, mean_high = band(dof, effective)
        mean = float(np.mean(series[usable]))
        figures |= {
            f"{prefix}_a{kind}": mean,
            f"{prefix}_a{kind}_low": mean_low,
            f"{prefix}_a{kind}_high": mean_high,
            f"{prefix}_effective_samples": effective,
            f"{prefix}_consistent": bool(usable.all()) and mean_low <= mean <= mean_high,
        }
    return figures


def calibration_error(series: Float[np.ndarray, "n"], dof: int) -> float:
    """Mean distance of the calibration curve from the diagonal; 0 if every confidence region is exact."""
    nominal, found = calibration(series, dof)
    return float(np.mean(np.abs(found - nominal)))
