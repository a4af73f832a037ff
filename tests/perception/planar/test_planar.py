"""Planar localisation on simulated drives: right, honest about it, and hard to kill."""

from __future__ import annotations

import dataclasses
import importlib.util
import math
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from perception.filtering.consistency import band
from perception.planar import _planar_kernels as kernels
from perception.planar.planar import (
    Journey,
    PlanarConfig,
    PlanarFilter,
    PlanarPrior,
    follow,
    weights,
)
from perception.planar.planar_fit import FITTED, fit, search
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


def test_its_errors_are_as_large_as_it_says_and_a_few_centimetres(walks):
    drives = [walks.drive(seed) for seed in SEEDS]
    found = [follow(d.journey, walks.CONFIG) for d in drives]
    low, high = band(3, len(drives), 0.999)
    anees = np.mean([d.anees(f.means, f.covariances) for d, f in zip(drives, found, strict=True)])
    assert low / 3 < anees < high / 3
    errors = np.concatenate([d.errors_m(f.means) for d, f in zip(drives, found, strict=True)])
    assert np.sqrt(np.mean(errors**2)) < 0.05


def test_innovations_are_white_noise_of_unit_size(walks):
    found = [follow(walks.drive(seed).journey, walks.CONFIG) for seed in SEEDS]
    rows = np.concatenate([f.whitened[f.status == 1] for f in found])
    assert np.mean(rows**2) == pytest.approx(1.0, abs=0.1)
    lagged = np.mean(rows[1:] * rows[:-1]) / np.mean(rows**2)
    assert abs(lagged) < 3.5 / math.sqrt(rows.size)


def recovers(found, drives, after_s=30.0):
    """Mean ANEES over seeds, and the root mean square error, m, from some seconds after the fault in the middle."""
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
    ids=["three in ten sightings mean nothing", "blind for 10 s", "odometry leaps 0.5 m",
         "the camera's clock is 50 ms late", "three of these at once"],
)  # fmt: skip
def test_it_recovers_and_stays_honest_when(walks, fault):
    drives = [walks.drive(seed, **fault) for seed in SEEDS]
    found = [follow(d.journey, walks.CONFIG) for d in drives]
    anees, error_m = recovers(found, drives)
    assert anees < 3.0
    assert error_m < 0.1
    assert all(np.all(np.isfinite(f.means)) for f in found)
    for f in found:
        np.linalg.cholesky(f.covariances)


def test_without_doubt_it_would_never_find_itself_again_when_carried_away(walks):
    """What follows is no easy one: a filter that never doubts itself stays lost."""
    drives = [walks.drive(seed, kidnapped_m=2.0) for seed in SEEDS]
    stubborn = dataclasses.replace(walks.CONFIG, doubt_after=10**9)
    found = [follow(d.journey, stubborn) for d in drives]
    assert recovers(found, drives)[1] > 1.0


def test_carried_two_metres_away_and_turned_it_finds_itself_again(walks):
    drives = [walks.drive(seed, kidnapped_m=2.0) for seed in SEEDS]
    found = [follow(d.journey, walks.CONFIG) for d in drives]
    assert recovers(found, drives)[1] < 0.1
    assert all(np.sum(f.status == 0) < 80 for f in found)


def test_outliers_are_counted_and_true_sightings_are_not(walks):
    clean = follow(walks.drive(1).journey, walks.CONFIG)
    assert np.mean(clean.status == 1) > 0.99
    spoilt = follow(walks.drive(1, outliers=0.3).journey, walks.CONFIG)
    assert 0.2 < np.mean(spoilt.status == 0) < 0.36


def test_instant_by_instant_gives_what_the_whole_journey_gives(walks):
    d = walks.drive(3, seconds=20.0, outliers=0.1)
    j = d.journey
    whole = follow(j, walks.CONFIG)
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
def test_any_numbers_at_all_leave_a_covariance(steps, sightings):
    """Infinite, huge, not a number, back in time: refused, or taken without harm."""
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


def test_many_sightings_of_one_landmark_do_not_make_it_surer_than_the_map(walks):
    """Standing still, a thousand looks at one tag: its displacement stays in the answer."""
    far = PlanarPrior(pace_sigma=0.0, turn_sigma=0.0, drift_sigma=0.0, lens_sigma=0.0)
    sure = dataclasses.replace(
        walks.CONFIG, place=0.05, place_memory=1e9, depth_shared=1e-9, bearing_shared=1e-9
    )
    start = Gaussian(np.zeros(3), np.diag([1.0, 1e-6, 1e-6]) ** 2)
    robot = PlanarFilter(start, {7: (3.0, 0.0)}, sure, far)
    for _ in range(1000):
        robot.predict(0.1, 0.0, 0.0)
        assert robot.update(7, np.array([sure.offset + sure.scale * 3.0, 0.0]))
    assert math.sqrt(robot.pose.covariance[0, 0]) == pytest.approx(0.05, rel=0.1)


def test_the_likelihood_finds_the_parameters_without_the_truth(walks):
    """Started with bearings three times too vague and depths 10 cm off."""
    j = walks.drive(5, seconds=60.0).journey
    wrong = dataclasses.replace(walks.CONFIG, bearing_sigma=0.02, offset=0.15)
    found, _ = fit(lambda delay: j, wrong, delay_s=0.0, sweeps=3)
    assert follow(j, found).log_likelihood > follow(j, wrong).log_likelihood + 50.0
    assert abs(found.offset - walks.CONFIG.offset) < 0.06  # of 0.10: depths share an error too
    assert (
        found.bearing_sigma < 0.6 * wrong.bearing_sigma
    )  # three sweeps of a search come half the way


def test_the_search_finds_the_lowest_point_of_a_bowl_and_refuses_no_step():
    found = search(
        lambda p: float((p[0] - 1.0) ** 2 + 10.0 * (p[1] + 2.0) ** 2), np.zeros(2), [0.5, 0.5], 60
    )
    np.testing.assert_allclose(found, [1.0, -2.0], atol=0.05)
    with pytest.raises(ConfigError, match="none of them zero"):
        search(lambda p: 0.0, np.zeros(2), [0.5, 0.0], 1)


def test_kernels_and_config_name_their_parameters_alike():
    names = [field.name for field in dataclasses.fields(PlanarConfig)]
    assert [getattr(kernels, name.upper()) for name in names] == list(range(len(names)))
    assert set(FITTED) <= set(names)
    assert min(weights(kernels.SIZE + 8)[2]) >= 0.0


def test_what_cannot_be_is_refused_with_a_reason(walks):
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
