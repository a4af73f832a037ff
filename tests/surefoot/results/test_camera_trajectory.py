"""The trajectory of a camera in space and its covariances."""

from __future__ import annotations

import itertools

import numpy as np
from scipy.spatial.transform import Rotation

from perception.localisation.camera_pose import CameraPose
from perception.odometry.pose_uncertainty import error_transport
from perception.primitives.pose import Pose3
from perception.smoothing.factors import turned_covariance
from surefoot.evaluation.metrics.gauge_alignment import errors_in_space
from surefoot.results import object_file
from surefoot.results.camera_trajectory import CameraTrajectory, aligned_covariances
from surefoot.results.run_folder import RunFolder
from surefoot.results.tables import Trajectory

STEPS = 25
STEP_SIGMA = np.array([0.004] * 3 + [0.003] * 3)
OWN_SIGMA = np.array([0.003] * 3 + [0.004] * 3)


def walk(rng: np.random.Generator | None) -> list[Pose3]:
    """A camera on an arc; with a generator, each step has an error."""
    poses, pose = [], Pose3()
    turn = Rotation.from_euler("xyz", (0.02, 0.01, 0.12)).as_matrix()
    for k in range(STEPS):
        if k:
            pose = pose @ Pose3.from_rotation(turn, np.array([0.1, 0.02, 0.01]))
            if rng is not None:
                pose = pose @ small(STEP_SIGMA * rng.normal(size=6))
        poses.append(pose)
    return poses


def small(error: np.ndarray) -> Pose3:
    return Pose3.from_rotation(Rotation.from_rotvec(error[3:]).as_matrix(), error[:3])


def claimed() -> np.ndarray:
    """Accumulated covariance of each pose of the walk, first order."""
    truth = walk(None)
    shared = [np.zeros((6, 6))]
    for before, after in itertools.pairwise(truth):
        lever = error_transport(after.position - before.position)
        step = turned_covariance(np.diag(STEP_SIGMA**2), after.rotation)
        shared.append(lever @ shared[-1] @ lever.T + step)
    return np.array(shared)


def test_covariances_after_alignment_fit_the_errors_that_alignment_leaves():
    truth = walk(None)
    positions = np.array([pose.position for pose in truth])
    left = aligned_covariances(positions, claimed())
    rng, nees = np.random.default_rng(4), []
    for _ in range(200):
        errors = errors_in_space(as_trajectory(walk(rng)), as_trajectory(truth))
        nees.append(np.mean([e @ np.linalg.solve(P, e) for e, P in zip(errors, left, strict=True)]))
    assert 0.9 * 6 < np.mean(nees) < 1.1 * 6


def as_trajectory(poses: list[Pose3]) -> Trajectory:
    return Trajectory(
        np.arange(float(len(poses))),
        np.array([pose.position for pose in poses]),
        np.array([pose.quat_xyzw for pose in poses]),
    )


def test_poses_are_written_in_the_map_frame_from_the_first_frame_on(tmp_path):
    folder = RunFolder.create(tmp_path / "run")
    trajectory = CameraTrajectory()
    shared, of_view = claimed(), np.diag(OWN_SIGMA**2)
    for k, pose in enumerate(walk(None)):
        trajectory.append(float(k), CameraPose(pose, shared[k], of_view))
    upright = Pose3.from_rotation(Rotation.from_euler("x", 0.5).as_matrix(), np.array([0, 0, 1.0]))
    object_file.loads(object_file.dumps(trajectory)).write(folder, upright)
    found = folder.read_trajectory("trajectory.txt")
    expected = [upright @ pose for pose in walk(None)]
    np.testing.assert_array_equal(found.positions, [pose.translation for pose in expected])
    np.testing.assert_allclose(found.quats_xyzw, [pose.quat_xyzw for pose in expected], atol=1e-15)
    table = folder.read_csv("space_covariance.csv")
    assert len(table) == STEPS
    start = table.matrix(*(f"start_{i}{i}" for i in range(6)))
    assert (start[0] == 0.0).all()
    accumulated = np.diag(turned_covariance(shared[-1], upright.rotation))
    assert (start[-1] > accumulated).all()


def test_without_a_pose_nothing_is_written(tmp_path):
    folder = RunFolder.create(tmp_path / "run")
    CameraTrajectory().write(folder, None)
    assert not folder.has("trajectory.txt")
