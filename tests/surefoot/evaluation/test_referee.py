"""The referee for foreign trajectories: known claims are judged as they are, and every format gives the same verdict."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy import integrate, stats
from scipy.spatial.transform import Rotation

from perception.odometry.pose_uncertainty import compounded
from perception.primitives.errors import InputError
from perception.primitives.pose import Pose3
from perception.smoothing.factors import Motion, Placement
from perception.smoothing.smoother import Solution
from surefoot.evaluation.foreign_covariance import (
    ALIGNED,
    GRAPH,
    GROWING,
    UNFIT,
    WORDS,
    read_claims,
)
from surefoot.evaluation.foreign_trajectory import read_trajectory, units_of
from surefoot.evaluation.metrics.calibration import (
    IN_BAND,
    TOO_CAREFUL,
    TOO_SURE,
    by_halves,
    conformal_radius,
    correlation_time,
    coverage_sigma,
    crps,
    verdict,
)
from surefoot.evaluation.metrics.trajectory import align
from surefoot.evaluation.referee import judge_files
from surefoot.offline.g2o import write_g2o
from surefoot.report.referee_page import headline, lines

UPPER = np.triu_indices(6)
ELSEWHERE = Pose3.from_rotation(
    Rotation.from_rotvec([0.3, 1.0, 2.0]).as_matrix(), np.array([3.0, 4.0, 5.0])
)


class Walk:
    """An odometry with independent errors of known covariance, and its truth."""

    def __init__(self, seed: int, claim: float = 1.0, n: int = 240) -> None:
        rng = np.random.default_rng(seed)
        sigma = np.array([0.004] * 3 + [0.002] * 3)
        self.true, self.found = [Pose3()], [Pose3()]
        self.covariances, self.motions = [np.zeros((6, 6))], []
        self.step = np.diag(sigma**2) / claim**2
        for k in range(n):
            turn = Rotation.from_rotvec([0.01 * np.sin(k / 9), 0.0, 0.05 * np.cos(k / 15)])
            e = rng.normal(size=6) * sigma
            motion = Pose3.from_rotation(
                turn.as_matrix(), np.array([0.05, 0.0, 0.01 * np.cos(k / 7)])
            )
            measured = Pose3.from_rotation(
                Rotation.from_rotvec(e[3:]).as_matrix() @ motion.rotation, motion.position + e[:3]
            )
            here = self.found[-1]
            self.covariances.append(compounded(self.covariances[-1], here, measured, self.step))
            self.motions.append(measured)
            self.true.append(self.true[-1] @ motion)
            self.found.append(here @ measured)
        self.stamps = 100.0 + 0.1 * np.arange(n + 1)

    def write(self, folder: Path, offset_s: float = 0.0) -> tuple[Path, Path, Path]:
        """Estimate, covariances and truth; the truth in axes of its own."""
        table = [[t, *P[UPPER]] for t, P in zip(self.stamps, self.covariances, strict=True)]
        np.savetxt(folder / "cov.csv", np.array(table), delimiter=",", fmt="%.17g")
        return (
            tum(folder / "found.txt", self.stamps, self.found),
            folder / "cov.csv",
            tum(folder / "true.txt", self.stamps + offset_s, [ELSEWHERE @ p for p in self.true]),
        )


def tum(path: Path, stamps: np.ndarray, poses: list[Pose3]) -> Path:
    rows = [[t, *p.translation, *p.quat_xyzw] for t, p in zip(stamps, poses, strict=True)]
    np.savetxt(path, np.array(rows), fmt="%.17g")
    return path


# --- verdicts on known claims ---


@pytest.mark.parametrize(
    ("claim", "words"), [(1.0, IN_BAND), (3.0, TOO_SURE), (1.0 / 3.0, TOO_CAREFUL)]
)
def test_claims_that_are_wrong_by_a_factor_of_three_are_called_so(tmp_path, claim, words):
    found = [
        judge_files(*walk.write(tmp_path)).metrics
        for walk in (Walk(s, claim, 120) for s in range(3))
    ]
    factor = math.sqrt(np.mean([one["motions"]["sigma_factor"] ** 2 for one in found]))
    assert factor == pytest.approx(claim, rel=0.05)
    assert all(one["motions"]["verdict"] == words for one in found)
    assert sum(one["verdict"] == words for one in found) >= 2  # each is right in 95 %
    squares = [one["sigma_factor"] ** 2 for one in found]
    low, high = (found[0][f"pose_anees_{end}"] / 6 * claim**2 for end in ("low", "high"))
    assert low < np.mean(squares) < high  # a trajectory has few independent samples


def test_exact_claims_of_growing_errors_stay_exact_after_the_alignment(tmp_path):
    ratios = [
        judge_files(*Walk(seed, n=24).write(tmp_path)).metrics["sigma_factor"] ** 2
        for seed in range(20)
    ]
    assert np.mean(ratios) == pytest.approx(1.0, abs=3.5 * np.std(ratios) / math.sqrt(20))


@pytest.mark.parametrize(
    "columns",
    [
        "P_0,P_1,P_2,P_3,P_4,P_5,P_6,P_7,P_8",
        "sigma_x,sigma_y,sigma_z",
        "sigma_x,sigma_y,sigma_z,sigma_roll,sigma_pitch,sigma_yaw",
    ],
)
def test_motions_are_not_judged_by_claims_that_do_not_tell_how_rotations_move_them(
    tmp_path, columns
):
    """The claims are exact, whatever of them is written."""
    for seed in range(3):
        walk = Walk(seed)
        found, _, truth = walk.write(tmp_path)
        all_of = np.array(walk.covariances)
        values = all_of[:, :3, :3].reshape(-1, 9)
        if "sigma" in columns:
            sigmas = np.sqrt(np.diagonal(all_of, axis1=1, axis2=2))
            values = sigmas[:, : columns.count(",") + 1]
        table = np.column_stack([walk.stamps, values])
        header = f"stamp,{columns}"
        np.savetxt(tmp_path / "part.csv", table, delimiter=",", header=header, comments="")
        judged = judge_files(found, tmp_path / "part.csv", truth).metrics
        assert judged.get("motions", {"verdict": IN_BAND})["verdict"] == IN_BAND
        assert "rough guess" in judged["covariances"]


@pytest.mark.parametrize("planar", [False, True])
def test_independent_claims_of_three_components_stay_exact_after_the_alignment(tmp_path, planar):
    rng = np.random.default_rng(3)
    factors = []
    for _ in range(12):
        n = 30
        true = np.column_stack([np.cumsum(rng.normal(size=(n, 2)), axis=0), np.zeros(n)])
        if not planar:
            true[:, 2] = rng.normal(size=n)
        yaws = rng.uniform(-3.0, 3.0, n)
        e = rng.normal(size=(n, 3)) * 0.02
        moved = Rotation.from_euler("z", 0.7)
        level = np.diag([1.0, 1.0, 0.0 if planar else 1.0])
        tail = np.column_stack([np.zeros((n, 2)), np.sin(yaws / 2), np.cos(yaws / 2)])
        turned = (moved * Rotation.from_quat(tail)).as_quat()
        off = yaws + e[:, 2] * planar
        mine = np.column_stack([np.zeros((n, 2)), np.sin(off / 2), np.cos(off / 2)])
        stamps = np.arange(n)
        np.savetxt(tmp_path / "true.txt", np.column_stack([stamps, moved.apply(true), turned]))
        np.savetxt(tmp_path / "found.txt", np.column_stack([stamps, true + e @ level, mine]))
        last = "yaw" if planar else "z"
        names = ["stamp", "P_xx", "P_xy", f"P_x{last}", "P_yy", f"P_y{last}", f"P_{last}{last}"]
        cov = np.tile([4e-4, 0.0, 0.0, 4e-4, 0.0, 4e-4], (n, 1))
        np.savetxt(
            tmp_path / "cov.csv", np.column_stack([stamps, cov]), delimiter=",",
            header=",".join(names), comments="",
        )  # fmt: skip
        found = judge_files(tmp_path / "found.txt", tmp_path / "cov.csv", tmp_path / "true.txt")
        assert found.metrics["pose_dof"] == 3
        assert ("yaw" in found.metrics["by_component"]) == planar
        factors.append(found.metrics["pose_anees"] / 3.0)
    # NEES after the alignment loses the six (three) fitted numbers, and the covariance the same
    assert np.mean(factors) == pytest.approx(1.0, abs=0.12)


def test_poses_in_the_axes_of_the_truth_are_not_aligned(tmp_path):
    rng = np.random.default_rng(0)
    n = 400
    poses = [Pose3((0.1 * k, 0.0, 0.0)) for k in range(n)]  # a straight line determines no roll
    off = [
        Pose3((0.1 * k + e[0], e[1], e[2])) for k, e in enumerate(rng.normal(size=(n, 3)) * 0.03)
    ]
    truth = tum(tmp_path / "t.txt", np.arange(n), poses)
    found = tum(tmp_path / "f.txt", np.arange(n), off)
    np.savetxt(tmp_path / "c.csv", np.tile((0.01**2 * np.eye(3)).ravel(), (n, 1)), delimiter=",")
    judged = judge_files(found, tmp_path / "c.csv", truth, same_axes=True).metrics
    assert judged["verdict"] == TOO_SURE
    assert judged["factor"] == pytest.approx(3.0, rel=0.1)
    with_truth = judge_files(
        found, tmp_path / "c.csv", truth, same_axes=True, truth_sigma=(math.sqrt(8) * 0.01, 0.0)
    ).metrics
    assert with_truth["verdict"] == IN_BAND  # the truth's own doubt explains the rest


def test_covariances_in_the_axes_of_the_poses_are_turned_into_those_of_the_world(tmp_path):
    walk = Walk(1, n=40)
    found, cov, _ = walk.write(tmp_path)
    local = []
    for pose, P in zip(walk.found, walk.covariances, strict=True):
        R = np.kron(np.eye(2), pose.rotation)
        local.append((R.T @ P @ R).ravel())
    np.savetxt(tmp_path / "local.csv", np.array(local), delimiter=",", fmt="%.17g")
    world = read_claims(cov, read_trajectory(found))
    turned = read_claims(tmp_path / "local.csv", read_trajectory(found), body_axes=True)
    np.testing.assert_allclose(turned.covariances, world.covariances, atol=1e-15)


def test_a_pose_graph_gives_the_covariances_of_the_odometry_that_it_holds(tmp_path):
    walk = Walk(2, n=50)
    found, cov, _ = walk.write(tmp_path)
    factors = [Motion(k, k + 1, motion, walk.step) for k, motion in enumerate(walk.motions)]
    poses = {k: Placement(pose, np.eye(6)) for k, pose in enumerate(walk.found)}
    write_g2o(tmp_path / "g.g2o", factors, Solution(poses))
    estimate = read_trajectory(found)
    table, graph = read_claims(cov, estimate), read_claims(tmp_path / "g.g2o", estimate)
    assert (table.shared, graph.shared) == (GROWING, GRAPH)
    np.testing.assert_allclose(graph.covariances, table.covariances, rtol=1e-5, atol=1e-10)
    every = np.arange(51)
    np.testing.assert_allclose(
        graph.left(estimate.poses, every), table.left(estimate.poses, every), rtol=1e-4, atol=1e-9
    )
    (tmp_path / "cut.g2o").write_text("VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\nEDGE_SE3:QUAT 0 1 1 0\n")
    with pytest.raises(InputError, match=r"line 2: 4 numbers after EDGE_SE3:QUAT; expected 30"):
        read_claims(tmp_path / "cut.g2o", estimate)


def test_a_planar_pose_graph_gives_planar_covariances(tmp_path):
    lines = [f"VERTEX_SE2 {k} {k}.0 0.0 0.0" for k in range(4)]
    lines += [f"EDGE_SE2 {k} {k + 1} 1.0 0.0 0.0 10000 0 0 10000 0 1000000" for k in range(3)]
    (tmp_path / "g.g2o").write_text("\n".join(lines))
    found = tum(tmp_path / "f.txt", np.arange(4), [Pose3((float(k), 0.0, 0.0)) for k in range(4)])
    claims = read_claims(tmp_path / "g.g2o", read_trajectory(found))
    assert claims.covariances.shape == (4, 3, 3)
    # x: three steps of 1 cm; y: the same and headings of 1 mrad over 2 m and 1 m; yaw: three times 1 mrad
    expected = [3e-4, 3e-4 + 1e-6 * (4 + 1), 3e-6]
    np.testing.assert_allclose(np.diag(claims.covariances[3]), expected, rtol=1e-4)


def test_a_pose_graph_is_a_trajectory_too(tmp_path):
    walk = Walk(2, n=50)
    found, _, truth = walk.write(tmp_path)
    factors = [Motion(3 * k, 3 * k + 3, motion, walk.step) for k, motion in enumerate(walk.motions)]
    graph = tmp_path / "g.g2o"
    poses = {3 * k: Placement(pose, np.eye(6)) for k, pose in enumerate(walk.found)}
    write_g2o(graph, factors, Solution(poses))
    lines = graph.read_text().splitlines()
    graph.write_text("\n".join(lines[::-1]))  # vertices count by their numbers, not by their lines
    ours = judge_files(graph, graph, truth).metrics
    assert ours.pop("format") == "g2o"
    theirs = judge_files(found, graph, truth).metrics
    assert theirs.pop("format") == "TUM"
    assert ours.pop("doubt", "") == theirs.pop("doubt", "") == ""
    assert ours.keys() == theirs.keys()
    assert ours["verdict"] == theirs["verdict"]
    for name in ("ate_m", "rpe_frame_m", "pose_anees", "matched_poses"):
        assert ours[name] == pytest.approx(theirs[name], rel=1e-5)


def test_a_planar_pose_graph_is_a_trajectory_with_headings(tmp_path):
    (tmp_path / "g.g2o").write_text(
        "VERTEX_SE2 7 1 2 1.5707963267948966\nVERTEX_SE2 4 0 0 0\nVERTEX_XY 9 5 5\n"
    )
    read = read_trajectory(tmp_path / "g.g2o")
    np.testing.assert_allclose(read.poses.positions, [[0, 0, 0], [1, 2, 0]])
    np.testing.assert_allclose(read.poses.yaws, [0.0, np.pi / 2])
    assert not read.has_stamps


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\nVERTEX_SE3:QUAT 1 0 0 0 0 0 0 2\n", "vertex 1 .* length 1"),
        ("VERTEX_SE3:QUAT 0 2e9 0 0 0 0 0 1\n", r"vertex 0 .* more than 1e\+09 m away"),
        ("VERTEX_SE3:QUAT 0 0 0 0 0 0 1\n", r"line 1: 7 numbers after VERTEX_SE3:QUAT; expected 8"),
        ("VERTEX_XY 0 0 0\n", "has no vertices; expected VERTEX_SE3:QUAT or VERTEX_SE2"),
    ],
)  # fmt: skip
def test_graphs_that_hold_no_trajectory_are_refused_with_the_reason(tmp_path, text, message):
    (tmp_path / "g.g2o").write_text(text)
    with pytest.raises(InputError, match=message):
        read_trajectory(tmp_path / "g.g2o")


# --- formats ---


def test_tum_kitti_and_euroc_files_of_one_trajectory_give_one_verdict(tmp_path):
    walk = Walk(5, n=80)
    found, _, truth = walk.write(tmp_path)
    square = np.array([P.ravel() for P in walk.covariances])
    np.savetxt(tmp_path / "full.csv", square, delimiter=",", fmt="%.17g")
    matrices = [pose.matrix[:3].ravel() for pose in walk.found]
    np.savetxt(tmp_path / "kitti.txt", np.array(matrices), fmt="%.17g")
    lines = ["#timestamp [ns], p_x [m], p_y [m], p_z [m], q_w [], q_x [], q_y [], q_z [], v_x"]
    for t, pose in zip(walk.stamps, walk.found, strict=True):
        x, y, z, w = pose.quat_xyzw
        numbers = (*pose.translation, w, x, y, z, 0.0)
        lines.append(f"{round((t + 1.4e9) * 1e9)}," + ",".join(f"{v:.17g}" for v in numbers))
    (tmp_path / "euroc.csv").write_text("\n".join(lines))
    late = tum(tmp_path / "late.txt", walk.stamps + 1.4e9, [ELSEWHERE @ p for p in walk.true])
    judged = [
        judge_files(found, tmp_path / "full.csv", truth).metrics,
        judge_files(tmp_path / "kitti.txt", tmp_path / "full.csv", truth).metrics,
        judge_files(tmp_path / "euroc.csv", tmp_path / "full.csv", late).metrics,
    ]
    assert [one["format"] for one in judged] == ["TUM", "KITTI", "EuRoC"]
    for name in ("position_rmse_3d_m", "ate_m", "rpe_frame_m", "rpe_frame_deg", "pose_anees"):
        assert judged[1][name] == pytest.approx(judged[0][name], rel=1e-6)
        assert judged[2][name] == pytest.approx(judged[0][name], rel=1e-6)


def test_relative_errors_from_pose_to_pose_are_those_of_the_evo_package(recordings):
    folder = recordings / "tum_trajectories"
    found = judge_files(
        folder / "freiburg1_xyz-rgbdslam.txt", None, folder / "freiburg1_xyz-groundtruth.txt"
    ).metrics
    # evo 1.38.1: evo_rpe and evo_ape tum, RMSE as printed by default and with -r angle_deg
    expected = {"rpe_frame_m": 0.005764370848928, "rpe_frame_deg": 0.3536131610448}
    expected |= {"position_rmse_3d_m": 0.020079418378507, "matched_poses": 785}
    assert {name: found[name] for name in expected} == pytest.approx(expected, rel=1e-9)
    assert found["note"] == "no covariances given: accuracy only"


def test_covariances_of_a_run_of_our_own_are_taken_as_those_after_alignment(tmp_path):
    walk = Walk(6, n=20)
    found, _, _ = walk.write(tmp_path)
    pairs = [f"{i}{j}" for i in range(6) for j in range(i, 6)]
    names = ["stamp_s"] + [f"start_{p}" for p in pairs] + [f"aligned_{p}" for p in pairs]
    rows = [[t, *np.zeros(21), *np.eye(6)[UPPER]] for t in walk.stamps]
    np.savetxt(tmp_path / "s.csv", rows, delimiter=",", header=",".join(names), comments="")
    claims = read_claims(tmp_path / "s.csv", read_trajectory(found))
    assert claims.shared == ALIGNED
    np.testing.assert_array_equal(claims.covariances, np.tile(np.eye(6), (21, 1, 1)))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1 2 3\n", r"line 1: 3 numbers; expected 8 \(TUM"),
        ("a picture\n", "holds no poses"),
        ("words\nmore words\n0 0 0 0 0 0 0 1\n", "line 2: no numbers; expected 8"),
        ("0 0 0 x 0 0 0 1\n1 0 0 0 0 0 0 1\n", "line 1: no numbers; expected 8"),
        (
            "0 0 0 0 0 0 0 1\n5e6 0 0 0 0 0 0 1\n",
            r"5e\+06 apart \(median\) may be in us or ns; give",
        ),
        ("0 0 0 0 0 0 0 1\n1e12 0 0 0 0 0 0 1\n", "are in none of s, ms, us, ns; give"),
        ("0 0 0 0 0 0 0 1\n1 0 0 0 0 0 1\n", "line 2: .* is not a pose; expected 8"),
        ("0 0 0 0 1 1 0 1\n", r"length 1.732, not 1; read as TUM \(qx qy qz qw"),
        ("2 0 0 0 0 2 0 0 0 0 2 0\n", "no rotation; 12 numbers were read as KITTI"),
        ("0 0 0 0 0 0 0 1\n1 0 1e300 0 0 0 0 1\n", r"line 2: the position is more than 1e\+09 m"),
        ("1 0 0 0 0 1 0 0 0 0 1 -1e10\n", r"line 1: the position is more than 1e\+09 m"),
    ],
)
def test_files_that_hold_no_trajectory_are_refused_with_the_reason(tmp_path, text, message):
    (tmp_path / "bad.txt").write_text(text)
    with pytest.raises(InputError, match=message):
        read_trajectory(tmp_path / "bad.txt")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1,2,3,4,5\n" * 21, "5 numbers per line; expected"),
        (("1,0,0,1,0,1\n") * 20, "20 covariances and .* 21 poses"),
        (("1,2,2,1,2,1\n") * 21, "covariance 0 .* not finite, symmetric and positive"),
        (
            "".join(f"{k},1,0,0,1,0,1\n" for k in range(21)),
            "covers 0.000 to 20.000 s, the trajectory 100.000",
        ),
        ("", "holds no covariances"),
        ("inf,0,0,1,0,1\n" * 21, "covariance 0 .* not finite, symmetric and positive"),
    ],
)
@pytest.mark.filterwarnings("error")
def test_covariances_that_do_not_belong_are_refused_with_the_reason(tmp_path, text, message):
    found, _, _ = Walk(0, n=20).write(tmp_path)
    (tmp_path / "bad.csv").write_text(text)
    with pytest.raises(InputError, match=message):
        read_claims(tmp_path / "bad.csv", read_trajectory(found))


def test_a_header_tells_the_order_of_the_quaternion(tmp_path):
    found, _, _ = Walk(0, n=20).write(tmp_path)
    table = np.loadtxt(found)
    np.savetxt(
        tmp_path / "w.csv", table[:, [0, 1, 2, 3, 7, 4, 5, 6]], delimiter=",", fmt="%.17g",
        header="timestamp,tx,ty,tz,qw,qx,qy,qz", comments="",
    )  # fmt: skip
    read = read_trajectory(tmp_path / "w.csv").poses.quats_xyzw
    np.testing.assert_allclose(read, read_trajectory(found).poses.quats_xyzw, atol=1e-12)
    np.savetxt(
        tmp_path / "first.csv", table[:, [0, 4, 5, 6, 7, 1, 2, 3]], delimiter=",",
        header="timestamp,qx,qy,qz,qw,a,b,c", comments="",
    )  # fmt: skip
    with pytest.raises(InputError, match="the header names the columns timestamp, qx"):
        read_trajectory(tmp_path / "first.csv")


@pytest.mark.parametrize(
    ("header", "row", "expected"),
    [
        ("stamp,sigma_x,sigma_y,sigma_z", [0.1, 0.2, 0.3], [0.01, 0.04, 0.09]),
        ("stamp,var_x,var_y,var_yaw", [0.1, 0.2, 0.3], [0.1, 0.2, 0.3]),
        (
            "stamp,std_x_m,std_y_m,std_z_m,std_roll_rad,std_pitch_rad,std_yaw_rad",
            [0.1, 0.1, 0.1, 0.2, 0.2, 0.2],
            [0.01, 0.01, 0.01, 0.04, 0.04, 0.04],
        ),
    ],
)
def test_columns_named_as_standard_deviations_or_variances_are_read_as_such(
    tmp_path, header, row, expected
):
    walk = Walk(0, n=20)
    found, _, _ = walk.write(tmp_path)
    rows = [[stamp, *row] for stamp in walk.stamps]
    np.savetxt(tmp_path / "s.csv", rows, delimiter=",", header=header, comments="")
    claims = read_claims(tmp_path / "s.csv", read_trajectory(found))
    np.testing.assert_allclose(claims.covariances[5], np.diag(expected), atol=1e-12)


def test_standard_deviations_in_degrees_are_refused(tmp_path):
    found, _, _ = Walk(0, n=20).write(tmp_path)
    header = "sigma_x,sigma_y,sigma_z,sigma_roll_deg,sigma_pitch_deg,sigma_yaw_deg"
    np.savetxt(tmp_path / "s.csv", np.ones((21, 6)), delimiter=",", header=header, comments="")
    with pytest.raises(InputError, match=r"the header names the columns sigma_x.*expected"):
        read_claims(tmp_path / "s.csv", read_trajectory(found))


def test_a_factor_beyond_reason_is_printed_in_few_digits(tmp_path):
    walk = Walk(0, n=60)
    found, _, truth = walk.write(tmp_path)
    tiny = np.tile(1e-300 * np.eye(6)[UPPER], (61, 1))
    np.savetxt(tmp_path / "c.csv", tiny, delimiter=",", fmt="%.17g")
    metrics = judge_files(found, tmp_path / "c.csv", truth).metrics
    assert max(len(line) for line in lines(metrics)) < 200
    assert "e+" in headline(metrics)[0]


def test_of_two_covariances_for_one_pose_the_first_counts(tmp_path):
    found, _, _ = Walk(0, n=20).write(tmp_path)
    lines = [f"{100 + 0.1 * k},{k + 1},0,0,{k + 1},0,{k + 1}" for k in range(21)]
    lines.insert(4, lines[3].replace(",4", ",99"))
    (tmp_path / "twice.csv").write_text("\n".join(lines))
    claims = read_claims(tmp_path / "twice.csv", read_trajectory(found))
    np.testing.assert_array_equal(claims.rows, np.arange(21))
    np.testing.assert_array_equal(claims.covariances[:, 0, 0], np.arange(1, 22))


def test_a_truth_of_another_time_is_refused_with_both_ranges(tmp_path):
    found, cov, truth = Walk(0, n=20).write(tmp_path, offset_s=500.0)
    with pytest.raises(
        InputError, match=r"covers 600.000 to 602.000 s, the trajectory 100.000 to 102.000 s"
    ):
        judge_files(found, cov, truth)


def with_scalar_first(path: Path, folder: Path) -> Path:
    table = np.loadtxt(path)
    changed = folder / f"wxyz-{path.name}"
    np.savetxt(changed, table[:, [0, 1, 2, 3, 7, 4, 5, 6]], fmt="%.17g")
    return changed


def inverted(path: Path, folder: Path) -> Path:
    table = np.loadtxt(path)
    back = Rotation.from_quat(table[:, 4:]).inv()
    changed = folder / f"inverse-{path.name}"
    rows = np.column_stack([table[:, 0], -back.apply(table[:, 1:4]), back.as_quat()])
    np.savetxt(changed, rows, fmt="%.17g")
    return changed


@pytest.mark.parametrize("change", [with_scalar_first, inverted])
@pytest.mark.parametrize(
    ("found", "truth"),
    [
        ("freiburg1_xyz-rgbdslam_drift.txt", "freiburg1_xyz-groundtruth.txt"),
        ("fr2_desk_ORB.txt", "fr2_desk_groundtruth.txt.gz"),
    ],
)
def test_another_convention_of_a_real_trajectory_is_doubted_by_the_name_of_its_file(
    recordings, tmp_path, change, found, truth
):
    found, truth = (recordings / "tum_trajectories" / name for name in (found, truth))
    assert "doubt" not in judge_files(found, None, truth).metrics
    wrong = change(found, tmp_path)
    assert judge_files(wrong, None, truth).metrics["doubt"].count(str(wrong)) == 1
    wrong_truth = change(truth, tmp_path)
    doubt = judge_files(found, None, wrong_truth).metrics["doubt"]
    assert str(wrong_truth) in doubt
    assert str(found) not in doubt


@pytest.mark.parametrize("sigma", [0.01, 0.2, 1.0, 3.0])
def test_no_convention_is_doubted_because_of_large_errors(tmp_path, sigma):
    """A robot on the floor, its camera on a mount, with a heading and positions that drift."""
    mount = Pose3.from_rotation(
        Rotation.from_euler("zx", [-90, -110], degrees=True).as_matrix(), np.array([0.1, 0.0, 1.2])
    )
    for seed in range(20):
        rng = np.random.default_rng(seed)
        turns, drift = rng.normal(size=(2, 200)).cumsum(axis=1) * [[0.05], [sigma / 14]]
        bodies = []
        for yaws in (turns, turns + drift):
            steps = 0.1 * np.column_stack([np.cos(yaws), np.sin(yaws), 0.0 * yaws])
            turned = Rotation.from_euler("z", yaws[:, None]).as_matrix()
            pairs = zip(turned, steps.cumsum(axis=0), strict=True)
            bodies.append([Pose3.from_rotation(*pair) for pair in pairs])
        truth = tum(tmp_path / "true.txt", np.arange(200), bodies[0])
        found = tum(tmp_path / "found.txt", np.arange(200), [one @ mount for one in bodies[1]])
        assert "doubt" not in judge_files(found, None, truth).metrics


@pytest.mark.parametrize("late_s", [0.03, -0.03, 0.0])
def test_a_clock_that_differs_is_doubted(tmp_path, late_s):
    """A hand that turns a camera to and fro at up to 1 rad/s about each axis; poses on another body, with noise of .2 deg."""
    mount = Pose3.from_rotation(Rotation.from_rotvec([0.2, -0.3, 0.1]).as_matrix(), np.zeros(3))
    for seed in range(10):
        rng = np.random.default_rng(seed)
        phases = rng.uniform(0.0, 6.0, 3)
        stamps = np.arange(300) / 30.0

        def held(at_s, phases=phases):
            turns = Rotation.from_rotvec(0.5 * np.sin(2.0 * at_s[:, None] + phases))
            place = 0.3 * np.sin(at_s[:, None] + phases[::-1])
            return [Pose3.from_rotation(*one) for one in zip(turns.as_matrix(), place, strict=True)]

        noise = Rotation.from_rotvec(rng.normal(0.0, np.radians(0.2), (300, 3))).as_matrix()
        found = [
            Pose3.from_rotation(one.rotation @ turn, one.position) @ mount
            for one, turn in zip(held(stamps), noise, strict=True)
        ]
        truth = tum(tmp_path / "true.txt", stamps, held(stamps + late_s))
        words = judge_files(tum(tmp_path / "found.txt", stamps, found), None, truth).metrics.get("doubt", "")  # fmt: skip
        without = tmp_path / "kitti.txt"  # no stamps: nothing to say about a clock
        np.savetxt(without, [one.matrix[:3].ravel() for one in found])
        assert "doubt" not in judge_files(without, None, truth).metrics
        if late_s == 0.0:
            assert words == ""
            continue
        found_ms = float(words.split("stamps were ")[1].split(" ms")[0])
        assert found_ms == pytest.approx(30.0, abs=1.0)
        assert f" ms {'later' if late_s > 0.0 else 'earlier'}" in words


def test_a_wrong_order_of_quaternions_is_not_taken_for_a_rotated_body(tmp_path):
    found, covariances, truth = Walk(0).write(tmp_path)
    wrong = with_scalar_first(found, tmp_path)
    with pytest.raises(InputError, match=r"wxyz-found.txt may begin with qw: the rotation between"):
        judge_files(wrong, covariances, truth)
    (doubt,) = [one for one in lines(judge_files(wrong, None, truth).metrics) if "doubt" in one]
    assert "Reorder them" in doubt


def test_a_truth_of_a_rotated_body_is_refused(tmp_path):
    rng = np.random.default_rng(0)
    poses = [
        Pose3.from_rotation(Rotation.random(random_state=rng).as_matrix(), rng.normal(size=3))
        for _ in range(30)
    ]
    found = tum(tmp_path / "found.txt", np.arange(30), poses)
    np.savetxt(tmp_path / "cov.csv", np.tile(1e-4 * np.eye(6)[UPPER], (30, 1)), delimiter=",")
    mount = Pose3.from_rotation(Rotation.from_euler("x", 90, degrees=True).as_matrix(), np.zeros(3))
    body = tum(tmp_path / "body.txt", np.arange(30), [pose @ mount for pose in poses])
    with pytest.raises(InputError, match=r"rotated by 90 deg against"):
        judge_files(found, tmp_path / "cov.csv", body)


@pytest.mark.parametrize("start_s", [1.4e9, 1000.0])
@pytest.mark.parametrize(("unit", "factor"), [("s", 1), ("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_stamps_of_every_unit_are_read_as_seconds(tmp_path, start_s, unit, factor):
    walk = Walk(0, n=20)
    walk.stamps += start_s - 100.0
    _, _, truth = walk.write(tmp_path)
    found = tum(tmp_path / "other.txt", np.round(walk.stamps * factor), walk.found)
    if unit == "s":
        found = tum(tmp_path / "other.txt", walk.stamps, walk.found)
    np.testing.assert_allclose(read_trajectory(found).poses.stamps, walk.stamps, atol=1e-6)
    assert judge_files(found, None, truth).metrics["matched_poses"] == 21
    late = tum(tmp_path / "late.txt", np.round((walk.stamps + 0.03) * 1e6), walk.true)
    with pytest.raises(InputError, match=r"has no stamp within 0\.01 s"):
        judge_files(found, None, late)


@pytest.mark.parametrize(
    ("stamps", "units"),
    [
        (np.arange(9.0), ["s"]),  # numbers of frames
        (np.arange(9) * 33.0, ["ms"]),
        (1.4e9 + np.arange(9) * 60.0, ["s"]),  # a point each minute
        (1e12 + np.arange(9) * 1e8, ["ns"]),  # 1000 s of a simulation
        (1e12 + np.arange(9) * 5e6, ["us", "ns"]),
        (np.arange(9) * 2e3, ["ms", "us"]),
        (np.full(9, 1.4e18), ["ns"]),
    ],
)
def test_the_unit_of_stamps_follows_from_size_and_spacing(stamps, units):
    assert units_of(stamps) == units


def test_a_byte_order_mark_costs_no_pose(tmp_path):
    found, _, _ = Walk(0, n=20).write(tmp_path)
    marked = tmp_path / "marked.txt"
    marked.write_bytes(b"\xef\xbb\xbf" + found.read_bytes())
    assert read_trajectory(marked).lines == 21


def test_poses_that_are_not_compared_are_counted_with_the_reason(tmp_path):
    walk = Walk(0, n=20)
    _, _, truth = walk.write(tmp_path)
    stamps = walk.stamps.copy()
    stamps[3], stamps[7:9] = stamps[2], 1.0
    found = tum(tmp_path / "some.txt", stamps, walk.found)
    metrics = judge_files(found, None, truth).metrics
    assert (metrics["matched_poses"], metrics["poses"]) == (18, 21)
    reason = "2 have the stamp of another pose, 1 have no true pose of their own within 0.01 s"
    assert metrics["left_out"] == reason
    assert f"18 of 21 poses compared (TUM against TUM): {reason}" in lines(metrics)
    assert "left_out" not in judge_files(truth, None, truth).metrics
    one = tum(tmp_path / "one.txt", np.full(21, walk.stamps[0]), walk.found)
    with pytest.raises(
        InputError, match=r"only 1 of the 21 poses .*20 have the stamp.* at least 5"
    ):
        judge_files(one, None, truth)


def test_claims_that_grow_but_cannot_be_accumulated_are_judged_as_independent(tmp_path):
    rng = np.random.default_rng(0)
    n = 200
    angles = 0.02 * np.arange(n)
    true = [
        Pose3.from_rotation(
            Rotation.from_euler("z", a).as_matrix(), np.array([5 * np.cos(a), 5 * np.sin(a), 0.0])
        )
        for a in angles
    ]
    sigmas = np.sqrt(1e-12 + 9e-6 * np.arange(n))  # of metres and radians alike
    off = []
    for pose, sigma in zip(true, sigmas, strict=True):
        e = sigma * rng.normal(size=6)
        turned = Rotation.from_rotvec(e[3:]).as_matrix() @ pose.rotation
        off.append(Pose3.from_rotation(turned, pose.position + e[:3]))
    rows = [(sigma**2 * np.eye(6)).ravel() for sigma in sigmas]
    np.savetxt(tmp_path / "c.csv", rows, delimiter=",", fmt="%.17g")
    truth = tum(tmp_path / "t.txt", np.arange(n), true)
    found = tum(tmp_path / "f.txt", np.arange(n), off)
    metrics = judge_files(found, tmp_path / "c.csv", truth).metrics
    assert metrics["covariances"] == WORDS[UNFIT]
    assert metrics["verdict"] == IN_BAND
    assert metrics["poses_judged"] >= n - 1


def _constant_claims(tmp_path, n, factor, first=1.0):
    """Independent errors of a walk on a circle, `factor` times as large as claimed; the first one `first` times."""
    rng = np.random.default_rng(4)
    angles = 0.02 * np.arange(n)
    true = [Pose3((5 * np.cos(a), 5 * np.sin(a), 0.0)) for a in angles]
    sizes = 0.02 * np.where(np.arange(n) > 0, 1.0, first)
    off = [
        Pose3(tuple(p.position + factor * s * rng.normal(size=3)))
        for p, s in zip(true, sizes, strict=True)
    ]
    rows = [(s**2 * np.eye(3)).ravel() for s in sizes]
    np.savetxt(tmp_path / "c.csv", rows, delimiter=",", fmt="%.17g")
    truth = tum(tmp_path / "t.txt", np.arange(n), true)
    return tum(tmp_path / "f.txt", np.arange(n), off), tmp_path / "c.csv", truth


@pytest.mark.parametrize("same_axes", [False, True])
def test_every_pose_with_an_independent_error_counts(tmp_path, same_axes):
    """2000 samples tell 6 % apart: the mean of 3 scatters by sqrt(6 / 2000)."""
    judged = judge_files(*_constant_claims(tmp_path, 2000, 1.06), same_axes).metrics
    assert judged["pose_effective_samples"] > 1800
    assert judged["verdict"] == TOO_SURE


@pytest.mark.parametrize("same_axes", [False, True])
def test_a_known_start_does_not_make_the_errors_of_a_localiser_accumulate(tmp_path, same_axes):
    """Else alignment would leave no covariance, or all poses be one sample, which tells nothing below 1.76 times."""
    judged = judge_files(*_constant_claims(tmp_path, 300, 1.5, first=1e-3), same_axes).metrics
    assert judged["verdict"] == TOO_SURE
    assert judged["factor"] == pytest.approx(1.5, rel=0.1)


def test_poses_without_stamps_need_as_many_true_poses(tmp_path):
    _, _, truth = Walk(0, n=20).write(tmp_path)
    np.savetxt(tmp_path / "k.txt", np.tile(np.eye(4)[:3].ravel(), (7, 1)))
    with pytest.raises(InputError, match=r"has 7 poses .* has 21; without stamps"):
        judge_files(tmp_path / "k.txt", None, truth)


# --- trajectories without rotations ---


def positions_of(file: Path, as_csv: bool = False) -> Path:
    """A TUM file without its rotations, as a total station gives it; with commas, names and ns if `as_csv`."""
    table = np.loadtxt(file)[:, :4]
    if not as_csv:
        np.savetxt(file.with_suffix(".xyz"), table, fmt="%.17g")
        return file.with_suffix(".xyz")
    rows = [f"{round(t * 1e9)},{x:.9f},{y:.9f},{z:.9f}" for t, x, y, z in table.tolist()]
    names = "#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m]"
    file.with_suffix(".csv").write_text("\n".join([names, *rows]))
    return file.with_suffix(".csv")


def test_growing_claims_are_judged_by_positions_alone(tmp_path):
    """The covariance after the alignment needs those of the rotations, which the claims have; without them it is .65."""
    ratios = []
    for seed in range(30):
        found, claims, truth = Walk(seed, n=120).write(tmp_path)
        metrics = judge_files(found, claims, positions_of(truth)).metrics
        assert metrics["pose_dof"] == 3
        assert "motions" not in metrics
        ratios.append(metrics["sigma_factor"] ** 2)
    spread = 3.5 * np.std(ratios) / math.sqrt(30)
    assert spread < 0.3
    assert np.mean(ratios) == pytest.approx(1.0, abs=spread)


@pytest.mark.parametrize("as_csv", [False, True])
@pytest.mark.parametrize("bare", ["truth", "estimate", "both"])
def test_positions_give_the_accuracy_of_positions_and_a_verdict(tmp_path, bare, as_csv):
    one = Localiser()
    found, truth, claims = one.tum(tmp_path), one.truth(tmp_path), one.table(tmp_path, one.own)
    whole = judge_files(found, None, truth).metrics
    if bare != "truth":
        found = positions_of(found, as_csv)
    if bare != "estimate":
        truth = positions_of(truth, as_csv)
    metrics = judge_files(found, claims, truth).metrics
    assert metrics["ate_m"] == pytest.approx(whole["ate_m"], rel=1e-6)
    assert metrics["verdict"] == IN_BAND
    assert "doubt" not in metrics
    assert not [name for name in metrics if name.startswith("rpe") or name.endswith("_deg")]
    assert any("no rotations in" in line for line in lines(metrics))


def test_positions_tell_world_to_camera_poses_and_axes_of_the_other_hand(tmp_path):
    one = Localiser()
    found, truth = one.tum(tmp_path), positions_of(one.truth(tmp_path))
    other = judge_files(inverted(found, tmp_path), None, truth).metrics
    assert "world-to-camera" in other["doubt"]
    one.true = one.true * [1.0, -1.0, 1.0]
    truth = positions_of(one.truth(tmp_path))
    assert "left-handed axes" in judge_files(found, None, truth).metrics["doubt"]


def test_what_needs_rotations_is_refused_with_positions(tmp_path):
    walk = Walk(1, n=20)
    found, claims, truth = walk.write(tmp_path)
    with pytest.raises(InputError, match="leave out --body-axes"):
        judge_files(positions_of(found), claims, truth, body_axes=True)
    np.savetxt(
        tmp_path / "floor.csv", np.tile(np.eye(3).ravel(), (21, 1)), delimiter=",",
        header="yaw" + ",P" * 8, comments="",
    )  # fmt: skip
    with pytest.raises(InputError, match=r"\(x, y, yaw\) cannot be compared"):
        judge_files(found, tmp_path / "floor.csv", positions_of(truth))


# --- files as other systems write them ---


class Localiser:
    """Independent errors of known covariance, which differs from axis to axis and turns with the body.

    Args:
        size: How many times larger the errors are than claimed.
        axes: Which of position and rotation have their errors in the axes of the body.
    """

    def __init__(self, size: float = 1.0, axes: tuple[bool, bool] = (False, False)) -> None:
        rng, n = np.random.default_rng(2), 300
        s = np.linspace(0.0, 12.0, n)
        self.stamps = 1403636580.0 + 0.05 * np.arange(n)
        self.true = np.column_stack([3 * np.sin(s), 2 * np.cos(0.7 * s), 0.5 * np.sin(1.3 * s)])
        self.turns = Rotation.from_euler("zyx", np.column_stack([s, 0.4 * np.sin(s), 0.2 * s]))
        spread = np.diag([0.05, 0.01, 0.02, 0.004, 0.02, 0.01])
        spread[1, 0], spread[2, 1], spread[5, 4] = 0.01, 0.01, 0.01
        self.own = spread @ spread.T
        e = size * rng.normal(size=(n, 6)) @ spread.T
        moved, turned = (
            self.turns.apply(part) if body else part
            for part, body in zip((e[:, :3], e[:, 3:]), axes, strict=True)
        )
        self.positions = self.true + moved
        self.found = Rotation.from_rotvec(turned) * self.turns

    @property
    def rows(self) -> np.ndarray:
        """x, y, z, qx, qy, qz, qw."""
        return np.column_stack([self.positions, self.found.as_quat()])

    def truth(self, folder: Path) -> Path:
        """TUM."""
        table = np.column_stack([self.stamps, self.true, self.turns.as_quat()])
        np.savetxt(folder / "true.txt", table, fmt="%.9f")
        return folder / "true.txt"

    def tum(self, folder: Path) -> Path:
        np.savetxt(folder / "tum.txt", np.column_stack([self.stamps, self.rows]), fmt="%.9f")
        return folder / "tum.txt"

    def table(self, folder: Path, own: np.ndarray) -> Path:
        """The same covariance for each pose, without names and stamps."""
        np.savetxt(folder / "cov.csv", np.tile(own.ravel(), (len(self.rows), 1)), delimiter=",")
        return folder / "cov.csv"


def _ros(one: Localiser, path: Path, names: str, stamps: list[list[str]]) -> Path:
    """A topic nav_msgs/Odometry as text: words among the numbers, the covariance of the velocity after that of the pose."""
    pose = [f"{part}{axis}" for part, axes in (("position.", "xyz"), ("orientation.", "xyzw")) for axis in axes]  # fmt: skip
    first = "field." if names.startswith("%") else ""
    mark = "" if first else "_"
    header = [names, *(f"{first}pose.pose.{one}" for one in pose)]
    header += [
        f"{first}{kind}.covariance{mark}{i}" for kind in ("pose", "twist") for i in range(36)
    ]
    cells = [f"{x:.9g}" for x in (*one.own.ravel(), *np.zeros(36))]
    lines = [
        ",".join([*stamp, "odom", "", *(f"{x:.9f}" for x in row), *cells])
        for stamp, row in zip(stamps, one.rows, strict=True)
    ]
    path.write_text("\n".join([",".join(header), *lines]))
    return path


def _as_openvins(one: Localiser, folder: Path) -> Path:
    table = np.column_stack(
        [one.stamps, one.rows, np.tile(np.concatenate([one.own[3:, 3:][np.triu_indices(3)], one.own[:3, :3][np.triu_indices(3)]]), (len(one.rows), 1))]
    )  # fmt: skip
    blocks = " ".join(f"P{part}{i}{j}" for part in "rt" for i in (1, 2, 3) for j in range(i, 4))
    path = folder / "openvins.txt"
    np.savetxt(path, table, fmt="%.9f", header=f"timestamp(s) tx ty tz qx qy qz qw {blocks}")
    return path


def _as_rostopic(one: Localiser, folder: Path) -> Path:
    names = "%time,field.header.seq,field.header.stamp,field.header.frame_id,field.child_frame_id"
    late = [[f"{int(1e9 * t) + 4_000_000_000}", "7", f"{int(1e9 * t)}"] for t in one.stamps]
    return _ros(one, folder / "rostopic.csv", names, late)


def _as_bag(one: Localiser, folder: Path) -> Path:
    names = "Time,header.seq,header.stamp.secs,header.stamp.nsecs,header.frame_id,child_frame_id"
    late = [[f"{t + 4.0:.6f}", "7", f"{int(t)}", f"{int(1e9 * (t % 1.0))}"] for t in one.stamps]
    return _ros(one, folder / "bag.csv", names, late)


@pytest.mark.parametrize(
    ("write", "axes"),
    [
        (_as_openvins, (False, True)),  # q = dq * q_GtoI: the error is in the axes of the body
        (_as_rostopic, (False, False)),
        (_as_bag, (False, False)),
    ],
)
@pytest.mark.parametrize("size", [0.5, 1.0, 2.0])
def test_poses_and_covariances_are_read_by_the_names_that_a_system_gives_them(
    tmp_path, write, axes, size
):
    one = Localiser(size, axes)
    path = write(one, tmp_path)
    metrics = judge_files(path, path, one.truth(tmp_path)).metrics
    assert metrics["matched_poses"] == len(one.rows)
    assert metrics["sigma_factor"] == pytest.approx(size, rel=0.05)  # 1800 squares: 1.7 %
    assert metrics["verdict"] == {0.5: TOO_CAREFUL, 1.0: IN_BAND, 2.0: TOO_SURE}[size]
    assert "doubt" not in metrics
    aligned = align(one.positions, one.true)
    assert aligned is not None
    away = np.linalg.norm(aligned.apply(one.positions) - one.true, axis=1)
    assert metrics["ate_m"] == pytest.approx(np.sqrt(np.mean(away**2)), rel=1e-6)


def test_few_independent_samples_raise_no_doubt_about_the_axes(tmp_path):
    """Claims too sure by two, in world axes: in these of thirty walks body axes would fit much better by chance."""
    judged = []
    for seed in (6, 7, 21, 22):
        found, claims, truth = Walk(seed, 2.0).write(tmp_path)
        np.savetxt(truth, np.loadtxt(truth)[:, :4], fmt="%.17g")
        judged.append(judge_files(found, claims, truth).metrics)
    assert all(one["verdict"] == TOO_SURE for one in judged)
    assert not any("doubt" in one for one in judged)


def test_lines_at_which_a_system_was_lost_are_counted_and_have_no_pose(tmp_path):
    one = Localiser()
    lost = np.arange(40, 65)
    there = np.delete(np.arange(len(one.rows)), lost)
    true, table = one.truth(tmp_path), one.table(tmp_path, one.own)
    one.positions[lost[:10]] = np.nan
    one.positions[lost[10:], 2] = np.inf
    marked = judge_files(one.tum(tmp_path), table, true).metrics
    assert marked.pop("left_out") == "25 are not finite"
    assert marked.pop("poses") == len(one.rows)
    one.stamps, one.positions, one.found = one.stamps[there], one.positions[there], one.found[there]
    removed = judge_files(one.tum(tmp_path), one.table(tmp_path, one.own), true).metrics
    assert removed.pop("poses") == len(there)
    assert marked == removed


def test_a_lost_line_without_a_stamp_keeps_the_others_at_their_numbers(tmp_path):
    one = Localiser()
    matrices = np.tile(np.eye(4), (len(one.rows), 1, 1))
    matrices[:, :3, :3] = Rotation.from_quat(one.rows[:, 3:]).as_matrix()
    matrices[:, :3, 3] = one.rows[:, :3]
    lines = matrices[:, :3].reshape(-1, 12)
    np.savetxt(tmp_path / "all.txt", lines)
    lines[[0, 7, 8]] = np.nan
    np.savetxt(tmp_path / "lost.txt", lines)
    metrics = judge_files(tmp_path / "lost.txt", None, tmp_path / "all.txt").metrics
    assert metrics["matched_poses"] == len(one.rows) - 3
    assert metrics["ate_m"] < 1e-12


@pytest.mark.parametrize("text", ["nan 0 0 0 0 0 0 1\n", "0 nan 0 0 0 0 0 1\n"])
def test_a_line_without_a_stamp_or_a_file_without_a_pose_is_refused(tmp_path, text):
    (tmp_path / "bad.txt").write_text(text)
    with pytest.raises(InputError, match=r"line 1: .* is not a pose|none of its 1 lines is finite"):
        read_trajectory(tmp_path / "bad.txt")


@pytest.mark.parametrize(
    ("header", "before", "after"),
    [
        ("#timestamp x y z qx qy qz qw id", [], [1.0]),  # RTAB-Map
        (",timestamp,x,y,z,qx,qy,qz,qw", [3.0], []),  # pandas
        ("timestamp,p_x,p_y,p_z,q_x,q_y,q_z,q_w,v_x,v_y,v_z", [], [0.1, 0.2, 0.3]),
    ],
)
def test_columns_beside_those_of_the_pose_are_left_alone(tmp_path, header, before, after):
    one = Localiser()
    sep = "," if "," in header else " "
    rows = [[*before, t, *row, *after] for t, row in zip(one.stamps, one.rows, strict=True)]
    path = tmp_path / "more.txt"
    path.write_text("\n".join([header, *(sep.join(f"{x:.9f}" for x in row) for row in rows)]))
    poses = read_trajectory(path).poses
    np.testing.assert_allclose(poses.stamps, one.stamps, atol=1e-6)
    np.testing.assert_allclose(poses.positions, one.positions, atol=1e-8)


@pytest.mark.parametrize(("rows", "stamped"), [(3, True), (4, False), (4, True)])
def test_matrices_are_poses_with_and_without_stamps(tmp_path, rows, stamped):
    one = Localiser()
    matrices = np.tile(np.eye(4), (len(one.rows), 1, 1))
    matrices[:, :3, :3], matrices[:, :3, 3] = one.found.as_matrix(), one.positions
    table = matrices[:, :rows].reshape(len(matrices), -1)
    if stamped:
        table = np.column_stack([one.stamps, table])
    np.savetxt(tmp_path / "m.txt", table)
    read = read_trajectory(tmp_path / "m.txt")
    assert read.has_stamps == stamped
    if stamped:
        np.testing.assert_allclose(read.poses.stamps, one.stamps)
    np.testing.assert_allclose(read.poses.positions, one.positions)
    assert (Rotation.from_quat(read.poses.quats_xyzw) * one.found.inv()).magnitude().max() < 1e-6


def test_an_empty_cell_does_not_move_the_numbers_after_it(tmp_path):
    (tmp_path / "gap.csv").write_text("0,,1,2,3,0,0,0,1\n" * 6)
    with pytest.raises(InputError, match="line 1"):
        read_trajectory(tmp_path / "gap.csv")


@pytest.mark.parametrize(
    ("order", "axes", "flags"),
    [
        ([3, 4, 5, 0, 1, 2], (False, False), "--rotation-first"),
        ([0, 1, 2, 3, 4, 5], (True, True), "--body-axes"),
        ([3, 4, 5, 0, 1, 2], (True, True), "--rotation-first) and be in .* (--body-axes"),
    ],
)
def test_another_order_or_other_axes_of_covariances_are_doubted_until_they_are_told(
    tmp_path, order, axes, flags
):
    one = Localiser(1.0, axes)
    files = one.tum(tmp_path), one.table(tmp_path, one.own[order][:, order]), one.truth(tmp_path)
    asread = judge_files(*files).metrics
    assert asread["verdict"] == TOO_SURE
    assert all(word in asread["doubt"] for word in flags.split(" and be in .* "))
    told = judge_files(*files, body_axes=axes[0], rotation_first=order[0] == 3).metrics
    assert told["verdict"] == IN_BAND
    assert "doubt" not in told
    for size in (0.4, 0.7, 1.4, 3.0):  # claims that are wrong are not taken for another order
        wrong = Localiser(size, axes).tum(tmp_path), *files[1:]
        told = judge_files(*wrong, body_axes=axes[0], rotation_first=order[0] == 3).metrics
        assert "doubt" not in told


def test_a_drift_of_the_rotations_is_not_taken_for_a_rotated_body(tmp_path):
    """Both trajectories are of one body; its true tilts are hardly larger than the drift."""
    assert judge_files(*Walk(0, n=100).write(tmp_path)).metrics["matched_poses"] == 101


def test_covariances_that_are_zero_are_left_out_and_counted(tmp_path):
    one = Localiser()
    table = np.tile(one.own.ravel(), (len(one.rows), 1))
    table[100:140] = 0.0
    np.savetxt(tmp_path / "c.csv", table, delimiter=",")
    files = one.tum(tmp_path), tmp_path / "c.csv", one.truth(tmp_path)
    metrics = judge_files(*files).metrics
    assert metrics["verdict"] == IN_BAND
    assert metrics["poses_judged"] == len(one.rows) - 40
    assert "40 covariances are zero" in metrics["left_out"]
    np.savetxt(tmp_path / "c.csv", 0.0 * table, delimiter=",")
    with pytest.raises(InputError, match="every covariance is zero"):
        judge_files(*files)


def test_covariances_of_wheels_without_variance_of_height_and_tilt_are_planar(tmp_path):
    rng, n = np.random.default_rng(0), 400
    s = np.linspace(0.0, 12.0, n)
    true = np.column_stack([np.sin(s), np.cos(0.7 * s), s])
    found = true + rng.normal(size=(n, 3)) * [0.02, 0.01, 0.03]
    for name, poses in (("t", true), ("f", found)):
        quats = Rotation.from_euler("z", poses[:, 2:]).as_quat()
        table = np.column_stack([0.1 * np.arange(n), poses[:, :2], np.zeros(n), quats])
        np.savetxt(tmp_path / f"{name}.txt", table)
    own = np.diag(np.square([0.02, 0.01, 0.0, 0.0, 0.0, 0.03])).ravel()
    np.savetxt(tmp_path / "c.csv", np.tile(own, (n, 1)), delimiter=",")
    metrics = judge_files(tmp_path / "f.txt", tmp_path / "c.csv", tmp_path / "t.txt").metrics
    assert list(metrics["by_component"]) == ["x", "y", "yaw"]
    assert metrics["verdict"] == IN_BAND


def test_a_scale_that_one_camera_cannot_measure_is_named(tmp_path):
    one = Localiser()
    one.positions = 0.3 * one.positions
    words = judge_files(one.tum(tmp_path), None, one.truth(tmp_path)).metrics["doubt"]
    factor = float(words.split("positions times ")[1].split(" ")[0])
    assert factor == pytest.approx(1.0 / 0.3, rel=0.01)


def test_axes_of_the_other_hand_are_doubted(tmp_path):
    one = Localiser()
    found = one.tum(tmp_path)
    one.true = one.true * [1.0, -1.0, 1.0]
    assert "left-handed axes" in judge_files(found, None, one.truth(tmp_path)).metrics["doubt"]


@pytest.mark.parametrize(
    ("size", "words"),
    [(2.0, "too sure by a factor of 2.0 in sigma"), (0.5, "too careful by a factor of 2.0 in sigma")],
)  # fmt: skip
def test_the_headline_says_that_its_factor_is_one_of_sigmas(tmp_path, size, words):
    """The mean NEES is 24 or 1.5 of 6."""
    one = Localiser(size)
    files = one.tum(tmp_path), one.table(tmp_path, one.own), one.truth(tmp_path)
    metrics = judge_files(*files).metrics
    assert headline(metrics) == (words, False)
    assert any(words in line for line in lines(metrics))


def test_a_table_of_variances_without_names_is_refused_with_the_way_to_name_them(tmp_path):
    one = Localiser()
    cov = one.table(tmp_path, np.diag(one.own))
    with pytest.raises(
        InputError, match=r"6 numbers were read as the upper triangle .* name the columns"
    ):
        read_claims(cov, read_trajectory(one.tum(tmp_path)))


# --- formulas ---


@pytest.mark.parametrize(("error", "sigma"), [(0.0, 1.0), (0.7, 0.3), (-2.0, 0.5), (1.0, 4.0)])
def test_crps_is_the_integral_that_defines_it(error, sigma):
    def gap(x: float) -> float:
        return (stats.norm.cdf(x, 0.0, sigma) - (x >= error)) ** 2

    low, high = -12 * sigma - abs(error), 12 * sigma + abs(error)
    exact = integrate.quad(gap, low, error)[0] + integrate.quad(gap, error, high)[0]
    assert crps(np.array([error]), np.array([sigma]))[0] == pytest.approx(exact, rel=1e-6)
    assert crps(np.array([error]), np.array([0.0]))[0] == abs(error)


def test_a_conformal_radius_holds_a_new_score_as_often_as_promised():
    rng = np.random.default_rng(0)
    # heavy tails, so that the Gaussian region would fail; expected coverage: ceil(0.9 * 101) / 101
    inside = [
        rng.standard_cauchy() <= conformal_radius(rng.standard_cauchy(100)) for _ in range(4000)
    ]
    assert np.mean(inside) == pytest.approx(91 / 101, abs=3.5 * math.sqrt(0.09 / 4000))
    assert conformal_radius(np.arange(8.0)) == math.inf


def test_the_scatter_of_a_coverage_is_that_of_fit_and_test_together():
    rng = np.random.default_rng(3)
    covered = [
        np.mean(rng.standard_normal(80) <= conformal_radius(rng.standard_normal(200)))
        for _ in range(3000)
    ]
    assert np.std(covered) == pytest.approx(coverage_sigma(200, 80), rel=0.05)


def _bursts(rng: np.random.Generator, count: int, lasts: float) -> np.ndarray:
    """Indicators of failures, one tenth of all, in bursts of a mean length: a Markov chain."""
    failing, ends = np.zeros(count, np.bool_), 1.0 / lasts
    for k in range(1, count):
        begins = ends * 0.1 / 0.9
        failing[k] = rng.random() >= ends if failing[k - 1] else rng.random() < begins
    return failing


@pytest.mark.parametrize("lasts", [1.0 / 0.9, 8.0])
def test_failures_in_bursts_count_as_fewer_as_their_share_scatters_more(lasts):
    """The variance of the share of failures is that of independent ones times the correlation time."""
    rng = np.random.default_rng(5)
    series = [_bursts(rng, 1000, lasts) for _ in range(300)]
    scatter = np.var([one.mean() for one in series]) / (0.1 * 0.9 / 1000)
    assert correlation_time(series) == pytest.approx(scatter, rel=0.2)


def test_what_is_fitted_on_the_first_half_mends_the_second():
    found = by_halves(3.0 * np.random.default_rng(1).normal(size=(4000, 6)))
    assert found["inflation"] == pytest.approx(3.0, rel=0.03)
    assert found["coverage_claimed"] < 0.3
    for name in ("coverage_inflated", "coverage_conformal"):
        assert found[name] == pytest.approx(0.9, abs=0.025)
    assert by_halves(np.zeros((30, 6))) == {}


def test_the_verdict_names_direction_and_factor():
    assert verdict(54.0, 5.0, 7.0, 6) == (TOO_SURE, pytest.approx(3.0))
    assert verdict(1.5, 5.0, 7.0, 6) == (TOO_CAREFUL, pytest.approx(2.0))
    assert verdict(6.0, 5.0, 7.0, 6) == (IN_BAND, pytest.approx(1.0))


def test_the_scale_of_a_mirrored_estimate_respects_the_sign_of_the_mirror():
    rng = np.random.default_rng(4)
    reference = rng.normal(size=(200, 3)) * [3.0, 2.0, 1.0]
    estimate = reference * [1.0, 1.0, -1.0]  # no rotation undoes a mirror
    found = align(estimate, reference, with_scale=True)
    rotated = estimate - estimate.mean(axis=0)
    aligned = rotated @ found.rotation.T
    wanted = reference - reference.mean(axis=0)
    best = np.sum(aligned * wanted) / np.sum(rotated**2)  # least squares for this rotation
    assert np.linalg.det(found.rotation) == pytest.approx(1.0)
    assert found.scale == pytest.approx(best, rel=1e-12)
    assert found.scale < 0.95
