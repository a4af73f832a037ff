"""Consistency of covariances: normalised errors against the chi-square band.

An estimator is consistent if its errors, normalised by its own covariance, are as large as chance makes them: larger
ones mean that it is overconfident, smaller ones that it is too cautious.

Source: Bar-Shalom, Li, Kirubarajan, "Estimation with Applications to Tracking and Navigation" (2001),
section 5.4.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.special import gammaincinv

from ..primitives.errors import InputError
from .models import wrap_angles


@dataclass(frozen=True)
class Innovation:
    """Innovation of one measurement.

    Args:
        identity: Number of the landmark or of the track; None if unknown.
        whitened: (d,), measured minus predicted, divided by the Cholesky root of its covariance: d standard
            normal numbers if the filter is consistent.
    """

    identity: int | None
    whitened: Float[np.ndarray, "d"]

    @classmethod
    def of(
        cls,
        identity: int | None,
        difference: Float[np.ndarray, "d"],
        covariance: Float[np.ndarray, "d d"],
    ) -> Innovation:
        """Whiten a difference by its covariance, which must be positive definite."""
        return cls(identity, np.linalg.solve(np.linalg.cholesky(covariance), difference))

    @property
    def nis(self) -> float:
        """Normalised innovation squared, chi-square with d degrees of freedom if consistent."""
        return float(self.whitened @ self.whitened)


def nees(
    errors: Float[np.ndarray, "*n d"],
    covariances: Float[np.ndarray, "*n d d"],
    angles: Collection[int] = (),
) -> Float[np.ndarray, "*n"]:
    """Normalised estimation error squared; chi-square with d degrees of freedom if consistent.

    Args:
        errors: True minus estimated, or estimated minus true.
        covariances: Of the estimates.
        angles: Which entries are angles, rad; their errors are wrapped to [-pi, pi).
    """
    short = np.array(errors)
    for entry in angles:
        short[..., entry] = wrap_angles(short[..., entry])
    solved = np.linalg.solve(covariances, short[..., None])[..., 0]
    return np.asarray(np.sum(short * solved, axis=-1))


def chi_square_quantile(probability: float, degrees: float | int) -> float:
    """Value below which a chi-square variable is with the given probability."""
    if not 0.0 < probability < 1.0 or degrees < 1:
        raise InputError(
            f"chi-square quantile: probability={probability} must lie between 0 and 1 and "
            f"degrees={degrees} must be at least 1"
        )
    return 2.0 * float(gammaincinv(degrees / 2.0, probability))


def band(degrees: int, samples: float | int = 1, probability: float = 0.95) -> tuple[float, float]:
    """Two-sided interval of the mean of independent normalised errors.

    Args:
        degrees: d, of one normalised error.
        samples: Number of independent errors averaged, which need not be an integer; the frames of a run are correlated.
        probability: Of the interval.

    Returns:
        Lower and upper bound of the mean; its expectation is `degrees`.
    """
    tail = (1.0 - probability) / 2.0
    total = degrees * samples
    return (
        chi_square_quantile(tail, total) / samples,
        chi_square_quantile(1.0 - tail, total) / samples,
    )


def share_inside(
    normalised: Float[np.ndarray, "n"], degrees: int, probability: float = 0.95
) -> float:
    """Share of normalised errors below their chi-square quantile; `probability` if consistent."""
    return float(np.mean(normalised <= chi_square_quantile(probability, degrees)))


def calibration(
    normalised: Float[np.ndarray, "n"], degrees: int, steps: int = 20
) -> tuple[Float[np.ndarray, "steps"], Float[np.ndarray, "steps"]]:
    """Calibration curve: share of errors inside each confidence region.

    Returns:
        Probabilities, evenly spaced in (0, 1), and shares found: the diagonal if consistent, below it if
        overconfident.
    """
    claimed = (np.arange(steps) + 0.5) / steps
    found = np.array([share_inside(normalised, degrees, float(p)) for p in claimed])
    return claimed, found
