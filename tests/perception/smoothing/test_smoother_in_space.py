"""Smoothing in space: axes of covariances, floors, and consistent marginals."""

from __future__ import annotations

import math

import numpy as np
import pytest

from perception.filtering.consistency import band
from perception.primitives.errors import InputError
from perception.primitives.plane import Plane
from perception.primitives.pose import Pose2, Pose3, head_rotation
from perception.smoothing.factors import Factor, FloorSeen, LoopClosure, Motion, Placement, PoseSeen
from perception.smoothing.fixed_lag import FixedLagSmoother
from perception.smoothing.smoother import SmootherConfig, solve

STEP = np.array([0.01, 0.01, 0.01, 0.005, 0.005, 0.005])
CLOSED = np.full(6, 0.01)
FLOOR = np.diag([0.02, 0.01, 0.02]) ** 2 + np.outer([0.0, 0.01, 0.02], [0.0, 0.01, 0.02]) * 0.9
BEGIN = Pose3.from_rotation(head_rotation(0.3, 0.4), np.array([0.2, -0.1, 1.2]))
START = Placement(BEGIN, np.diag([0.02, 0.02, 0.05, 0.04, 0.04, 0.02]) ** 2)


def turned(vector: np.ndarray) -> np.ndarray:
    """Rotation matrix of a rotation vector (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = vector / angle
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + math.sin(angle) * K + (1.0 - math.cos(angle)) * K @ K


def disturbed(pose: Pose3, error: np.ndarray) -> Pose3:
    """The pose with an error (x, y, z, rotation vector) in the axes it is given in."""
    return Pose3.from_rotation(turned(error[3:]) @ pose.rotation, pose.position + error[:3])


def difference(a: Pose3, b: Pose3) -> np.ndarray:
    """The error that leads from b to a, for small ones."""
    R = a.rotation @ b.rotation.T
    spin = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2.0
    return np.concatenate([a.position - b.position, spin])


def told(k: int) -> Pose3:
    spin = turned(np.array([0.02 * math.sin(k), 2 * math.pi / 18, 0.02 * math.cos(k)]))
    return Pose3.from_rotation(spin, np.array([0.02, 0.01, 0.1]))


def trajectory(
    rng: np.random.Generator, floors: bool = True, count: int = 19
) -> tuple[list[Factor], list[Pose3]]:
    """A round with a camera in the hand: odometry, the floor at every third pose, a closure at the end."""
    true = disturbed(BEGIN, np.sqrt(np.diag(START.covariance)) * rng.standard_normal(6))
    truth, factors = [true], []
    root = np.linalg.cholesky(FLOOR)
    for k in range(1, count):
        true = true @ disturbed(told(k), STEP * rng.standard_normal(6))
        truth.append(true)
        factors.append(Motion(k - 1, k, told(k), np.diag(STEP**2)))
        if floors and k % 3 == 0:
            floor = Plane(np.array([0.0, 0.0, 1.0]), 0.0).moved(true.inverse())
            a, b, c = root @ rng.standard_normal(3)
            normal = floor.normal - a * floor.tangents[0] - b * floor.tangents[1]
            normal /= np.linalg.norm(normal)
            factors.append(FloorSeen(k, Plane(normal, floor.offset_m - c, FLOOR)))
    closed = disturbed(truth[0].inverse() @ true, CLOSED * rng.standard_normal(6))
    factors.append(LoopClosure(0, count - 1, closed, np.diag(CLOSED**2)))
    return factors, truth


def test_the_covariance_of_a_pose_keeps_its_axes():
    rng = np.random.default_rng(0)
    root = 0.03 * rng.standard_normal((6, 6))
    place = Placement(BEGIN, root @ root.T + 1e-4 * np.eye(6))
    pose = solve([Motion(0, 1, told(1), np.diag(STEP**2))], place).poses[0]
    np.testing.assert_allclose(pose.covariance, place.covariance, rtol=1e-6, atol=1e-10)
    np.testing.assert_allclose(difference(pose.pose, BEGIN), np.zeros(6), atol=1e-9)


def test_a_motion_adds_the_covariance_of_monte_carlo():
    rng = np.random.default_rng(1)
    root = 0.01 * rng.standard_normal((6, 6))
    noise = root @ root.T + 1e-5 * np.eye(6)
    small = Placement(BEGIN, np.diag([0.02, 0.01, 0.01, 0.02, 0.01, 0.03]) ** 2)
    pose = solve([Motion(0, 1, told(1), noise)], small).poses[1]
    ideal = BEGIN @ told(1)
    cloud = []
    for _ in range(1500):
        begin = disturbed(BEGIN, np.sqrt(np.diag(small.covariance)) * rng.standard_normal(6))
        step = disturbed(told(1), rng.multivariate_normal(np.zeros(6), noise))
        cloud.append(difference(begin @ step, ideal))
    whitened = np.linalg.solve(np.linalg.cholesky(pose.covariance), np.array(cloud).T)
    np.testing.assert_allclose(np.cov(whitened), np.eye(6), atol=0.2)  # 1500 draws: deviation .037


def test_marginals_in_space_are_consistent_over_50_runs():
    squares: dict[int, list[float]] = {6: [], 11: [], 18: []}
    for seed in range(50):
        factors, truth = trajectory(np.random.default_rng(seed))
        poses = solve(factors, START).poses
        for k, values in squares.items():
            error = difference(truth[k], poses[k].pose)
            values.append(float(error @ np.linalg.solve(poses[k].covariance, error)))
    low, high = band(6, 50, 0.98)  # three of them: 94 % that all are inside
    for values in squares.values():
        assert low < np.mean(values) < high


def test_floors_bound_the_drift_of_height_and_tilt():
    errors: dict[bool, list[np.ndarray]] = {True: [], False: []}
    for seed in range(10):
        for floors, kept in errors.items():
            factors, truth = trajectory(np.random.default_rng(seed), floors)
            poses = solve(factors, START).poses.values()
            kept += [difference(t, p.pose) for t, p in zip(truth, poses, strict=True)]
    with_floor, without = (
        np.sqrt(np.mean(np.square(errors[key]), axis=0)) for key in (True, False)
    )
    assert with_floor[2] < 0.7 * without[2]
    assert np.all(with_floor[3:5] < 0.7 * without[3:5])


def test_a_floor_determines_height_and_tilt():
    tilt = Pose3.from_rotation(turned(np.array([0.1, -0.05, 0.0])), np.array([0.0, 0.0, 1.3]))
    floor = Plane(np.array([0.0, 0.0, 1.0]), 0.0).moved(tilt.inverse())
    seen = Plane(floor.normal, floor.offset_m, np.eye(3) * 1e-10)
    vague = Placement(Pose3((0.0, 0.0, 1.2)), np.eye(6) * 0.2**2)
    still = Motion(0, 1, Pose3(), np.eye(6) * 1e-8)
    pose = solve([still, FloorSeen(0, seen)], vague).poses[0].pose
    assert pose.translation[2] == pytest.approx(1.3, abs=1e-3)
    np.testing.assert_allclose(pose.rotation[2], tilt.rotation[2], atol=1e-3)


def test_the_fixed_lag_smoother_takes_floors_and_loop_closures():
    factors, truth = trajectory(np.random.default_rng(5))
    smoother = FixedLagSmoother(START, (), SmootherConfig(lag_s=1.0))
    smoother.update(0.0, [])
    for k in range(1, 19):
        new = [f for f in factors if not isinstance(f, LoopClosure) and _last(f) == k]
        smoother.update(0.1 * k, new)
    pose = smoother.pose(18)
    assert isinstance(pose, Placement)
    error = difference(truth[18], pose.pose)
    assert error @ np.linalg.solve(pose.covariance, error) < 22.5  # chi-square, 6 degrees, 99.9 %


def _last(factor: Factor) -> int:
    return factor.after if isinstance(factor, (Motion, LoopClosure)) else factor.pose


def test_factors_on_the_floor_and_in_space_are_not_mixed():
    seen = PoseSeen(1, Placement(Pose3(), np.eye(6)))
    with pytest.raises(InputError, match="mixed"):
        solve([Motion(1, 2, Pose2(), np.eye(3)), seen], START)
