"""Pose graphs as g2o text: GTSAM reads what was written."""

from __future__ import annotations

import math

import gtsam
import numpy as np
import pytest

from perception.primitives.errors import OutputError
from perception.primitives.gaussian import Gaussian
from perception.primitives.pose import Pose2, Pose3
from perception.smoothing.factors import (
    Factor,
    Glance,
    LandmarkSeen,
    LoopClosure,
    Motion,
    Placement,
)
from perception.smoothing.smoother import solve
from surefoot.offline.g2o import write_g2o

NOISE = np.array([[4e-4, 1e-4, 0.0], [1e-4, 1e-4, 0.0], [0.0, 0.0, 9e-4]])


def planar() -> list[Factor]:
    """Eight steps round, a landmark seen from the first two, and the end seen from the beginning."""
    step, whole = Pose2(0.3, 0.05, 0.7), Pose2()
    for _ in range(8):
        whole = whole @ step
    mark = np.array([1.0, 0.3])
    glances = []
    for k, pose in enumerate((Pose2(), step)):
        x, y = pose.inverse().apply(mark)
        measured = np.array([math.hypot(x, y) + 0.005, math.atan2(y, x) - 0.01])
        glances.append(Glance(k, (LandmarkSeen(5, measured, np.diag([0.01, 0.02]) ** 2),)))
    motions = [Motion(k, k + 1, step, NOISE) for k in range(8)]
    return [*motions, *glances, LoopClosure(0, 8, whole @ Pose2(0.02, -0.01, 0.03), NOISE)]


def test_landmark_numbers_follow_those_of_the_poses(tmp_path):
    factors = planar()
    found = solve(factors, Gaussian(np.zeros(3), np.eye(3) * 1e-8))
    assert write_g2o(tmp_path / "walk.g2o", factors, found) == 11
    words = [line.split() for line in (tmp_path / "walk.g2o").read_text().splitlines()]
    (mark,) = [line for line in words if line[0] == "VERTEX_XY"]
    assert mark[1] == "9"
    np.testing.assert_array_equal([float(w) for w in mark[2:]], found.landmarks[5].mean)
    first = next(line for line in words if line[0] == "EDGE_SE2_XY")
    distance, bearing = factors[8].seen[0].measured
    seen = distance * np.array([math.cos(bearing), math.sin(bearing)])
    np.testing.assert_allclose([float(w) for w in first[3:5]], seen, atol=1e-12)
    xx, xy, yy = (float(w) for w in first[5:])
    along = np.array([math.cos(bearing), math.sin(bearing)])
    assert along @ np.array([[xx, xy], [xy, yy]]) @ along == pytest.approx(1 / 0.01**2)
    graph, _ = gtsam.readG2o(str(tmp_path / "walk.g2o"), False)
    assert graph.size() == 9  # its reader passes landmarks over, and is not upset by them


def test_gtsam_reads_the_poses_and_finds_the_same_optimum(tmp_path):
    # Without landmarks: GTSAM's reader makes its own covariances of those.
    factors = [factor for factor in planar() if not isinstance(factor, Glance)]
    start = Gaussian(np.zeros(3), np.eye(3) * 1e-8)
    found = solve(factors, start)
    assert write_g2o(tmp_path / "walk.g2o", factors, found) == 9
    graph, values = gtsam.readG2o(str(tmp_path / "walk.g2o"), False)
    for number, pose in found.poses.items():
        read = values.atPose2(number)
        np.testing.assert_allclose([read.x(), read.y(), read.theta()], pose.mean, atol=1e-9)
    graph.add(
        gtsam.PriorFactorPose2(0, values.atPose2(0), gtsam.noiseModel.Isotropic.Sigma(3, 1e-4))
    )
    solved = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    marginals = gtsam.Marginals(graph, solved)
    for number, pose in found.poses.items():
        read = solved.atPose2(number)
        np.testing.assert_allclose([read.x(), read.y(), read.theta()], pose.mean, atol=1e-4)
        turn = np.eye(3)
        turn[:2, :2] = read.rotation().matrix()
        P = turn @ marginals.marginalCovariance(number) @ turn.T
        np.testing.assert_allclose(P, pose.covariance, rtol=1e-3, atol=1e-7)


def test_a_graph_in_space_is_read_back_too(tmp_path):
    spin = Pose3.from_rotation(
        np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), np.array([0.3, 0.1, 0.02])
    )
    root = np.random.default_rng(0).standard_normal((6, 6))
    noise = 1e-4 * (root @ root.T + np.eye(6))
    factors: list[Factor] = [Motion(k, k + 1, spin, noise) for k in range(4)]
    factors.append(LoopClosure(0, 4, Pose3((0.01, -0.02, 0.09)), noise))
    found = solve(factors, Placement(Pose3(), np.eye(6) * 1e-8))
    assert write_g2o(tmp_path / "space.g2o", factors, found) == 5
    graph, values = gtsam.readG2o(str(tmp_path / "space.g2o"), True)
    assert graph.size() == 5
    for number, pose in found.poses.items():
        assert isinstance(pose, Placement)
        np.testing.assert_allclose(values.atPose3(number).matrix(), pose.pose.matrix, atol=1e-9)
    anchor = gtsam.noiseModel.Isotropic.Sigma(6, 1e-4)
    graph.add(gtsam.PriorFactorPose3(0, gtsam.Pose3(), anchor))
    solved = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    for number in found.poses:
        np.testing.assert_allclose(
            solved.atPose3(number).matrix(), found.poses[number].pose.matrix, atol=1e-4
        )


def test_an_unwritable_path_is_an_output_error(tmp_path):
    factors = planar()
    found = solve(factors, Gaussian(np.zeros(3), np.eye(3) * 1e-8))
    with pytest.raises(OutputError, match="cannot write"):
        write_g2o(tmp_path / "nowhere" / "walk.g2o", factors, found)
