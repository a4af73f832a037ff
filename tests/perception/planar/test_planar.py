"""Planar localisation on simulated drives: accuracy, consistency, robustness."""

from __future__ import annotations

import dataclasses
import importlib.util
import itertools
import math
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from perception.filtering.consistency import band
from perception.planar import _planar_kernels as kernels
from perception.planar.config import PlanarConfig
from perception.planar.planar import (
    Journey,
    PlanarFilter,
    PlanarPrior,
    filter_journey,
    sigma_weights,
)
from perception.planar.planar_fit import FITTED, compass_search, fit
from perception.primitives.errors import ConfigError, InputError
from perception.primitives.gaussian import Gaussian

SEEDS = range(8)


@pytest.fixture(scope="module")
def walks():
    place = Path(__file__).with_name("planar_walks.py")
    spec = importlib.util.spec_from_file_location("planar_walks", place)
    module = importlib.util.module_from_spec(spec)
    sys.modules["planar_walks"] = module
    spec.loader.exec_module(module)
    return module


def test_errors_are_centimetres_and_consistent_with_the_covariance(walks):
    drives = [walks.drive(seed) for seed in SEEDS]
    found = [filter_journey(d.journey, walks.CONFIG) for d in drives]
    low, high = band(3, len(drives), 0.999)
    anees = np.mean([d.anees(f.means, f.covariances) for d, f in zip(drives, found, strict=True)])
    assert low / 3 < anees < high / 3
    errors = np.concatenate([d.errors_m(f.means) for d, f in zip(drives, found, strict=True)])
    assert np.sqrt(np.mean(errors**2)) < 0.05


def test_whitened_innovations_are_white_with_unit_variance(walks):
    found = [filter_journey(walks.drive(seed).journey, walks.CONFIG) for seed in SEEDS]
    rows = np.concatenate([f.whitened[f.status == 1] for f in found])
    assert np.mean(rows**2) == pytest.approx(1.0, abs=0.1)
    lagged = np.mean(rows[1:] * rows[:-1]) / np.mean(rows**2)
    assert abs(lagged) < 3.5 / math.sqrt(rows.size)


def recovers(found, drives, after_s=30.0):
    """Mean ANEES over seeds, and the root mean square error, m, some seconds after the fault in the middle."""
    later = round((90.0 + after_s) / 0.1)
    errors = [d.errors_m(f.means)[later:] for d, f in zip(drives, found, strict=True)]
    return (
        np.mean([d.anees(f.means, f.covariances) for d, f in zip(drives, found, strict=True)]),
        float(np.sqrt(np.mean(np.square(errors)))),
    )


@pytest.mark.parametrize(
    "fault",
    [
        {"outliers": 0.3},
        {"blackout_s": (50.0, 60.0)},
        {"jump_m": 0.5},
        {"late_s": 0.05},
        {"outliers": 0.3, "blackout_s": (50.0, 60.0), "late_s": 0.05},
    ],
    ids=["30 % outliers", "no sightings for 10 s", "odometry jumps by 0.5 m",
         "the camera's clock is 50 ms late", "three faults at once"],
)  # fmt: skip
def test_it_stays_accurate_and_consistent_with(walks, fault):
    drives = [walks.drive(seed, **fault) for seed in SEEDS]
    found = [filter_journey(d.journey, walks.CONFIG) for d in drives]
    anees, error_m = recovers(found, drives)
    assert anees < 3.0
    assert error_m < 0.1
    assert all(np.all(np.isfinite(f.means)) for f in found)
    for f in found:
        np.linalg.cholesky(f.covariances)


@pytest.mark.parametrize("bearing", [0.0, math.nan])
def test_the_density_of_a_sighting_is_one_over_all_depths(bearing):
    """Whatever errors sightings share: a prediction that follows the measured depth would be no density of it."""
    config = PlanarConfig(depth_far=0.002, depth_shared=5.0)
    start = Gaussian(np.zeros(3), 1e-6 * np.eye(3))
    depths = np.arange(2.0, 20.0, 0.1)
    bearings = [bearing] if math.isnan(bearing) else np.arange(-0.05, 0.05, 0.002)
    found = 0.0
    for depth, seen in itertools.product(depths, bearings):
        journey = Journey(
            start, np.zeros((1, 3)), np.array([0, 1]), np.array([0]),
            np.array([[depth, seen]]), np.array([[10.0, 0.0]]),
        )  # fmt: skip
        density = math.exp(filter_journey(journey, config).log_densities[0])
        found += (density - config.outlier * config.outlier_density) / (1.0 - config.outlier)
    cell = 0.1 * (1.0 if math.isnan(bearing) else 0.002)
    assert found * cell == pytest.approx(1.0, abs=0.01)


def test_without_recovery_it_stays_lost_after_a_kidnapping(walks):
    drives = [walks.drive(seed, kidnapped_m=2.0) for seed in SEEDS]
    without = dataclasses.replace(walks.CONFIG, recover_after=10**9)
    found = [filter_journey(d.journey, without) for d in drives]
    assert recovers(found, drives)[1] > 1.0


def test_it_recovers_from_a_kidnapping_by_two_metres(walks):
    drives = [walks.drive(seed, kidnapped_m=2.0) for seed in SEEDS]
    found = [filter_journey(d.journey, walks.CONFIG) for d in drives]
    assert recovers(found, drives)[1] < 0.1
    assert all(np.sum(f.status == 0) < 80 for f in found)


