"""Logs that nobody tuned, simulated: followed within the claims, or lost and said so."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from perception.planar import log_localiser
from perception.planar._planar_kernels import DRIFT
from perception.planar.log_localiser import localise
from perception.planar.planar_log import PlanarLog
from perception.primitives.pose import Pose2
from surefoot.experiments.real.perturbed_logs import LogErrors
from surefoot.experiments.real.simulated_logs import DT, simulated_log, with_drift, with_outliers


@pytest.fixture(scope="module")
def ranged():
    drawn = simulated_log(20, ranges=True, seconds=80.0)
    return drawn, localise(drawn.log)


@pytest.fixture(scope="module")
def tagged():
    drawn = simulated_log(21, ranges=False, seconds=80.0)
    return drawn, localise(drawn.log)


@pytest.mark.parametrize("kind", ["ranged", "tagged"])
def test_a_log_that_nobody_tuned_is_followed_within_its_covariance(kind, request):
    drawn, found = request.getfixturevalue(kind)
    errors = LogErrors.of(found, drawn.truth)
    assert errors.lost_share < 0.5
    assert 0.05 < errors.anees < 2.0
    assert errors.beyond_s < 1.0


def test_a_kidnapped_robot_is_lost_and_found_again():
    drawn = simulated_log(22, ranges=False, seconds=100.0, kidnapped=True)
    found = localise(drawn.log)
    errors = LogErrors.of(found, drawn.truth)
    assert found.fixes >= 2
    assert errors.beyond_s <= 10.0
    assert errors.lost[(errors.stamps_s > 50.0)].any()
    assert errors.squared[errors.stamps_s > 90.0].max() < 25.0


def test_a_drifting_gyro_becomes_a_state(ranged):
    drawn, found = ranged
    rate = math.radians(0.5)
    drifting = localise(with_drift(drawn.log, rate))
    assert found.final[DRIFT] - drifting.final[DRIFT] == pytest.approx(rate, abs=0.25 * rate)


def test_half_a_turn_that_the_odometry_invents_is_noticed_and_survived(tagged):
    drawn, found = tagged
    totals = drawn.log.totals.copy()
    totals[:, 1] += math.pi * np.clip((drawn.log.stamps_s - 25.0) / 5.0, 0.0, 1.0)
    broken = localise(dataclasses.replace(drawn.log, totals=totals))
    errors = LogErrors.of(broken, drawn.truth)
    end = errors.stamps_s > 60.0
    assert not errors.lost[end].all()
    assert errors.squared[end].max() < 25.0
    assert errors.beyond_s <= 10.0
    assert errors.rmse_m(60.0) <= 2.0 * LogErrors.of(found, drawn.truth).rmse_m(60.0)


@pytest.mark.parametrize("kind", ["ranged", "tagged"])
def test_the_noise_of_another_log_taken_whole_changes_little(kind, request):
    drawn, found = request.getfixturevalue(kind)
    _, other = request.getfixturevalue("tagged" if kind == "ranged" else "ranged")
    foreign = dataclasses.replace(other.config, depth_memory=100.0, bearing_memory=0.5)
    errors = LogErrors.of(localise(drawn.log, foreign), drawn.truth)
    assert errors.rmse_m() <= 1.3 * LogErrors.of(found, drawn.truth).rmse_m()
    assert errors.beyond_s < 1.0


def test_a_turn_that_runs_on_after_its_command_loses_nobody(tagged, monkeypatch):
    drawn, found = tagged
    monkeypatch.setattr(log_localiser, "FIRST_PART", 80)  # sightings; the turn comes after them
    monkeypatch.setattr(log_localiser, "FIRST_S", 30.0)
    totals = drawn.log.totals.copy()
    totals[:, 1] -= math.radians(15.0) * np.clip((drawn.log.stamps_s - 60.0) / 1.5, 0.0, 1.0)
    slipped = localise(dataclasses.replace(drawn.log, totals=totals))
    errors = LogErrors.of(slipped, drawn.truth)
    assert slipped.fixes == 1
    np.testing.assert_array_equal(slipped.lost, found.lost)
    assert errors.beyond_s < 1.0


def standing_first(seed, rest_s=50.0):
    """A robot that stands and then drives, with the four nearest tags in view ten times a second, mapped 3 cm off."""
    drawn, rng = simulated_log(seed, ranges=False, seconds=60.0), np.random.default_rng(seed)
    still = round(rest_s / DT)
    truth = np.vstack([np.repeat(drawn.truth[:1], still, axis=0), drawn.truth])
    totals = np.vstack([np.zeros((still, 2)), drawn.log.totals])
    truth[:, 0] = DT * np.arange(len(truth))
    seen_s, marks, seen = [], [], []
    true_places = drawn.log.places + rng.normal(0.0, 0.03, drawn.log.places.shape)
    for stamp, x, y, yaw in truth[1:]:
        ahead, left = Pose2(x, y, yaw).inverse().apply(true_places).T
        bearing = np.arctan2(left, ahead) + rng.normal(0.0, 0.004, len(ahead))
        depth = ahead + rng.normal(0.0, 0.01, len(ahead))
        view = np.flatnonzero((np.abs(bearing) < 1.0) & (ahead > 0.3))
        view = view[np.argsort(ahead[view])][:4]
        seen_s += [stamp] * len(view)
        marks += view.tolist()
        seen += np.stack([depth, bearing], axis=-1)[view].tolist()
    log = PlanarLog(
        truth[:, 0].copy(), totals, np.array(seen_s), np.array(marks), np.array(seen), drawn.log.places
    )  # fmt: skip
    return log, truth


@pytest.mark.parametrize("seed", [32, 34, 35])
def test_a_robot_that_stands_first_does_not_take_errors_that_repeat_for_noise(seed):
    log, truth = standing_first(seed)
    errors = LogErrors.of(localise(log), truth)
    assert errors.lost_share < 0.1
    assert errors.beyond_s < 1.0


def test_a_tag_on_the_robot_itself_is_ignored_from_the_first_fix_on(tagged):
    drawn, found = tagged
    log = drawn.log
    at = log.seen_s[log.seen_s > found.stamps_s[np.argmin(found.lost)]]
    mark = int(np.argmin(np.bincount(log.marks, minlength=len(log.places))))
    order = np.argsort(np.append(log.seen_s, at), kind="stable")
    doubled = dataclasses.replace(
        log,
        seen_s=np.append(log.seen_s, at)[order],
        marks=np.append(log.marks, np.full(len(at), mark))[order],
        seen=np.vstack([log.seen, np.tile([0.5, 0.2], (len(at), 1))])[order],
    )
    errors = LogErrors.of(localise(doubled), drawn.truth)
    np.testing.assert_array_equal(errors.lost, LogErrors.of(found, drawn.truth).lost)
    assert errors.beyond_s < 1.0


def test_late_stamps_make_the_pose_unsure_along_the_motion(tagged):
    drawn, found = tagged
    late = localise(dataclasses.replace(drawn.log, seen_s=drawn.log.seen_s + 0.5))
    assert late.delay_s - found.delay_s == pytest.approx(0.5, abs=0.2)
    errors = LogErrors.of(late, drawn.truth)
    assert errors.anees < 2.0
    assert errors.beyond_s < 1.0


def test_without_true_sightings_the_robot_is_lost_and_claims_nothing():
    drawn = simulated_log(23, ranges=True, seconds=30.0)
    log = with_outliers(drawn.log, 1.0, np.random.default_rng(0))
    shuffled = dataclasses.replace(log, marks=np.random.default_rng(1).permutation(log.marks))
    found = localise(shuffled)
    assert found.lost.all()
    assert found.config is None
    errors = LogErrors.of(found, drawn.truth)
    assert errors.squared.max() < 9.0


@pytest.mark.parametrize("seed", [24, 25])
def test_landmarks_that_are_elsewhere_are_ignored(seed):
    drawn = simulated_log(seed, ranges=False, seconds=150.0)
    log = drawn.log
    known = localise(log)
    moved = np.argsort(np.bincount(log.marks, minlength=len(log.places)))[-2:]
    places = log.places.copy()
    places[moved] = places[moved[::-1]]
    found = localise(dataclasses.replace(log, places=places))
    errors = LogErrors.of(found, drawn.truth)
    assert errors.lost_share < LogErrors.of(known, drawn.truth).lost_share + 0.1
    assert errors.beyond_s <= 10.0
    seen = np.bincount(log.marks, minlength=len(places))
    assert np.all(found.ignored[moved] > 0.3 * seen[moved])
    others = np.delete(np.arange(len(places)), moved)
    assert found.ignored[others].sum() < 0.1 * seen[others].sum()
    assert known.ignored.sum() < 0.05 * seen.sum()
