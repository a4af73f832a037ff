"""Consistency measures of correct and of wrong covariances."""

from __future__ import annotations

import math

import numpy as np
import pytest
import scipy.stats

from perception.filtering import consistency
from perception.primitives.errors import InputError


def samples(scale: float = 1.0, n: int = 4000) -> tuple[np.ndarray, np.ndarray]:
    """Errors drawn from a covariance, and that covariance times scale squared."""
    rng = np.random.default_rng(2)
    roots = rng.normal(size=(n, 3, 3)) + 2 * np.eye(3)
    errors = (roots @ rng.normal(size=(n, 3, 1)))[..., 0]
    return errors, roots @ roots.transpose(0, 2, 1) * scale**2


def test_quantiles_and_bands_are_those_of_scipy():
    for degrees in (1, 2, 3, 150):
        for p in (0.025, 0.5, 0.999):
            expected = scipy.stats.chi2.ppf(p, degrees)
            assert math.isclose(consistency.chi_square_quantile(p, degrees), expected, rel_tol=1e-9)
    low, high = consistency.band(3, 50)
    assert math.isclose(low, scipy.stats.chi2.ppf(0.025, 150) / 50, rel_tol=1e-9)
    assert math.isclose(high, scipy.stats.chi2.ppf(0.975, 150) / 50, rel_tol=1e-9)


def test_the_nees_of_a_correct_covariance_lies_in_its_band():
    errors, covariances = samples()
    low, high = consistency.band(3, len(errors), 0.999)
    assert low < consistency.nees(errors, covariances).mean() < high


@pytest.mark.parametrize("scale", [0.8, 1.25])
def test_the_nees_of_a_wrong_covariance_lies_outside_its_band(scale):
    errors, covariances = samples(scale)
    low, high = consistency.band(3, len(errors), 0.999)
    mean = consistency.nees(errors, covariances).mean()
    assert (mean > high) if scale < 1 else (mean < low)


def test_an_angle_error_of_a_whole_turn_is_zero():
    error = np.array([[0.1, 0.0, 2 * math.pi]])
    assert math.isclose(consistency.nees(error, np.eye(3)[None], angles=[2])[0], 0.01)
    assert error[0, 2] == 2 * math.pi  # the caller's array is left alone


def test_the_calibration_curve_is_the_diagonal_and_below_it_if_overconfident():
    claimed, found = consistency.calibration(consistency.nees(*samples()), 3)
    np.testing.assert_allclose(found, claimed, atol=0.03)  # 4 deviations of a share of 4000
    _, sagging = consistency.calibration(consistency.nees(*samples(0.7)), 3)
    assert np.all(sagging < claimed - 0.01)


def test_invalid_arguments_are_refused_with_a_message():
    with pytest.raises(InputError, match=r"probability=1\.5"):
        consistency.chi_square_quantile(1.5, 2)
