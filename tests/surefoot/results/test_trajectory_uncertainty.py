"""Covariances of camera trajectories, against errors drawn from these covariances."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from perception.odometry.pose_uncertainty import (
    AttachedImage,
    error_transport,
    planar_gaussian,
    pose_uncertainty,
    rigid_alignment,
)
from perception.primitives.gaussian import Gaussian
from perception.primitives.plane import Plane
from perception.primitives.pose import Pose3
from perception.smoothing.factors import FloorSeen, LoopClosure, Motion, Placement
from perception.smoothing.smoother import SmootherConfig, solve
from surefoot.evaluation.evaluate import evaluate
from surefoot.evaluation.metrics.gauge_alignment import (
    aligned_consistency,
    aligned_on_floor,
    body_rotation_deg,
    errors_in_space,
    errors_on_floor,
)
from surefoot.results.run_folder import COVARIANCE_HEADER, RunFolder, estimate_row
from surefoot.results.tables import Trajectory
from surefoot.results.trajectory_uncertainty import write_covariances

POSES = 30
STEP = np.diag(np.square([0.004, 0.003, 0.003, 0.004, 0.003, 0.005]))
CLOSE = np.diag(np.square([0.006] * 3 + [0.006] * 3))
FLOOR = np.diag(np.square([0.01, 0.01, 0.01]))
CLOSURES = ((0, 12), (3, 20), (8, 29))


def exp(error: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return Rotation.from_rotvec(error[3:]).as_matrix(), error[:3]


def disturbed(pose: Pose3, error: np.ndarray) -> Pose3:
    """The pose with an error of (x, y, z, rotation vector) in the axes of its parent frame."""
    turn, shift = exp(error)
    return Pose3.from_rotation(turn @ pose.rotation, pose.position + shift)


def drawn(rng: np.random.Generator, covariance: np.ndarray) -> np.ndarray:
    return rng.multivariate_normal(np.zeros(len(covariance)), covariance)


def true_poses() -> list[Pose3]:
    """A curved trajectory through a room; the camera pans and looks down."""
    path = []
    for t in np.linspace(0.0, 1.0, POSES):
        position = np.array([1.5 * np.cos(4 * t), 1.2 * np.sin(5 * t), 1.3 + 0.2 * np.sin(9 * t)])
        turn = Rotation.from_euler("ZYX", [3 * t, 0.2 * np.sin(7 * t), -2.0 + 0.2 * np.cos(5 * t)])
        path.append(Pose3.from_rotation(turn.as_matrix(), position))
    return path


def factors_of(path: list[Pose3], rng: np.random.Generator) -> list:
    """Steps, loop closures and floors, measured with errors drawn from their covariances."""
    made: list = []
    pairs = [(i, i + 1) for i in range(POSES - 1)]
    for kind, covariance, between in ((Motion, STEP, pairs), (LoopClosure, CLOSE, CLOSURES)):
        for a, b in between:
            motion = disturbed(path[a].inverse() @ path[b], drawn(rng, covariance))
            made.append(kind(a, b, motion, covariance))
    for number in range(0, POSES, 5):
        pose = path[number]
        normal, height = pose.rotation.T[:, 2], float(pose.position[2])
        a, b, c = drawn(rng, FLOOR)
        first, second = Plane(normal, height).tangents
        seen = normal + a * first + b * second
        made.append(FloorSeen(number, Plane(seen / np.linalg.norm(seen), height + c, FLOOR)))
    return made


def turned(path: list[Pose3]) -> list[Pose3]:
    """The same trajectory in other world axes."""
    other = Pose3.from_rotation(
        Rotation.from_rotvec([0.7, -1.1, 0.4]).as_matrix(), np.array([3.0, -2.0, 5.0])
    )
    return [other @ pose for pose in path]


def trajectory(path: list[Pose3]) -> Trajectory:
    return Trajectory(
        0.1 * np.arange(len(path)),
        np.array([pose.position for pose in path]),
        np.array([pose.quat_xyzw for pose in path]),
    )


@pytest.fixture(scope="module")
def solved():
    """Solved graphs with drawn errors: poses, covariances and true trajectory of each."""
    runs = []
    for seed in range(12):
        path = true_poses()
        made = factors_of(path, np.random.default_rng(seed))
        start = Placement(path[0], 1e-2 * np.eye(6))
        solution = solve(made, start, (), SmootherConfig())
        kept = [one for one in made if not any(one is out for out in solution.rejected)]
        poses = {n: place.pose for n, place in solution.poses.items()}
        covariances = pose_uncertainty(
            kept, poses, [AttachedImage(poses[n], n, np.zeros((6, 6))) for n in range(POSES)]
        )
        runs.append(([poses[n] for n in range(POSES)], covariances, path))
    return runs


def test_the_covariances_of_a_graph_are_consistent_with_errors_drawn_from_its_factors(solved):
    aligned, since = [], []
    for found, covariances, path in solved:
        errors = errors_in_space(trajectory(found), trajectory(turned(path)))
        aligned += [
            e @ np.linalg.solve(P, e) for e, P in zip(errors, covariances.aligned, strict=True)
        ]
        gauge_of = found[0] @ path[0].inverse()
        for pose, true, P in zip(found[1:], path[1:], covariances.from_start[1:], strict=True):
            there = gauge_of @ true
            turn = Rotation.from_matrix(pose.rotation @ there.rotation.T).as_rotvec()
            e = np.append(pose.position - there.position, turn)
            since.append(e @ np.linalg.solve(P, e))
    # 12 runs of which each is worth some five independent poses: sigma of the mean 0.45
    assert np.mean(aligned) == pytest.approx(6.0, abs=1.5)
    assert np.mean(since) == pytest.approx(6.0, abs=1.5)


def test_most_runs_are_consistent_and_overconfident_ones_are_flagged(solved):
    consistent, overconfident = 0, 0
    for found, covariances, path in solved:
        errors = errors_in_space(trajectory(found), trajectory(turned(path)))
        figures = aligned_consistency(errors, covariances.aligned)
        assert figures["pose_dof"] == 6.0
        consistent += bool(figures["pose_consistent"])
        tight = aligned_consistency(errors, covariances.aligned / 9.0)
        overconfident += tight["pose_anees"] > tight["pose_anees_high"]
        assert tight["pose_variance_ratio"] == pytest.approx(9 * figures["pose_variance_ratio"])
        assert {"pose_x_anees", "pose_turn_z_anees_high", "pose_y_consistent"} <= set(figures)
    assert consistent >= 8
    assert overconfident >= 11


def test_the_standard_deviations_of_the_truth_are_added():
    rng = np.random.default_rng(0)
    errors = rng.normal(size=(400, 6)) * np.array([0.01] * 3 + [0.02] * 3)
    nothing = np.tile(1e-10 * np.eye(6), (400, 1, 1))
    assert aligned_consistency(errors, nothing, (0.01, 0.02))["pose_consistent"]
    assert not aligned_consistency(errors, nothing, (0.005, 0.02))["pose_consistent"]


def test_alignment_removes_a_rigid_transform_completely():
    path = true_poses()
    left = errors_in_space(trajectory(path), trajectory(turned(path)))
    np.testing.assert_allclose(left, 0.0, atol=1e-9)
    moves, best = rigid_alignment(np.array([pose.position for pose in path]))
    small = np.array([0.1, -0.2, 0.3, 0.02, 0.01, -0.03])
    np.testing.assert_allclose(np.einsum("nij,nj->i", best, moves @ small), small, atol=1e-12)


def test_an_image_beside_a_pose_of_the_graph_has_the_covariance_of_both():
    path = true_poses()[:3]
    made = [Motion(0, 1, path[0].inverse() @ path[1], STEP)]
    poses = {0: path[0], 1: path[1]}
    nothing = np.zeros((6, 6))
    hung = [
        AttachedImage(path[0], 0, nothing),
        AttachedImage(path[1], 1, nothing),
        AttachedImage(path[2], 1, STEP),
    ]
    covariances = pose_uncertainty(made, poses, hung).from_start
    both = pose_uncertainty(
        [*made, Motion(1, 2, path[1].inverse() @ path[2], STEP)],
        {**poses, 2: path[2]},
        [AttachedImage(pose, n, nothing) for n, pose in enumerate(path)],
    ).from_start
    np.testing.assert_allclose(covariances, both, atol=1e-12)
    np.testing.assert_allclose(covariances[0], 0.0, atol=1e-12)


def test_image_distortion_acts_as_an_uncertain_transform_between_image_and_pose():
    path = true_poses()[:4]
    own = np.diag(np.square([0.005] * 3 + [0.009] * 3))
    motions = [Motion(n, n + 1, path[n].inverse() @ path[n + 1], STEP) for n in range(3)]
    nothing = np.zeros((6, 6))
    covariances = pose_uncertainty(
        motions, dict(enumerate(path)), [AttachedImage(p, n, own) for n, p in enumerate(path)]
    )
    hung = [Motion(n, 10 + n, Pose3(), own) for n in range(4)]
    poses = {**dict(enumerate(path)), **{10 + n: pose for n, pose in enumerate(path)}}
    images = [AttachedImage(pose, 10 + n, nothing) for n, pose in enumerate(path)]
    expected = pose_uncertainty([*motions, *hung], poses, images)
    np.testing.assert_allclose(covariances.from_start, expected.from_start, atol=1e-12)
    np.testing.assert_allclose(covariances.aligned, expected.aligned, atol=1e-12)
    np.testing.assert_allclose(covariances.from_start[0], 0.0, atol=1e-12)


def planar_walk(rng: np.random.Generator, shrink: float = 1.0) -> tuple[np.ndarray, ...]:
    """True and estimated (x, y, yaw) of an odometry, and its covariances, divided by `shrink`."""
    n = 120
    turn = np.sin(np.linspace(0, 9, n)) * 0.1
    step = np.diag(np.square([0.002, 0.001, 0.0015]))
    true, found = np.zeros((n, 3)), np.zeros((n, 3))
    P = np.zeros((n, 3, 3))
    for k in range(1, n):
        motion = np.array([0.05, 0.0, turn[k]])
        for path, made in ((true, motion), (found, motion + drawn(rng, step))):
            c, s = np.cos(path[k - 1, 2]), np.sin(path[k - 1, 2])
            path[k] = path[k - 1] + [c * made[0] - s * made[1], s * made[0] + c * made[1], made[2]]
        dx, dy = found[k, :2] - found[k - 1, :2]
        carry = np.array([[1, 0, -dy], [0, 1, dx], [0, 0, 1.0]])
        c, s = np.cos(found[k - 1, 2]), np.sin(found[k - 1, 2])
        R = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
        P[k] = carry @ P[k - 1] @ carry.T + R @ step @ R.T / shrink
    return true, found, P + 1e-8 * np.eye(3)


def test_the_covariances_of_an_odometry_are_consistent_after_planar_alignment():
    ratios = []
    for seed in range(60):
        true, found, P = planar_walk(np.random.default_rng(seed))
        errors = errors_on_floor(found, true + np.array([3.0, -1.0, 0.0]))
        series = aligned_consistency(errors, aligned_on_floor(found[:, :2], P))
        ratios.append(series["pose_variance_ratio"])
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.2)  # sigma of the mean about 0.05


def write_run(folder: RunFolder, found: np.ndarray, P: np.ndarray) -> None:
    stamps = 0.1 * np.arange(len(found))
    rows = [
        estimate_row(float(t), Gaussian(m, C)) for t, m, C in zip(stamps, found, P, strict=True)
    ]
    folder.write_csv("trajectory_covariance.csv", COVARIANCE_HEADER, rows)
    folder.write_planar_trajectory()
    folder.write_json("summary.json", {})
    header = ("stamp_s", "camera", "nx", "ny", "nz", "height_m", "state")
    normal = Rotation.from_euler("X", -2.0).as_matrix().T[:, 2]
    folder.write_csv(
        "floor.csv",
        (*header, "P00", "P01", "P02", "P11", "P12", "P22", "share"),
        [
            (float(t), "depth", *normal, 1.3, "seen", *[1e-5, 0, 0, 1e-5, 0, 1e-5], 0.5)
            for t in stamps
        ],
    )


@pytest.mark.parametrize(("factor", "flagged"), [(1.0, False), (16.0, True)])
def test_a_run_without_poses_is_compared_with_a_truth_in_other_axes(tmp_path, factor, flagged):
    true, found, P = planar_walk(np.random.default_rng(5), factor)
    folder = RunFolder.create(tmp_path / "run")
    write_run(folder, found, P)
    cameras = []
    for x, y, yaw in true:  # the optical axis looks ahead and down
        down = Rotation.from_euler("X", -2.0)
        level = Rotation.from_euler("Z", yaw - np.pi / 2)
        cameras.append(Pose3.from_rotation((level * down).as_matrix(), np.array([x, y, 1.3])))
    lines = [
        " ".join(str(float(v)) for v in (0.1 * k, *pose.position, *pose.quat_xyzw))
        for k, pose in enumerate(turned(cameras))
    ]
    (tmp_path / "truth.txt").write_text("\n".join(lines))
    figures = evaluate(folder, tmp_path / "truth.txt")
    assert figures["pose_dof"] == 3.0
    assert (figures["pose_anees"] > figures["pose_anees_high"]) == flagged
    assert 0.2 * factor < figures["pose_variance_ratio"] < 3.0 * factor


def test_a_map_is_compared_with_a_truth_in_other_axes_but_not_of_another_body(tmp_path, solved):
    found, covariances, path = solved[0]
    folder = RunFolder.create(tmp_path / "map")
    stamps = [0.1 * k for k in range(POSES)]
    write_covariances(folder, stamps, found, covariances)
    folder.write_json("summary.json", {})

    def written(name: str, poses: list[Pose3]) -> None:
        lines = [
            " ".join(str(float(v)) for v in (t, *pose.position, *pose.quat_xyzw))
            for t, pose in zip(stamps, poses, strict=True)
        ]
        (tmp_path / name).write_text("\n".join(lines))

    written("map/trajectory.txt", found)
    written("same.txt", turned(path))
    marker = Pose3.from_rotation(Rotation.from_rotvec([0.0, 1.2, 0.5]).as_matrix(), np.zeros(3))
    written("marker.txt", [pose @ marker for pose in path])
    figures = evaluate(folder, tmp_path / "same.txt")
    errors = errors_in_space(trajectory(found), trajectory(path))
    assert figures["pose_anees"] == pytest.approx(
        aligned_consistency(errors, covariances.aligned)["pose_anees"]
    )
    other = evaluate(folder, tmp_path / "marker.txt")
    assert "pose_anees" not in other
    assert other["ate_m"] == pytest.approx(figures["ate_m"])
    angle = body_rotation_deg(trajectory(path), trajectory([pose @ marker for pose in path]))
    assert angle == pytest.approx(np.degrees(np.linalg.norm([1.2, 0.5])), abs=1e-6)


def test_the_heading_of_a_tilted_camera_has_the_projected_covariance():
    rng = np.random.default_rng(1)
    pose = true_poses()[4]
    covariance = (
        error_transport(np.array([0.3, 0.2, 0.1]))
        @ STEP
        @ error_transport(np.array([0.3, 0.2, 0.1])).T
    )
    flat = planar_gaussian(pose, covariance)
    samples = []
    for _ in range(4000):
        ahead = disturbed(pose, drawn(rng, covariance)).rotation[:, 2]
        samples.append(np.arctan2(ahead[1], ahead[0]))
    assert np.std(samples) == pytest.approx(np.sqrt(flat.covariance[2, 2]), rel=0.05)
