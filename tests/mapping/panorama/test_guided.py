"""Encoder priors: they predict features, limit the rotation of a pair, and fix the neck position."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mapping.panorama.adjustment import Prior, adjust
from mapping.panorama.matches import Guide, ViewFeatures, match_features
from mapping.panorama.pairs import Link, PairConfig, rotation_link
from mapping.panorama.surfaces import align, surface
from mapping.panorama.views import PriorConfig, prior_covariance
from perception.features.matching import match
from perception.primitives.camera import Camera
from perception.primitives.frame import Depth
from perception.primitives.pose import Pose3, head_rotation

TOF = Camera.from_view(176, 144, math.radians(44.0), math.radians(35.0))


def unit(values):
    values = np.asarray(values, np.float32)
    return values / np.linalg.norm(values, axis=1, keepdims=True)


def test_only_allowed_pairs_are_matched():
    rng = np.random.default_rng(0)
    first = unit(rng.standard_normal((6, 128)))
    second = unit(np.concatenate([first, first + 0.3 * unit(rng.standard_normal((6, 128)))]))
    allowed = np.zeros((6, 12), bool)
    allowed[np.arange(6), np.arange(6) + 6] = True
    np.testing.assert_array_equal(match(first, second)[:, 1], np.arange(6))
    np.testing.assert_array_equal(match(first, second, None, allowed)[:, 1], np.arange(6) + 6)


def test_a_single_candidate_must_still_be_similar():
    rng = np.random.default_rng(1)
    first, second = unit(rng.standard_normal((5, 128))), unit(rng.standard_normal((5, 128)))
    assert len(match(first, second, None, np.eye(5, dtype=bool))) == 0


def test_encoders_resolve_ambiguous_features():
    """Every feature occurs twice, as on a row of equal boxes; only the encoders can tell them apart."""
    rng = np.random.default_rng(2)
    points = np.column_stack([rng.uniform(-0.5, 0.5, (12, 2)), np.full(12, 1.5)])
    points = np.concatenate([points, points + np.array([0.4, 0.0, 0.0])])
    words = unit(rng.standard_normal((12, 128)))
    words = np.concatenate([words, words])
    turn = Pose3.from_rotation(Rotation.from_rotvec([0.0, 0.2, 0.0]).as_matrix(), np.zeros(3))

    def seen(xyz):
        reach = np.linalg.norm(xyz, axis=1)
        return ViewFeatures(xyz / reach[:, None], reach, words, np.zeros(len(xyz), np.int64))

    both = seen(points), seen(turn.apply(points))
    assert len(match_features(*both)) == 0
    guided = match_features(*both, Guide(turn, math.radians(0.7), 0.002))
    assert len(guided) == 24
    np.testing.assert_array_equal(guided[:, 0], guided[:, 1])


def test_features_in_rows_are_not_matched_if_the_encoders_cannot_tell_them_apart():
    """The true twin is hidden, so a neighbour in the row is the only candidate."""
    rng = np.random.default_rng(3)
    words = np.repeat(unit(rng.standard_normal((6, 128))), 2, axis=0)
    rows = np.column_stack([np.tile([-0.15, 0.15], 6), np.repeat(np.linspace(-0.4, 0.4, 6), 2)])
    points = np.column_stack([rows, np.full(12, 2.0)])
    reach = np.linalg.norm(points, axis=1)
    rays, kind = points / reach[:, None], np.zeros(12, np.int64)
    first = ViewFeatures(rays, reach, words, kind)
    second = ViewFeatures(rays[1::2], reach[1::2], words[1::2], kind[1::2])
    alone = ViewFeatures(rays[::2], reach[::2], words[::2], kind[::2])
    still = Pose3()
    assert len(match_features(first, second, Guide(still, math.radians(0.7), 0.002))) == 6
    assert len(match_features(first, second, Guide(still, math.radians(4.0), 0.002))) == 0
    assert len(match_features(alone, second, Guide(still, math.radians(4.0), 0.002))) == 6


@pytest.mark.parametrize(("wrong", "accepted"), [(2, True), (8, False)])
def test_few_matches_are_a_pair_if_they_agree_by_more_than_chance(wrong, accepted):
    rng = np.random.default_rng(4)
    guide, found = Guide(Pose3(), math.radians(2.0), 0.002), 0
    turn = Rotation.from_rotvec([0.01, 0.03, 0.0])
    for _ in range(50):
        first = np.column_stack([rng.uniform(-0.3, 0.3, (8, 2)), np.ones(8)])
        first /= np.linalg.norm(first, axis=1, keepdims=True)
        second = turn.apply(first)
        aside = 0.1 * rng.uniform(-1.0, 1.0, (wrong, 3))
        second[:wrong] = first[:wrong] + aside
        second /= np.linalg.norm(second, axis=1, keepdims=True)
        none, kind = np.zeros((8, 128), np.float32), np.zeros(8, np.int64)
        both = tuple(ViewFeatures(rays, np.full(8, 2.0), none, kind) for rays in (first, second))
        pairs = np.column_stack([np.arange(8)] * 2)
        link = rotation_link((0, 1), both, pairs, guide, rng, PairConfig())
        found += link is not None
        if link is not None and accepted:
            off = Rotation.from_matrix(link.T_first_second.rotation) * turn
            assert math.degrees(off.magnitude()) < 2.0
    assert found == 50 if accepted else found <= 2


def wall_and_floor(pan):
    """A wall perpendicular to x, and the floor: the position along the wall is unobservable."""
    pose = Pose3.from_rotation(head_rotation(pan, 0.3), np.array([0.0, 0.0, 0.55]))
    rays = TOF.rays @ pose.rotation.T
    with np.errstate(divide="ignore"):
        z = np.where(rays[..., 2] < 0.0, -0.55 / rays[..., 2], np.inf)
        z = np.minimum(z, np.where(rays[..., 0] > 0.0, 1.2 / rays[..., 0], np.inf))
    z = z + 0.003 * np.random.default_rng(round(1e3 * abs(pan))).standard_normal(z.shape)
    return pose, surface(Depth(z.astype(np.float32), np.full(z.shape, 0.004, np.float32), TOF))


def test_a_fixed_neck_position_prevents_sliding_along_a_wall():
    one, target = wall_and_floor(0.15)
    other, source = wall_and_floor(-0.15)
    true = one.inverse() @ other
    off = Rotation.from_rotvec(one.rotation.T @ [0.0, 0.0, math.radians(1.0)]).as_matrix()
    found = align(target, source, Pose3.from_rotation(off @ true.rotation, true.position), 0.002)
    assert found is not None
    assert np.linalg.norm(found.T_to_from.position - true.position) < 0.004
    turn = Rotation.from_matrix(found.T_to_from.rotation.T @ true.rotation).magnitude()
    assert math.degrees(turn) < 0.25


def test_linked_views_have_correlated_yaws():
    """A good pair makes the difference of two yaws certain, and leaves their mean uncertain."""
    poses = [Pose3.from_rotation(head_rotation(pan, 0.0), np.zeros(3)) for pan in (0.25, -0.25)]
    priors = [Prior(pose, prior_covariance(pose, PriorConfig())) for pose in poses]
    sigma = math.radians(0.05)
    link = Link(0, 1, poses[0].inverse() @ poses[1], sigma**2 * np.eye(6), 50, 60)
    a, b = adjust(priors, [link], rotations_only=True)
    difference = math.sqrt(a.yaws[0] + b.yaws[1] - 2.0 * a.yaws[1])
    assert math.degrees(math.sqrt(a.yaws[0])) > 0.3
    assert math.degrees(difference) < 0.06
    np.testing.assert_allclose(a.yaws[1], b.yaws[0])


def test_a_good_pair_far_from_the_encoders_is_used():
    poses = [Pose3.from_rotation(head_rotation(pan, 0.0), np.zeros(3)) for pan in (0.25, -0.25)]
    off = Pose3.from_rotation(head_rotation(math.radians(1.4), 0.0), np.zeros(3))
    level = Pose3.from_rotation(head_rotation(0.0, 0.0), np.zeros(3))
    wrong = off @ level.inverse() @ poses[1]
    config = PriorConfig()
    priors = [Prior(pose, prior_covariance(pose, config)) for pose in (poses[0], wrong)]
    sigma = math.radians(0.06)
    link = Link(0, 1, poses[0].inverse() @ poses[1], sigma**2 * np.eye(6), 50, 60)
    a, b = adjust(priors, [link], rotations_only=True)
    between = a.T_base_camera.inverse() @ b.T_base_camera
    turn = Rotation.from_matrix(between.rotation.T @ link.T_first_second.rotation).magnitude()
    assert math.degrees(turn) < 0.15


def test_large_errors_of_pan_and_tilt_are_consistent_with_the_prior():
    """Together they also turn the camera about its axis, which a small-angle covariance leaves out."""
    rng, sigma = np.random.default_rng(6), 6.0
    prior = Pose3.from_rotation(head_rotation(0.5, 0.3), np.zeros(3))
    covariance = prior_covariance(prior, PriorConfig(pan_deg=sigma, tilt_deg=sigma))[:3, :3]
    squares = []
    for pan, tilt in np.radians(sigma) * rng.standard_normal((400, 2)):
        true = head_rotation(0.5 + pan, 0.3 + tilt)
        error = Rotation.from_matrix(prior.rotation.T @ true).as_rotvec()
        squares.append(error @ np.linalg.solve(covariance, error))
    assert 1.7 < np.mean(squares) < 3.3  # two free angles
