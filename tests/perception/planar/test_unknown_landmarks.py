"""Landmarks without identity: several hypotheses until one is confirmed."""

from __future__ import annotations

import dataclasses
import importlib.util
import math
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import approx_fprime
from scipy.stats import multivariate_normal

from perception.planar import _association_kernels, _planar_kernels
from perception.planar.association import BankConfig, HypothesisBank, filter_unknown
from perception.planar.planar import filter_journey
from perception.primitives.errors import ConfigError
from perception.primitives.gaussian import Gaussian


@pytest.fixture(scope="module")
def walks():
    place = Path(__file__).with_name("planar_walks.py")
    spec = importlib.util.spec_from_file_location("planar_walks", place)
    module = importlib.util.module_from_spec(spec)
    sys.modules["planar_walks"] = module
    spec.loader.exec_module(module)
    return module


def rms(values) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def test_without_identities_it_is_nearly_as_accurate_as_with_them(walks):
    drives = [walks.drive(seed, seconds=60.0) for seed in range(4)]
    named = [rms(d.errors_m(filter_journey(d.journey, walks.CONFIG).means)) for d in drives]
    unnamed = [filter_unknown(d.journey, walks.CONFIG) for d in drives]
    errors = [rms(d.errors_m(means)) for d, (means, _) in zip(drives, unnamed, strict=True)]
    assert np.mean(errors) < 1.2 * np.mean(named)
    assert np.mean([d.anees(*found) for d, found in zip(drives, unnamed, strict=True)]) < 2.0


def test_it_does_not_use_the_identities(walks):
    j = walks.drive(1, seconds=20.0).journey
    scrambled = dataclasses.replace(j, marks=np.roll(j.marks, 7))
    np.testing.assert_array_equal(
        filter_unknown(j, walks.CONFIG)[0], filter_unknown(scrambled, walks.CONFIG)[0]
    )


def test_one_in_ten_outliers_is_treated_as_clutter(walks):
    d = walks.drive(2, seconds=60.0, outliers=0.1)
    means, covariances = filter_unknown(d.journey, walks.CONFIG)
    assert rms(d.errors_m(means)) < 0.1
    assert d.anees(means, covariances) < 3.0


def twins(config, bank=None) -> HypothesisBank:
    """A robot with a known heading, at y = 0.5 or y = -0.5, in front of two alike landmarks."""
    start = Gaussian(np.zeros(3), np.diag([0.01, 0.4, 0.01]) ** 2)
    return HypothesisBank(
        start, np.array([[3.0, 0.5], [3.0, -0.5], [-3.0, 9.0]]), config, None, bank
    )


def seen_from(config, x: float, y: float, places) -> np.ndarray:
    return np.array(
        [[config.offset + config.scale * (a - x), math.atan2(b - y, a - x)] for a, b in places]
    )


def test_it_keeps_both_hypotheses_until_a_second_sighting_decides(walks):
    c = walks.CONFIG
    robots = twins(c)
    robots.update(seen_from(c, 0.0, -0.5, [(3.0, -0.5)]))  # straight ahead: one of the two
    assert robots.count >= 2
    assert robots.share < 0.8
    undecided = math.sqrt(robots.pose.covariance[1, 1])
    assert undecided > 0.3  # the spread of the mixture
    robots.predict(1.0, 0.0, 0.0)
    robots.update(seen_from(c, 0.0, -0.5, [(3.0, 0.5)]))
    assert robots.share > 0.95
    assert robots.pose.mean[1] == pytest.approx(-0.5, abs=0.05)
    assert math.sqrt(robots.pose.covariance[1, 1]) < 0.2 * undecided


def test_a_bank_of_one_hypothesis_is_overconfident(walks):
    c = walks.CONFIG
    robots = twins(c, BankConfig(capacity=1))
    robots.update(seen_from(c, 0.0, -0.5, [(3.0, -0.5)]))
    assert robots.count == 1
    assert math.sqrt(robots.pose.covariance[1, 1]) < 0.1


def test_two_sightings_of_one_instant_are_two_landmarks(walks):
    """Separately both would be the nearer landmark; together they can only be the pair."""
    c = walks.CONFIG
    robots = twins(c)
    robots.update(seen_from(c, 0.0, 0.1, [(3.0, 0.5), (3.0, -0.5)]))
    assert robots.share > 0.95
    assert robots.pose.mean[1] == pytest.approx(0.1, abs=0.05)


def test_sightings_that_are_not_finite_are_ignored(walks):
    robots = twins(walks.CONFIG)
    before = robots.pose
    robots.update(np.array([[np.nan, 0.0], [2.0, np.inf]]))
    np.testing.assert_array_equal(robots.pose.mean, before.mean)
    assert not robots.predict(math.nan, 0.0, 0.0)
    assert not robots.predict(-1.0, 0.0, 0.0)


@pytest.mark.parametrize("count", [0, 63])
def test_too_many_landmarks_or_none_are_refused(walks, count):
    with pytest.raises(ConfigError, match="landmarks; 1 to 62"):
        HypothesisBank(Gaussian(np.zeros(3), np.eye(3)), np.zeros((count, 2)))
    with pytest.raises(ConfigError, match="capacity=0"):
        BankConfig(capacity=0)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("held", [True, False])
def test_the_density_of_a_sighting_counts_all_that_is_uncertain(walks, held, seed):
    """A Gaussian, by differences of the geometry; the error of a landmark's place counts as a state, held or not."""
    rng, sigmas = np.random.default_rng(seed), np.array([0.02, 0.01])
    config = dataclasses.replace(
        walks.CONFIG, depth_near=sigmas[0], depth_far=1e-9, bearing_sigma=sigmas[1]
    )
    p = config.parameters
    entry, place = _planar_kernels.SIZE, np.array([2.5, 0.1])
    mean = np.zeros(entry + 2)
    mean[:3] = 0.05 * rng.normal(size=3)
    root = np.tril(0.01 * rng.normal(size=(entry + 2, entry + 2)))
    root[[_planar_kernels.LENS_EVEN, _planar_kernels.LENS_ODD]] = 0.0  # at most second order
    if not held:
        root[entry:] = 0.0
        root[entry, entry] = root[entry + 1, entry + 1] = p.place

    def sighting(state):
        x, y = place + state[entry:] - state[:2]
        far, angle = math.hypot(x, y), math.atan2(y, x) - state[2]
        common = p.offset + state[_planar_kernels.OFFSET] + 0.02 * state[_planar_kernels.DEPTH]
        depth = common + (p.scale + state[_planar_kernels.GAIN]) * far * math.cos(angle)
        return np.array([depth, angle + state[_planar_kernels.BEARING]])

    H = approx_fprime(mean, sighting, 1e-7)
    gaussian = multivariate_normal(sighting(mean), H @ root @ root.T @ H.T + np.diag(sigmas**2))
    seen = sighting(mean) + np.array([0.03, -0.02])
    squared, density = _association_kernels.linear_density(
        mean, root, place, entry if held else -1, seen, 0.0, p
    )
    off = seen - gaussian.mean
    # the error of a place that is not held: 1 % of depth's scale is left out
    assert density == pytest.approx(gaussian.logpdf(seen), abs=1e-4 if held else 0.02)
    assert squared == pytest.approx(off @ np.linalg.solve(gaussian.cov, off), rel=0.02)