def test_outliers_are_rejected_and_correct_sightings_are_not(walks):
    clean = filter_journey(walks.drive(1).journey, walks.CONFIG)
    assert np.mean(clean.status == 1) > 0.99
    spoilt = filter_journey(walks.drive(1, outliers=0.3).journey, walks.CONFIG)
    assert 0.2 < np.mean(spoilt.status == 0) < 0.36


def test_the_filter_by_instants_agrees_with_that_of_a_whole_run(walks):
    d = walks.drive(3, seconds=20.0, outliers=0.1)
    j = d.journey
    whole = filter_journey(j, walks.CONFIG)
    robot = PlanarFilter(j.start, {k: tuple(p) for k, p in enumerate(j.places)}, walks.CONFIG)
    for i, (dt, path, turn) in enumerate(j.steps):
        assert robot.predict(dt, path, turn)
        for row in range(j.first_row[i], j.first_row[i + 1]):
            assert robot.update(int(j.marks[row]), j.seen[row]) == (whole.status[row] == 1)
        np.testing.assert_allclose(robot.pose.mean, whole.means[i], atol=1e-12)
        np.testing.assert_allclose(robot.pose.covariance, whole.covariances[i], atol=1e-12)


@settings(max_examples=30, deadline=None)
@given(
    st.lists(st.tuples(st.floats(), st.floats(), st.floats()), max_size=5),
    st.lists(st.tuples(st.integers(0, 3), st.floats(), st.floats()), max_size=5),
)
def test_any_input_leaves_a_finite_state_and_a_positive_covariance(steps, sightings):
    """Infinite, huge, NaN, time running backwards: refused, or processed without damage."""
    robot = PlanarFilter(
        Gaussian(np.zeros(3), np.diag([0.01, 0.01, 0.01])), {0: (1.0, 0.0), 1: (0.0, 2.0)}
    )
    for dt, path, turn in steps:
        robot.predict(dt, path, turn)
    for mark, depth, bearing in sightings:
        robot.update(mark, np.array([depth, bearing]))
    P = robot.pose.covariance
    assert np.all(np.isfinite(robot.pose.mean))
    sigma = np.sqrt(np.diag(P))
    assert np.linalg.eigvalsh(P / np.outer(sigma, sigma)).min() > -1e-14


def test_many_sightings_of_one_landmark_do_not_average_out_its_map_error(walks):
    """A thousand sightings of one tag while standing: its displacement stays in the covariance."""
    far = PlanarPrior(
        odometry_scale_sigma=0.0, turn_scale_sigma=0.0, drift_sigma=0.0, lens_sigma=0.0
    )
    sure = dataclasses.replace(
        walks.CONFIG, place=0.05, place_memory=1e9, depth_shared=1e-9, bearing_shared=1e-9
    )
    start = Gaussian(np.zeros(3), np.diag([1.0, 1e-6, 1e-6]) ** 2)
    robot = PlanarFilter(start, {7: (3.0, 0.0)}, sure, far)
    for _ in range(1000):
        robot.predict(0.1, 0.0, 0.0)
        assert robot.update(7, np.array([sure.offset + sure.scale * 3.0, 0.0]))
    assert math.sqrt(robot.pose.covariance[0, 0]) == pytest.approx(0.05, rel=0.1)


def test_maximum_likelihood_finds_the_parameters_without_ground_truth(walks):
    """From a bearing noise three times too large and depths 10 cm off."""
    j = walks.drive(5, seconds=60.0).journey
    wrong = dataclasses.replace(walks.CONFIG, bearing_sigma=0.02, offset=0.15)
    found, _ = fit(lambda delay: j, wrong, delay_s=0.0, sweeps=3)
    assert filter_journey(j, found).log_likelihood > filter_journey(j, wrong).log_likelihood + 50.0
    assert abs(found.offset - walks.CONFIG.offset) < 0.06  # of 0.10: depths share an error too
    assert found.bearing_sigma < 0.6 * wrong.bearing_sigma  # three sweeps get half-way


def test_compass_search_finds_a_minimum_and_refuses_zero_steps():
    found = compass_search(
        lambda p: float((p[0] - 1.0) ** 2 + 10.0 * (p[1] + 2.0) ** 2), np.zeros(2), [0.5, 0.5], 60
    )
    np.testing.assert_allclose(found, [1.0, -2.0], atol=0.05)
    with pytest.raises(ConfigError, match="none of them zero"):
        compass_search(lambda p: 0.0, np.zeros(2), [0.5, 0.0], 1)


def test_fitted_parameters_exist_and_sigma_weights_are_positive():
    assert set(FITTED) <= {field.name for field in dataclasses.fields(PlanarConfig)}
    assert min(sigma_weights(kernels.SIZE + 8).covariance) >= 0.0


def test_invalid_parameters_are_refused(walks):
    with pytest.raises(ConfigError, match="place=-1"):
        PlanarConfig(place=-1.0)
    with pytest.raises(ConfigError, match="share"):
        PlanarConfig(outlier=1.0)
    with pytest.raises(ConfigError, match="slots=-1"):
        PlanarPrior(slots=-1)
    with pytest.raises(ConfigError, match=r"finite \(x, y, yaw\)"):
        PlanarFilter(Gaussian(np.full(3, np.nan), np.eye(3)), {})
    j = walks.drive(0, seconds=5.0).journey
    with pytest.raises(InputError, match="must index"):
        dataclasses.replace(j, marks=j.marks + 50)
    with pytest.raises(InputError, match="first rows"):
        Journey(j.start, j.steps, j.first_row[:-1], j.marks, j.seen, j.places)
