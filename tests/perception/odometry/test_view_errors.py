"""Covariances of view errors, against errors drawn from the Gaussian process that they describe."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from perception.depth.distortion import Distortion
from perception.odometry import view_errors
from perception.odometry.pose_uncertainty import error_transport, rigid_alignment
from perception.odometry.pyramid import build
from perception.odometry.view_errors import (
    ViewErrorSize,
    view_correlation,
    view_error_covariances,
)
from perception.primitives.camera import Camera
from perception.primitives.frame import Depth

OWN = np.diag(np.square([0.005] * 3 + [0.009] * 3))
IMAGES = 40


def path(length_m: float, turn_deg: float) -> tuple[np.ndarray, np.ndarray]:
    """Positions and rotations of a camera that moves on a curve and turns."""
    share = np.linspace(0.0, 1.0, IMAGES)
    positions = length_m * np.column_stack([share, 0.3 * np.sin(5.0 * share), 0.1 * share**2])
    return positions, Rotation.from_euler("z", turn_deg * share[:, None], degrees=True).as_matrix()


def correlation(positions: np.ndarray, rotations: np.ndarray) -> np.ndarray:
    return view_correlation(positions, rotations, positions, rotations)


def drawn(positions: np.ndarray, rotations: np.ndarray, count: int) -> np.ndarray:
    """View errors (count, n, 6)."""
    alike = correlation(positions, rotations) + 1e-9 * np.eye(len(positions))
    rng = np.random.default_rng(3)
    plain = rng.normal(size=(count, len(positions), 6)) * np.sqrt(np.diag(OWN))
    return np.linalg.cholesky(alike) @ plain


@pytest.mark.parametrize(("length_m", "turn_deg"), [(0.1, 2.0), (1.0, 30.0), (4.0, 200.0)])
def test_covariances_are_those_of_drawn_errors(length_m, turn_deg):
    positions, rotations = path(length_m, turn_deg)
    claims = view_error_covariances(positions, rotations, OWN)
    errors = drawn(positions, rotations, 3000)
    moves, best = rigid_alignment(positions)
    common = np.einsum("nij,snj->si", best, errors)
    left = errors - np.einsum("nij,sj->sni", moves, common)
    levers = np.stack([error_transport(p - positions[0]) for p in positions])
    since = errors - np.einsum("nij,sj->sni", levers, errors[:, 0])
    for found, sample in ((claims.aligned, left), (claims.from_start, since)):
        variances = np.diagonal(found, axis1=1, axis2=2)[1:]
        # 3000 draws: a variance has a relative standard deviation of 2.6 %
        np.testing.assert_allclose(sample.var(axis=0)[1:], variances, rtol=0.15, atol=1e-12)


def size_of(distortion: Distortion, *distances_m: float) -> np.ndarray:
    """Variances of the view errors of walls at these distances."""
    size = ViewErrorSize()
    for distance_m in distances_m:
        z = np.full((48, 64), distance_m, np.float32)
        flat = Depth(z, 0.002 * z, Camera(64, 48, 60.0, 60.0, 31.5, 23.5))
        size.add(build(flat, distortion=distortion))
    return np.diag(size.covariance)


def test_a_camera_without_distortion_has_no_view_error():
    assert np.all(size_of(Distortion(), 1.0, 3.0) == 0.0)
    assert np.all(size_of(Distortion(share=0.01)) == 0.0)  # no image yet


def test_view_errors_grow_with_the_distortion_and_with_its_growth_over_distance():
    share, growing = Distortion(share=0.01), Distortion(share_per_m=0.01)
    np.testing.assert_allclose(
        size_of(Distortion(share=0.03), 2.0), 9.0 * size_of(share, 2.0), rtol=1e-6
    )
    np.testing.assert_allclose(size_of(share, 3.0)[3:], size_of(share, 1.0)[3:], rtol=1e-6)
    np.testing.assert_allclose(size_of(share, 3.0)[:3], 9.0 * size_of(share, 1.0)[:3], rtol=1e-5)
    np.testing.assert_allclose(
        size_of(growing, 3.0)[3:], 9.0 * size_of(growing, 1.0)[3:], rtol=1e-5
    )
    np.testing.assert_allclose(
        size_of(share, 1.0, 3.0), (size_of(share, 1.0) + size_of(share, 3.0)) / 2.0, rtol=1e-6
    )


def test_nearly_equal_views_share_their_error_and_different_views_do_not():
    near = view_error_covariances(*path(0.02, 0.5), OWN).from_start[-1]
    far = view_error_covariances(*path(8.0, 170.0), OWN).from_start[-1]
    assert np.all(np.diag(near) < 0.2 * np.diag(OWN))
    assert np.all(np.diag(far) > 1.9 * np.diag(OWN))


def test_the_correlation_falls_with_the_documented_lengths_and_power():
    """1/e at 0.35 m or 10 deg, and exp(-d^1.5) at d times as much."""
    none, eye = np.zeros((1, 3)), np.eye(3)[None]
    lengths = np.array([0.5, 1.0, 2.0])
    expected = np.exp(-(lengths**1.5))
    moved = np.outer(0.35 * lengths, [0.6, 0.0, -0.8])
    found = view_correlation(none, eye, moved, np.repeat(eye, 3, axis=0))[0]
    np.testing.assert_allclose(found, expected, rtol=1e-9)
    turned = Rotation.from_rotvec(np.outer(np.radians(10.0) * lengths, [0.0, 0.6, 0.8]))
    found = view_correlation(none, eye, np.zeros((3, 3)), turned.as_matrix())[0]
    np.testing.assert_allclose(found, expected, rtol=0.03)  # a chord is shorter than its arc


def test_the_correlation_is_positive_definite_and_does_not_depend_on_the_axes():
    positions, rotations = path(3.0, 300.0)
    alike = correlation(positions, rotations)
    assert np.linalg.eigvalsh(alike).min() > -1e-9
    np.testing.assert_allclose(np.diag(alike), 1.0, atol=1e-6)
    turn = Rotation.from_rotvec([0.4, -1.0, 0.7]).as_matrix()
    other = correlation(positions @ turn.T + [3.0, -2.0, 1.0], turn @ rotations)
    np.testing.assert_allclose(alike, other, atol=1e-6)


def test_long_trajectories_are_summed_over_some_of_their_images(monkeypatch):
    positions, rotations = path(1.0, 30.0)
    whole = view_error_covariances(positions, rotations, OWN).aligned
    monkeypatch.setattr(view_errors, "MOST_IMAGES", IMAGES // 3)
    thinned = view_error_covariances(positions, rotations, OWN).aligned
    size = np.sqrt(np.diagonal(whole, axis1=1, axis2=2))
    np.testing.assert_allclose(np.sqrt(np.diagonal(thinned, axis1=1, axis2=2)), size, rtol=0.25)
