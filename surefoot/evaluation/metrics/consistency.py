"""Consistency: does a covariance keep its promise?

The normalised estimation error squared (NEES) of an honest estimate is chi-square with as many degrees of
freedom as the state has; above its band the estimate is over-confident, below it is timid. Errors along
one run resemble each other, and what is constant in it (a joint's zero, a range's offset) is drawn but once:
the mean over a run carries less evidence than its samples suggest, and its band uses the effective number of
independent samples.

Source: Bar-Shalom, Li, Kirubarajan 2001, section 5.4.2; Geyer 1992, section 3.3 (where to end the sum over
lags); Isserlis 1918 (squares of Gaussian errors are correlated by the square of theirs).
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.special import chdtri

from perception.filtering.consistency import calibration

BAND = 0.95


def whitened(
    errors: Float[np.ndarray, "n k"], covariances: Float[np.ndarray, "n k k"]
) -> Float[np.ndarray, "n k"]:
    """Errors in units of their own covariance: independent and of deviation 1 if it is honest.

    Infinite where P is no covariance (not positive definite).
    """
    try:
        factors = np.linalg.cholesky(covariances)
        if np.all(np.isfinite(factors)):
            return np.asarray(np.linalg.solve(factors, errors[..., np.newaxis])[..., 0])
    except np.linalg.LinAlgError:
        pass  # some are no covariances: one by one
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
    """NEES (or NIS) of each sample: e^T P^-1 e; infinite where P is no covariance."""
    return np.asarray(np.sum(np.square(whitened), axis=1))


def nees(
    errors: Float[np.ndarray, "n k"], covariances: Float[np.ndarray, "n k k"]
) -> Float[np.ndarray, "n"]:
    """e^T P^-1 e of each sample; infinite where P is no covariance (not positive definite)."""
    return squared(whitened(errors, covariances))


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


def effective_samples(whitened: Float[np.ndarray, "n k"]) -> float:
    """How many independent samples have a mean NEES that scatters as much as these, in [1, n].

    Args:
        whitened: In order of time.

    n / (1 + 2 sum of (1 - lag / n) r^2), with r the autocorrelation of each component, summed over pairs of
    neighbouring lags while these are positive. An honest error has mean zero, so none is taken off: what
    stays for a whole run is one sample of that component, however many frames it lasts. A run with such a part
    says little: of honest synthetic ones the band then holds 80 to 96 % (42 to 75 % by squares less their mean),
    and deviations twice too large are found in 65 to 92 % of those that have another part, too.
    """
    n, k = whitened.shape
    power = np.sum(np.square(whitened), axis=0)
    if n < 4 or not np.any(power > 0.0):
        return float(max(n, 1))
    spectrum = np.abs(np.fft.rfft(whitened, 2 * n, axis=0)) ** 2
    correlation = np.fft.irfft(spectrum, axis=0)[:n] / np.where(power > 0.0, power, 1.0)
    time = 0.0  # sum over the components
    for r in correlation.T:
        pairs = r[: n - n % 2].reshape(-1, 2).sum(axis=1)
        end = 2 * int(np.argmin(np.append(pairs, 0.0) > 0.0))
        overlap = 1.0 - np.arange(end) / n  # r, being biased, has it once already
        time += max(2.0 * float(np.sum(np.square(r[:end]) / overlap)) - 1.0, 1.0)
    return float(np.clip(n * k / time, 1.0, n))


def consistency_metrics(
    whitened: Float[np.ndarray, "n k"], prefix: str, kind: str = "nees"
) -> dict[str, float | bool]:
    """Figures of errors (or innovations); empty if there are none.

    Args:
        whitened: In order of time, in units of their own covariance; infinite where there was none. As many
            numbers as degrees of freedom.
        prefix: Of the names.
        kind: "nees" or "nis", for the names.

    Returns:
        <prefix>_anees (mean), _anees_low and _anees_high (95 % band of that mean, by effective samples),
        _consistent (mean inside it), _nees_inside_share (samples inside the two-sided 95 % band of a
        single one), _nees_above_share (samples above it: over-confidence), _effective_samples,
        _calibration_error (mean distance of the calibration curve from the diagonal);
        _no_covariance_share where some covariances were none (left out of the mean).
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
