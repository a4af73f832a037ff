"""Landmarks that do not tell who they are: several answers until one has proved itself."""

from __future__ import annotations

import dataclasses
import importlib.util
import math
import sys
from pathlib import Path

import numpy as np
import pytest

from perception.planar.association import BankConfig, HypothesisBank, follow_unknown
from perception.planar.planar import follow
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


def test_without_names_it_is_nearly_as_good_as_with_them(walks):
    drives = [walks.drive(seed, seconds=60.0) for seed in range(4)]
    named = [rms(d.errors_m(follow(d.journey, walks.CONFIG).means)) for d in drives]
    unnamed = [follow_unknown(d.journey, walks.CONFIG) for d in drives]
    errors = [rms(d.errors_m(means)) for d, (means, _) in zip(drives, unnamed, strict=True)]
    assert np.mean(errors) < 1.2 * np.mean(named)
    assert np.mean([d.anees(*found) for d, found in zip(drives, unnamed, strict=True)]) < 2.0


def test_it_does_not_look_at_the_marks(walks):
    j = walks.drive(1, seconds=20.0).journey
    scrambled = dataclasses.replace(j, marks=np.roll(j.marks, 7))
    np.testing.assert_array_equal(
        follow_unknown(j, walks.CONFIG)[0], follow_unknown(scrambled, walks.CONFIG)[0]
    )


def test_one_in_ten_sightings_of_nothing_is_taken_for_nothing(walks):
    d = walks.drive(2, seconds=60.0, outliers=0.1)
    means, covariances = follow_unknown(d.journey, walks.CONFIG)
    assert rms(d.errors_m(means)) < 0.1
    assert d.anees(means, covariances) < 3.0


def twins(config, bank=None) -> HypothesisBank:
    """A robot that knows its heading but not whether it stands at y = 0.5 or at -0.5; two landmarks alike."""
    start = Gaussian(np.zeros(3), np.diag([0.01, 0.4, 0.01]) ** 2)
    return HypothesisBank(
        start, np.array([[3.0, 0.5], [3.0, -0.5], [-3.0, 9.0]]), config, None, bank
    )


def seen_from(config, x: float, y: float, places) -> np.ndarray:
    return np.array(
        [[config.offset + config.scale * (a - x), math.atan2(b - y, a - x)] for a, b in places]
    )


def test_it_keeps_both_answers_until_a_second_sighting_decides(walks):
    c = walks.CONFIG
    robots = twins(c)
    robots.update(seen_from(c, 0.0, -0.5, [(3.0, -0.5)]))  # straight ahead: which of the two?
    assert robots.count >= 2
    assert robots.share < 0.8
    undecided = math.sqrt(robots.pose.covariance[1, 1])
    assert undecided > 0.3  # the mixture says so
    robots.predict(1.0, 0.0, 0.0)
    robots.update(seen_from(c, 0.0, -0.5, [(3.0, 0.5)]))
    assert robots.share > 0.95
    assert robots.pose.mean[1] == pytest.approx(-0.5, abs=0.05)
    assert math.sqrt(robots.pose.covariance[1, 1]) < 0.2 * undecided


def test_a_bank_of_one_must_guess_and_is_sure_of_it(walks):
    c = walks.CONFIG
    robots = twins(c, BankConfig(capacity=1))
    robots.update(seen_from(c, 0.0, -0.5, [(3.0, -0.5)]))
    assert robots.count == 1
    assert math.sqrt(robots.pose.covariance[1, 1]) < 0.1


def test_two_sightings_of_one_instant_are_two_landmarks(walks):
    """Taken one by one both would be the nearer landmark; together they can only be the pair."""
    c = walks.CONFIG
    robots = twins(c)
    robots.update(seen_from(c, 0.0, 0.1, [(3.0, 0.5), (3.0, -0.5)]))
    assert robots.share > 0.95
    assert robots.pose.mean[1] == pytest.approx(0.1, abs=0.05)


def test_what_is_not_finite_is_left_out(walks):
    robots = twins(walks.CONFIG)
    before = robots.pose
    robots.update(np.array([[np.nan, 0.0], [2.0, np.inf]]))
    np.testing.assert_array_equal(robots.pose.mean, before.mean)
    assert not robots.predict(math.nan, 0.0, 0.0)
    assert not robots.predict(-1.0, 0.0, 0.0)


@pytest.mark.parametrize("count", [0, 63])
def test_too_many_places_or_none_are_refused(walks, count):
    with pytest.raises(ConfigError, match="landmarks; 1 to 62"):
        HypothesisBank(Gaussian(np.zeros(3), np.eye(3)), np.zeros((count, 2)))
    with pytest.raises(ConfigError, match="capacity=0"):
        BankConfig(capacity=0)
