"""Transformed planes keep their distances; the covariance equals that of samples."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from perception.primitives.plane import Plane
from perception.primitives.pose import Pose3

seeds = st.integers(0, 2**32 - 1)


def some_plane(rng: np.random.Generator, spread: float = 1.0) -> Plane:
    """A plane with any normal, and a covariance of about a degree and a centimetre."""
    normal = rng.normal(size=3)
    root = rng.normal(size=(3, 3)) * np.array([[0.015], [0.02], [0.01]]) * spread
    return Plane(
        normal / np.linalg.norm(normal), float(rng.uniform(-2, 2)), root @ root.T + np.eye(3) * 1e-8
    )


def some_motion(rng: np.random.Generator) -> Pose3:
    return Pose3.from_rotation(
        Rotation.from_rotvec(rng.normal(size=3)).as_matrix(), rng.uniform(-2, 2, 3)
    )


@given(seeds)
def test_tangents_and_normal_form_a_right_handed_frame(seed):
    plane = some_plane(np.random.default_rng(seed))
    frame = np.vstack([plane.tangents, plane.normal])
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-12)
    assert math.isclose(np.linalg.det(frame), 1.0, abs_tol=1e-12)


@given(seeds)
def test_a_moved_plane_is_as_far_from_a_moved_point(seed):
    rng = np.random.default_rng(seed)
    plane, motion, points = some_plane(rng), some_motion(rng), rng.uniform(-3, 3, (5, 3))
    np.testing.assert_allclose(
        plane.moved(motion).distance(motion.apply(points)), plane.distance(points), atol=1e-9
    )


@given(seeds)
def test_a_transform_and_its_inverse_restore_the_plane_and_its_covariance(seed):
    rng = np.random.default_rng(seed)
    plane, motion = some_plane(rng), some_motion(rng)
    again = plane.moved(motion).moved(motion.inverse())
    np.testing.assert_allclose(again.normal, plane.normal, atol=1e-9)
    assert math.isclose(again.offset_m, plane.offset_m, abs_tol=1e-9)
    np.testing.assert_allclose(again.covariance, plane.covariance, atol=1e-9)


@given(seeds)
def test_the_error_between_two_planes_leads_from_one_to_the_other(seed):
    rng = np.random.default_rng(seed)
    plane = some_plane(rng)
    error = rng.normal(size=3) * 0.001
    tilted = plane.normal + error[:2] @ plane.tangents
    other = Plane(tilted / np.linalg.norm(tilted), plane.offset_m + float(error[2]))
    np.testing.assert_allclose(plane.error_to(other), error, atol=1e-9)
    assert math.isclose(plane.angle_to(other), math.hypot(*error[:2]), rel_tol=1e-5, abs_tol=1e-9)


def test_the_covariance_of_a_moved_plane_equals_that_of_moved_samples():
    rng = np.random.default_rng(3)
    for _ in range(2):
        plane, motion = some_plane(rng, spread=0.3), some_motion(rng)
        moved = plane.moved(motion)
        errors = rng.multivariate_normal(np.zeros(3), plane.covariance, size=2500)
        found = []
        for error in errors:
            normal = plane.normal + error[:2] @ plane.tangents
            sample = Plane(normal / np.linalg.norm(normal), plane.offset_m + float(error[2]))
            found.append(moved.error_to(sample.moved(motion)))
        sampled = np.cov(np.array(found).T)
        size = np.sqrt(np.outer(np.diag(moved.covariance), np.diag(moved.covariance)))
        # 2500 samples: an entry's deviation is at most sqrt(2 / 2500) = 3 % of the product of sigmas
        np.testing.assert_allclose(sampled / size, moved.covariance / size, atol=0.1)


def test_opposite_normals_are_half_a_turn_apart():
    up, down = Plane(np.array([0.0, 0.0, 1.0]), 0.4), Plane(np.array([0.0, 0.0, -1.0]), 0.4)
    assert math.isclose(up.angle_to(down), math.pi)
