"""The pose from two landmarks alone: consistent covariance, and no result from contradicting sightings."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom

from perception.filtering.consistency import band, nees, share_inside
from perception.filtering.models import range_bearing, wrap_angles
from perception.localisation.localiser_noise import joint_noise
from perception.localisation.relocalisation import (
    REMEMBERED,
    RecentSightings,
    jacobian,
    pose_from_sightings,
)
from perception.primitives.gaussian import Gaussian
from perception.primitives.landmark import Sighting
from perception.primitives.pose import Pose2

NOISE = np.diag([0.01**2, 0.01**2])


def look(pose: np.ndarray, places: np.ndarray, rng: np.random.Generator | None) -> list[Sighting]:
    seen = range_bearing(pose, places).reshape(-1, 2)
    if rng is not None:
        seen = seen + rng.multivariate_normal(np.zeros(2), NOISE, len(places))
    return [Sighting(i, row, NOISE) for i, row in enumerate(seen)]


def noise(k: int) -> np.ndarray:
    return joint_noise([NOISE] * k, 0.0)


@given(st.integers(0, 2**32 - 1))
def test_noise_free_sightings_give_the_pose(seed):
    rng = np.random.default_rng(seed)
    pose = rng.uniform([-3, -3, -math.pi], [3, 3, math.pi])
    places = rng.uniform([-5, 5], [5, 15], (3, 2))
    found = pose_from_sightings(look(pose, places, None), places, 1e-4 * noise(3))
    assert found is not None
    np.testing.assert_allclose(found.mean[:2], pose[:2], atol=1e-6)
    assert abs(wrap_angles(found.mean[2:] - pose[2:])[0]) < 1e-6


@given(st.integers(0, 2**32 - 1))
def test_the_jacobian_agrees_with_finite_differences(seed):
    rng = np.random.default_rng(seed)
    pose, places = rng.uniform(-1, 1, 3), rng.uniform(2, 5, (3, 2))
    step = 1e-6
    columns = [
        (range_bearing(pose + e, places) - range_bearing(pose - e, places)) / (2 * step)
        for e in np.eye(3) * step
    ]
    np.testing.assert_allclose(jacobian(pose, places), np.array(columns).T, atol=1e-7)


def test_the_pose_is_consistent_with_its_covariance():
    rng = np.random.default_rng(1)
    pose, places = np.array([0.3, -0.2, 0.5]), np.array([[2.0, 1.0], [1.5, -1.0]])
    errors, covariances = [], []
    for _ in range(200):
        found = pose_from_sightings(look(pose, places, rng), places, noise(2))
        if found is not None:
            errors.append(found.mean - pose)
            covariances.append(found.covariance)
    assert len(errors) > 195
    low, high = band(3, len(errors), 0.999)
    assert low < nees(np.array(errors), np.array(covariances)).mean() < high


@pytest.mark.parametrize("apart_m", [0.15, 0.5, 1.0, 2.0])
def test_the_pose_from_landmarks_close_together_and_far_away_is_consistent_or_none(apart_m):
    rng = np.random.default_rng(4)
    inside = []
    for _ in range(300):
        pose, turn = np.array([*rng.uniform(-2, 2, 2), rng.uniform(-3, 3)]), rng.uniform(-3, 3)
        middle = pose[:2] + 5.0 * np.array([math.cos(pose[2]), math.sin(pose[2])])
        across = apart_m / 2 * np.array([math.cos(turn), math.sin(turn)])
        places = middle + np.array([across, -across])
        own = np.diag([0.1**2, 0.009**2])
        seen = range_bearing(pose, places).reshape(-1, 2)
        seen = seen + rng.multivariate_normal(np.zeros(2), own, 2)
        sightings = [Sighting(i, row, own) for i, row in enumerate(seen)]
        found = pose_from_sightings(sightings, places, joint_noise([own] * 2, 0.0))
        if found is not None:
            inside.append(
                share_inside(nees((found.mean - pose)[None], found.covariance[None], (2,)), 3, 0.9)
            )
    assert np.sum(inside) >= binom.ppf(0.001, len(inside), 0.9) if inside else apart_m < 1.0
    assert len(inside) > 250 or apart_m < 2.0


def test_one_landmark_or_two_at_one_position_give_no_pose():
    pose, places = np.zeros(3), np.array([[2.0, 1.0], [2.0, 1.05]])
    seen = look(pose, places, None)
    assert pose_from_sightings(seen[:1], places[:1], noise(1)) is None
    assert pose_from_sightings(seen, places, noise(2)) is None


def test_contradicting_sightings_give_no_pose():
    places = np.array([[2.0, 1.0], [1.5, -1.0]])
    seen = look(np.zeros(3), places, None)
    wrong = Sighting(1, seen[1].measured + np.array([0.5, 0.3]), NOISE)
    assert pose_from_sightings([seen[0], wrong], places, noise(2)) is None


MOTION = Pose2(0.1, 0.02, 0.1)
MOTION_COVARIANCE = np.diag([0.03, 0.02, math.radians(2.0)]) ** 2
SURE = np.diag([0.02, 0.02, math.radians(0.5)]) ** 2


def walked(rng: np.random.Generator, frames: int) -> tuple[RecentSightings, np.ndarray]:
    """Sightings of a landmark in each frame of a walk told with noise, and the pose at its end."""
    recent, true = RecentSightings(), Pose2(*rng.uniform(-1, 1, 3))
    places = np.array([[6.0, 1.0], [5.0, -4.0]])
    for _ in range(frames):
        recent.add(look(true.vector, places[:1], rng), places[:1])
        error = rng.multivariate_normal(np.zeros(3), MOTION_COVARIANCE)
        true = true @ MOTION @ Pose2(*error)
        recent.move(MOTION, MOTION_COVARIANCE)
    return recent, true.vector


@pytest.mark.parametrize("frames", [1, 6])
def test_the_true_pose_explains_what_was_seen_along_the_way(frames):
    rng = np.random.default_rng(3)
    confirmed = 0
    for _ in range(400):
        recent, true = walked(rng, frames)
        confirmed += recent.confirm(Gaussian(rng.multivariate_normal(true, SURE), SURE))
    assert confirmed >= 396


@pytest.mark.parametrize("frames", [1, 6])
def test_a_heading_six_deviations_off_does_not(frames):
    """Six times what pose and way together are unsure by."""
    rng = np.random.default_rng(5)
    confirmed = 0
    for _ in range(200):
        recent, true = walked(rng, frames)
        turned = math.sqrt(SURE[2, 2] + frames * MOTION_COVARIANCE[2, 2])
        confirmed += recent.confirm(Gaussian(true + np.array([0.0, 0.0, 6.0 * turned]), SURE))
    assert confirmed <= 10


def test_without_other_frames_no_pose_is_confirmed():
    recent = RecentSightings()
    assert not recent.confirm(Gaussian(np.zeros(3), SURE))
    places = np.array([[2.0, 1.0]])
    recent.add(look(np.zeros(3), places, None), places)
    assert recent.confirm(Gaussian(np.zeros(3), SURE))
    recent.clear()
    assert not recent.confirm(Gaussian(np.zeros(3), SURE))


def test_only_the_last_frames_are_remembered():
    recent, places = RecentSightings(), np.array([[2.0, 1.0]])
    here, elsewhere = np.zeros(3), np.array([1.0, 0.5, 1.0])
    for pose in (elsewhere,) * REMEMBERED + (here,) * REMEMBERED:
        recent.add(look(pose, places, None), places)
    assert recent.confirm(Gaussian(here, SURE))
    assert not recent.confirm(Gaussian(elsewhere, SURE))
