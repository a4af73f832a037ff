"""Figures against ground truth: closed forms, known transforms, the evo package, samples of known covariance."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from scipy.spatial.transform import Rotation

from perception.filtering.consistency import band
from perception.primitives.errors import InputError
from perception.primitives.gaussian import Gaussian
from perception.primitives.plane import Plane
from surefoot.evaluation.evaluate import evaluate
from surefoot.evaluation.metrics.averages import rms
from surefoot.evaluation.metrics.consistency import (
    calibration_error,
    consistency_metrics,
    effective_samples,
    squared,
    whitened,
)
from surefoot.evaluation.metrics.contacts import (
    contact_intervals,
    contact_metrics,
    goal_metrics,
    walk_metrics,
)
from surefoot.evaluation.metrics.maps import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    GridMap,
    map_metrics,
    read_map,
    wrong_cells,
)
from surefoot.evaluation.metrics.ospa import ospa
from surefoot.evaluation.metrics.trajectory import (
    align,
    associate,
    distances,
    pairs_apart,
    pick,
    relative_errors,
    trajectory_metrics,
)
from surefoot.evaluation.targets import TARGETS, closing_table, verdicts
from surefoot.report.cards import verdict
from surefoot.results.run_folder import COVARIANCE_HEADER, RunFolder, estimate_row
from surefoot.results.tables import Table, Trajectory, read_tum

seeds = st.integers(0, 2**32 - 1)
FLOOR_HEADER = ("stamp_s", "camera", "nx", "ny", "nz", "height_m")
UPPER = ("P00", "P01", "P02", "P11", "P12", "P22")


def walk(n: int = 60, seed: int = 0) -> Trajectory:
    """A curved trajectory in space, a pose every 0.5 s."""
    rng = np.random.default_rng(seed)
    positions = np.cumsum(rng.normal(size=(n, 3)), axis=0)
    return Trajectory(0.5 * np.arange(n), positions, Rotation.random(n, rng).as_quat())


# --- trajectories ---


@pytest.mark.parametrize(
    ("truth", "estimate", "figures"),
    [
        # figures of evo 1.38.1: ATE as it stands, aligned, aligned with scale; scale; RPE over 30 frames
        (
            "freiburg1_xyz-groundtruth.txt",
            "freiburg1_xyz-rgbdslam.txt",
            (785, 0.020079418378, 0.013470088850, 0.013389384904, 1.008001389931, 0.021700579116, 0.936586149),
        ),
        (
            "freiburg1_xyz-groundtruth.txt",
            "freiburg1_xyz-rgbdslam_drift.txt",
            (785, 0.134185420489, 0.013470118951, 0.013389416165, 1.008001341326, 0.021700632771, 0.936589171),
        ),
        (
            "fr2_desk_groundtruth.txt.gz",
            "fr2_desk_ORB.txt",
            (2174, 3.173993541902, 0.008118977562, 0.006123163030, 0.996969830803, 0.007701977182, 0.489091682),
        ),
    ],
)  # fmt: skip
def test_errors_of_real_trajectories_are_those_of_the_evo_package(
    recordings, truth, estimate, figures
):
    reference = read_tum(recordings / "tum_trajectories" / truth)
    estimated = read_tum(recordings / "tum_trajectories" / estimate)
    count, ate, aligned, scaled, scale, rpe_m, rpe_deg = figures
    found = trajectory_metrics(estimated, reference)
    mine, theirs = associate(estimated.stamps, reference.stamps)
    pairs = (np.arange(len(mine) - 30), np.arange(30, len(mine)))
    lengths, angles = relative_errors(pick(estimated, mine), pick(reference, theirs), pairs)
    assert found["matched_poses"] == count
    names = ("position_rmse_3d_m", "ate_m", "ate_scaled_m", "scale")
    np.testing.assert_allclose(
        [found[name] for name in names], (ate, aligned, scaled, scale), rtol=1e-9
    )
    np.testing.assert_allclose((rms(lengths), np.degrees(rms(angles))), (rpe_m, rpe_deg), rtol=1e-8)


@pytest.mark.parametrize(
    ("truth", "estimate", "figures"),
    [
        # evo 1.38.1, aligned: mean, median, std, min, max in m, sse in m^2, rotation in deg (rms)
        (
            "freiburg1_xyz-groundtruth.txt",
            "freiburg1_xyz-rgbdslam.txt",
            (0.012024498709, 0.011183186775, 0.006070809206, 0.000955046181, 0.034759545895, 0.142432985491, 2.057699602015),
        ),
        (
            "fr2_desk_groundtruth.txt.gz",
            "fr2_desk_ORB.txt",
            (0.007491776870, 0.007414629829, 0.003129069507, 0.000349636198, 0.024299593694, 0.143305289924, 0.989035658368),
        ),
    ],
)  # fmt: skip
def test_all_statistics_of_the_evo_package_are_reproduced(recordings, truth, estimate, figures):
    reference = read_tum(recordings / "tum_trajectories" / truth)
    found = trajectory_metrics(read_tum(recordings / "tum_trajectories" / estimate), reference)
    names = ("mean_m", "median_m", "std_m", "min_m", "max_m", "sse_m2", "deg")
    np.testing.assert_allclose(
        [found[f"ate_{name}"] for name in names], figures, rtol=1e-6, atol=1e-9
    )


def test_a_known_offset_appears_as_the_error():
    truth = walk()
    turned = Rotation.from_euler("z", [math.radians(3.0)]) * Rotation.from_quat(truth.quats_xyzw)
    moved = Trajectory(
        truth.stamps, truth.positions + np.array([0.03, -0.04, 0.12]), turned.as_quat()
    )
    upright = Trajectory(truth.stamps, truth.positions, np.tile([0.0, 0.0, 0.0, 1.0], (60, 1)))
    found = trajectory_metrics(moved, truth)
    assert found["position_rmse_m"] == pytest.approx(0.05, abs=1e-12)
    assert found["position_rmse_3d_m"] == pytest.approx(0.13, abs=1e-12)
    assert found["ate_m"] == pytest.approx(0.0, abs=1e-12)
    assert found["heading_rmse_deg"] == pytest.approx(3.0, abs=1e-9)
    assert trajectory_metrics(upright, upright)["rpe_1s_m"] == 0.0


@pytest.mark.parametrize("size_m", [(0.02, 0.02, 0.02), (3.0, 0.01, 0.01)])
def test_positions_that_determine_no_rotation_do_not_spoil_its_error(size_m):
    rng = np.random.default_rng(1)
    positions = rng.normal(size=(60, 3)) * size_m
    turns = Rotation.random(60, rng)
    errors = Rotation.from_rotvec(np.radians(0.01) * rng.normal(size=(60, 3)))
    shift = Rotation.from_euler("zx", [40.0, 10.0], degrees=True)
    noise = 0.002 * rng.normal(size=(60, 3))
    stamps = 0.5 * np.arange(60)
    truth = Trajectory(stamps, positions, turns.as_quat())
    found = Trajectory(stamps, shift.apply(positions + noise), (shift * turns * errors).as_quat())
    figures = trajectory_metrics(found, truth)
    true_deg = float(np.degrees(rms(errors.magnitude())))
    assert figures["ate_deg"] == pytest.approx(true_deg, rel=0.05)


@given(seeds, st.floats(0.2, 5.0), st.sampled_from([2, 3]))
def test_alignment_finds_the_transform_that_was_applied(seed, scale, d):
    rng = np.random.default_rng(seed)
    points, shift = rng.normal(size=(12, d)), rng.normal(size=d)
    rotation = Rotation.random(rng=rng).as_matrix() if d == 3 else _turn(rng.uniform(-3, 3))
    found = align(points, scale * points @ rotation.T + shift, with_scale=True)
    assert found is not None
    np.testing.assert_allclose(found.rotation, rotation, atol=1e-9)
    np.testing.assert_allclose(found.translation, shift, atol=1e-9)
    assert found.scale == pytest.approx(scale, rel=1e-9)


def test_alignment_never_reflects():
    rng = np.random.default_rng(3)
    points = rng.normal(size=(20, 3))
    found = align(points, points * (1.0, 1.0, -1.0))
    assert found is not None
    assert np.linalg.det(found.rotation) == pytest.approx(1.0)


@given(seeds)
def test_no_other_rigid_transform_is_better_than_the_alignment(seed):
    rng = np.random.default_rng(seed)
    estimate, reference = rng.normal(size=(2, 9, 3))
    best = align(estimate, reference)
    assert best is not None
    error = rms(distances(best.apply(estimate), reference))
    for _ in range(5):
        nudge = Rotation.from_rotvec(0.05 * rng.normal(size=3)).as_matrix()
        other = best.apply(estimate) @ nudge.T + 0.05 * rng.normal(size=3)
        assert error <= rms(distances(other, reference)) + 1e-12


def test_a_figure_without_a_determined_alignment_is_absent():
    line = np.outer(np.arange(5.0), [1.0, 2.0, 3.0])
    assert align(line, line) is None  # free to spin about the line
    assert align(line[:, :2], line[:, :2]) is not None
    assert align(np.ones((5, 2)), np.ones((5, 2))) is None
    still = Trajectory(np.arange(3.0), np.zeros((3, 3)), np.tile([0.0, 0, 0, 1], (3, 1)))
    found = trajectory_metrics(still, still)
    assert "ate_m" not in found
    assert found["position_rmse_3d_m"] == 0.0
    later = Trajectory(still.stamps + 100.0, still.positions, still.quats_xyzw)
    assert trajectory_metrics(still, later) == {}


@given(st.lists(st.floats(0, 10), max_size=12), st.lists(st.floats(0, 10), max_size=12))
def test_association_agrees_with_brute_force(first, second):
    a, b = np.unique(np.array(first)), np.unique(np.array(second))
    i, j = associate(a, b, 0.5)
    short, long = (a, b) if len(a) <= len(b) else (b, a)
    expected = sorted(
        (float(s), float(np.min(np.abs(long - s))))
        for s in short
        if len(long) and np.min(np.abs(long - s)) <= 0.5
    )
    ours = zip(
        (a[i] if len(a) <= len(b) else b[j]).tolist(), np.abs(a[i] - b[j]).tolist(), strict=True
    )
    assert list(ours) == expected


def test_pairs_are_the_first_index_at_least_a_second_later():
    first, second = pairs_apart(np.array([0.0, 0.4, 1.0, 1.5, 2.6]), 1.0)
    assert list(zip(first, second, strict=True)) == [(0, 2), (1, 3), (2, 4), (3, 4)]


# --- consistency ---


@given(seeds)
@settings(max_examples=20)
def test_samples_drawn_from_their_covariance_are_consistent(seed):
    rng = np.random.default_rng(seed)
    roots = rng.normal(size=(2000, 3, 3))
    covariances = roots @ roots.transpose(0, 2, 1) + 0.1 * np.eye(3)
    errors = np.einsum("nij,nj->ni", np.linalg.cholesky(covariances), rng.normal(size=(2000, 3)))
    figures = consistency_metrics(whitened(errors, covariances), "p")
    # 95 % +- 4.5 deviations of a binomial share of 2000; mean 3 +- 4.5 deviations sqrt(6 / 2000)
    assert abs(figures["p_nees_inside_share"] - 0.95) < 4.5 * math.sqrt(0.95 * 0.05 / 2000)
    assert abs(figures["p_anees"] - 3.0) < 4.5 * math.sqrt(6 / 2000)


def autocorrelated(rng, shape, rho: float):
    """Standard normal numbers with exponential autocorrelation."""
    noise = rng.normal(size=shape)
    error = noise.copy()
    for i in range(1, len(error)):
        error[i] = rho * error[i - 1] + math.sqrt(1 - rho**2) * noise[i]
    return error


def consistent(rng, frames: int, rho: float, constant: tuple[float, float, float]):
    """Errors of a consistent estimate; these shares of the variances are constant within the run."""
    share = np.array(constant)
    varying = autocorrelated(rng, (frames, 3), rho)
    return np.sqrt(share) * rng.normal(size=3) + np.sqrt(1 - share) * varying


@pytest.mark.parametrize(
    ("rho", "constant", "least"),
    [
        (0.0, (0.0, 0.0, 0.0), 0.92),
        (0.9, (0.0, 0.0, 0.0), 0.92),
        (0.8, (1.0, 1.0, 1.0), 0.92),
        (0.9, (0.3, 0.3, 0.3), 0.85),
        # a constant joint offset dominates the heading error: 0.44 if the mean is subtracted first
        (0.8, (0.0, 0.0, 0.8), 0.75),
    ],
)
def test_the_band_of_the_mean_has_nearly_its_nominal_coverage(rho, constant, least):
    """The coverage is below 0.95 because the number of effective samples is estimated from the same errors."""
    rng = np.random.default_rng(0)
    runs = [consistent(rng, 300, rho, constant) for _ in range(300)]
    held = np.mean([consistency_metrics(run, "p")["p_consistent"] for run in runs])
    assert least <= held <= 0.985


@pytest.mark.parametrize("constant", [0.0, 0.8])
def test_standard_deviations_half_as_large_as_the_errors_are_detected(constant):
    rng = np.random.default_rng(3)
    runs = [2.0 * consistent(rng, 300, 0.8, (0.0, 0.0, constant)) for _ in range(100)]
    found = [consistency_metrics(run, "p") for run in runs]
    caught = [not f["p_consistent"] and f["p_anees"] > f["p_anees_high"] for f in found]
    assert np.mean(caught) >= 0.95


@pytest.mark.parametrize("factor", [0.25, 4.0])
def test_a_covariance_too_small_or_too_large_is_detected(factor):
    rng = np.random.default_rng(1)
    errors = rng.normal(size=(300, 3))
    figures = consistency_metrics(whitened(errors, np.tile(factor * np.eye(3), (300, 1, 1))), "p")
    assert not figures["p_consistent"]
    assert (figures["p_anees"] > 3) == (factor < 1)


def test_the_band_is_a_chi_square_interval():
    for dof, samples in ((3, 1.0), (4, 50.0), (1, 7.0)):
        low, high = stats.chi2.ppf([0.025, 0.975], dof * samples) / samples
        assert band(dof, samples) == pytest.approx((low, high), rel=1e-9)


def test_nees_is_the_squared_mahalanobis_distance_and_infinite_without_a_covariance():
    P = np.array([[4.0, 1.0, 0.0], [1.0, 9.0, 0.0], [0.0, 0.0, 0.01]])
    e = np.array([1.0, -2.0, 0.05])
    claims = np.stack([P, np.zeros((3, 3)), np.diag([1.0, np.nan, 1.0])])
    found = squared(whitened(np.stack([e, e, e]), claims))
    assert found[0] == pytest.approx(e @ np.linalg.inv(P) @ e)
    assert np.isinf(found[1:]).all()
    figures = consistency_metrics(whitened(np.stack([e, e, e]), claims), "p")
    assert figures["p_no_covariance_share"] == pytest.approx(2 / 3)
    assert not figures["p_consistent"]


def test_correlated_errors_have_fewer_effective_samples():
    rng = np.random.default_rng(4)
    assert effective_samples(rng.normal(size=(4000, 1))) > 3000
    slow = autocorrelated(rng, (4000, 2), 0.9)
    # the squares of errors with autocorrelation 0.9 have 0.81: n (1 - 0.81) / (1 + 0.81) = 420 in closed form
    assert 300 < effective_samples(slow) < 550
    assert effective_samples(np.ones((10, 3))) == pytest.approx(1.0)
    one_constant = np.column_stack([slow, np.full(4000, 0.3)])
    # one of three components is constant, and dominates the variance of the mean
    assert effective_samples(one_constant) == pytest.approx(3.0, rel=0.05)
    assert effective_samples(np.zeros((10, 2))) == 10


# --- maps ---


def grid(rows: list[str], origin: tuple[float, float] = (0.0, 0.0), cell_m: float = 0.1) -> GridMap:
    """First row on top, as one sees it: # occupied, . free, blank unknown."""
    codes = {"#": OCCUPIED, ".": FREE, " ": UNKNOWN}
    return GridMap(
        np.array([[codes[c] for c in row] for row in rows[::-1]]), np.array(origin), cell_m
    )


def test_a_wall_shifted_by_one_cell_is_wrong_strictly_and_correct_leniently():
    truth = grid(["......"] * 3 + ["######"] + ["......"] * 3)
    mine = grid(["......"] * 2 + ["######"] + ["......"] * 2 + ["      "] * 2)
    figures = map_metrics(mine, truth)
    assert figures["grid_cells"] == 30
    assert figures["grid_correct_share"] == pytest.approx(18 / 30)
    assert figures["grid_correct_share_one_cell"] == 1.0
    assert figures["grid_occupied_correct_share"] == 0.0
    assert figures["grid_occupied_found_share"] == 1.0
    assert set(np.unique(wrong_cells(mine, truth))) == {0, 1}


def test_a_false_obstacle_in_free_space_is_wrong_by_both_figures():
    truth = grid(["....."] * 5)
    mine = grid(["....."] * 2 + ["..#.."] + ["....."] * 2)
    figures = map_metrics(mine, truth)
    assert (
        figures["grid_correct_share"]
        == figures["grid_correct_share_one_cell"]
        == pytest.approx(24 / 25)
    )
    assert wrong_cells(mine, truth)[2, 2] == 2


def test_only_cells_known_to_both_are_judged():
    assert map_metrics(grid([" . "]), grid(["# #"])) == {}
    assert map_metrics(grid(["..."]), grid(["..."], origin=(5.0, 5.0))) == {}


@given(st.integers(-4, 4), st.integers(-4, 4), seeds)
def test_maps_of_the_same_place_agree_whatever_their_origins(columns, rows, seed):
    state = np.random.default_rng(seed).integers(-1, 2, size=(8, 8))
    whole = GridMap(state, np.array([-0.15, 0.35]), 0.05)
    part = GridMap(state[2:6, 2:6].copy(), whole.origin + 0.1, 0.05)
    moved = GridMap(whole.state, whole.origin + np.array([columns, rows]) * 0.05, 0.05)
    figures = map_metrics(part, whole)
    assert figures == {} or figures["grid_correct_share"] == 1.0
    centres = moved.centres() - np.array([columns, rows]) * 0.05
    np.testing.assert_array_equal(whole.at(centres), state)


@given(st.floats(-0.6, 1.4), st.floats(-0.6, 1.4))
def test_a_point_has_the_state_of_the_cell_that_contains_it(x, y):
    state = np.random.default_rng(0).integers(-1, 2, size=(4, 7))
    held = GridMap(state, np.array([-0.5, 0.2]), 0.25)
    column, row = math.floor((x + 0.5) / 0.25), math.floor((y - 0.2) / 0.25)
    on_an_edge = (
        min(abs((v + s) / 0.25 - round((v + s) / 0.25)) for v, s in ((x, 0.5), (y, -0.2))) < 1e-5
    )
    inside = 0 <= row < 4 and 0 <= column < 7
    expected = int(state[row, column]) if inside else UNKNOWN
    assert on_an_edge or int(held.at(np.array([[x, y]]))[0]) == expected


def test_a_saved_map_is_read_with_its_lowest_row_first(tmp_path):
    (tmp_path / "map.pgm").write_bytes(b"P5\n2 2\n255\n" + bytes([0, 254, 205, 254]))
    (tmp_path / "map.yaml").write_text(
        "image: map.pgm\nresolution: 0.05\norigin: [-1.0, 2.0, 0.0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    found = read_map(tmp_path / "map.yaml")
    assert found.state.tolist() == [[UNKNOWN, FREE], [OCCUPIED, FREE]]
    assert found.extent == pytest.approx((-1.0, -0.9, 2.0, 2.1))


# --- contacts and goals ---


def test_a_contact_ends_with_a_gap_or_a_change_of_object():
    stamps = np.arange(8.0)
    gaps = np.array([0.1, 0.0, -0.01, 0.2, -0.1, -0.1, 0.3, 0.4])
    objects = ["a", "a", "a", "a", "a", "b", "b", "b"]
    assert contact_intervals(stamps, gaps, objects) == [
        (1.0, 2.0, "a"),
        (4.0, 4.0, "a"),
        (5.0, 5.0, "b"),
    ]


@pytest.mark.parametrize("period_s", [0.01, 0.3, 0.45])
def test_the_time_of_short_contacts_does_not_depend_on_the_samples(period_s):
    """Thirty contacts of 0.5 s in five minutes."""
    stamps = np.arange(0.0, 300.0, period_s)
    gaps = np.where(stamps % 10.1 < 0.5, -0.01, 0.1)
    columns = {
        "stamp_s": [str(stamp) for stamp in stamps],
        "clearance_m": [str(gap) for gap in gaps],
        "object": ["post"] * len(stamps),
    }
    figures = contact_metrics(Table("a test", columns))
    assert figures["contacts"] == 30.0
    assert figures["contact_seconds"] == pytest.approx(15.0, rel=0.1)


def test_goals_count_only_in_their_order():
    path = np.column_stack([np.linspace(0, 4, 81), np.zeros(81)])
    assert goal_metrics(path, [(2.0, 0.1), (4.0, 0.0)])["goals_passed"] == 2
    assert goal_metrics(path, [(4.0, 0.0), (2.0, 0.0)])["goals_passed"] == 1
    assert goal_metrics(path, [(2.0, 1.0), (4.0, 0.0)])["goal_nearest_m"] == pytest.approx(1.0)
    assert goal_metrics(path, [(2.0, 1.0), (4.0, 3.0)])["goal_final_m"] == pytest.approx(3.0)
    assert goal_metrics(path, []) == {}


def test_the_path_length_is_the_sum_of_its_steps():
    angle = np.linspace(0, math.pi, 1001)
    found = walk_metrics(angle, np.column_stack([np.cos(angle), np.sin(angle)]))
    assert found["path_m"] == pytest.approx(math.pi, rel=1e-5)
    assert found["straight_m"] == pytest.approx(2.0)
    assert found["duration_s"] == pytest.approx(math.pi)


# --- whole runs ---


def straight_run(folder: Path, offset: tuple[float, float, float]) -> RunFolder:
    """A straight walk of ten metres, estimated with a constant error."""
    run = RunFolder.create(folder)
    stamps = np.arange(0.0, 10.5, 0.5)
    run.write_trajectory(
        "truth/trajectory.txt", [(float(t), float(t), 0.0, 0.0, math.pi) for t in stamps]
    )
    dx, dy, dyaw = offset
    pose = [
        Gaussian(np.array([t + dx, dy, -math.pi + dyaw]), np.diag([0.01, 0.04, 0.09]))
        for t in stamps
    ]
    rows = [estimate_row(t, p) for t, p in zip(stamps.tolist(), pose, strict=True)]
    run.write_csv("trajectory_covariance.csv", COVARIANCE_HEADER, rows)
    run.write_planar_trajectory()
    return run


def test_the_figures_of_a_run_with_known_errors_are_those_errors(tmp_path):
    run = straight_run(tmp_path, (0.03, 0.04, 0.01))  # heading just across the seam at pi
    found = evaluate(run)
    assert found["position_rmse_m"] == pytest.approx(0.05)
    assert found["heading_rmse_deg"] == pytest.approx(math.degrees(0.01))
    assert found["pose_anees"] == pytest.approx(0.0009 / 0.01 + 0.0016 / 0.04 + 0.0001 / 0.09)
    assert found["path_m"] == pytest.approx(10.0)
    assert run.read_json("metrics.json") == found


@pytest.mark.parametrize(
    ("summary", "falls"),
    [
        ({"body": "dynamic", "fell_at_s": 12.5}, 1.0),
        ({"body": "dynamic", "fell_at_s": None}, 0.0),
        ({"body": "kinematic", "fell_at_s": None}, None),
        ({"body": None, "fell_at_s": None}, None),
    ],
)
def test_falls_are_reported_only_for_a_dynamic_body(tmp_path, summary, falls):
    run = straight_run(tmp_path, (0.0, 0.0, 0.0))
    run.write_json("summary.json", summary)
    found = evaluate(run)
    assert found.get("falls") == falls
    shown = [line for line in closing_table(found).splitlines() if line.startswith("falls")]
    assert ["MISSED" in line for line in shown] == ([] if falls is None else [falls > 0.0])


def test_figures_without_truth_are_absent(tmp_path):
    run = RunFolder.create(tmp_path)
    rows = [estimate_row(t, Gaussian(np.full(3, t), np.eye(3))) for t in (0.0, 1.0)]
    run.write_csv("trajectory_covariance.csv", COVARIANCE_HEADER, rows)
    run.write_planar_trajectory()
    assert set(evaluate(run)) == {"duration_s", "path_m", "straight_m"}


def test_a_given_truth_is_compared_after_alignment_only(tmp_path):
    run = straight_run(tmp_path / "run", (0.0, 0.0, 0.0))
    other = RunFolder(tmp_path)
    other.write_trajectory("their.txt", [(0.5 * i, 3.0, 0.5 * i, 0.0, 0.0) for i in range(21)])
    found = evaluate(run, tmp_path / "their.txt")
    assert found["ate_floor_m"] == pytest.approx(0.0, abs=1e-9)
    assert not {"position_rmse_m", "heading_rmse_deg", "pose_anees"} & set(found)


def test_a_truth_without_common_stamps_is_refused_with_both_time_ranges(tmp_path):
    run = straight_run(tmp_path / "run", (0.0, 0.0, 0.0))
    RunFolder(tmp_path).write_trajectory(
        "their.txt", [(90.0 + i, 0.0, 0.0, 0.0, 0.0) for i in range(3)]
    )
    with pytest.raises(InputError, match=r"covers 90.000 to 92.000 s, the run 0.000 to 10.000 s"):
        evaluate(run, tmp_path / "their.txt")


def test_a_truth_without_stamps_is_compared_pose_by_pose(tmp_path):
    """The lines of KITTI are no seconds: at two poses a second line 1 is not the pose at 1 s."""
    run = straight_run(tmp_path / "run", (0.0, 0.0, 0.0))
    poses = run.read_trajectory("trajectory.txt")
    bent = poses.positions + np.outer(np.arange(len(poses)) % 2, [0.0, 0.2, 0.0])
    rows = [[1, 0, 0, x, 0, 1, 0, y, 0, 0, 1, z] for x, y, z in bent]
    np.savetxt(tmp_path / "kitti.txt", rows)
    found = evaluate(run, tmp_path / "kitti.txt")
    assert found["matched_poses"] == len(poses)
    assert found["duration_s"] == poses.stamps[-1] - poses.stamps[0]
    assert found["ate_floor_m"] == pytest.approx(0.1, rel=0.02)
    np.savetxt(tmp_path / "kitti.txt", rows[:-1])
    with pytest.raises(InputError, match=r"no stamps and 20 poses, the run 21"):
        evaluate(run, tmp_path / "kitti.txt")


def test_a_truth_whose_y_axis_points_down_gives_the_same_path_and_error_on_the_floor(tmp_path):
    """The poses of KITTI are in the axes of its first camera: x right, y down, z ahead."""
    run = RunFolder.create(tmp_path / "run")
    turned = np.linspace(0.0, math.pi, 201)
    x, y = np.cos(turned), np.sin(turned)
    rows = [
        estimate_row(t, Gaussian(np.array([a, b, t]), np.eye(3)))
        for t, a, b in zip(turned, x, y, strict=True)
    ]
    run.write_csv("trajectory_covariance.csv", COVARIANCE_HEADER, rows)
    run.write_planar_trajectory()
    np.savetxt(
        tmp_path / "kitti.txt",
        [[1, 0, 0, -b, 0, 1, 0, 0, 0, 0, 1, a] for a, b in zip(x, y, strict=True)],
    )
    found = evaluate(run, tmp_path / "kitti.txt")
    assert found["path_m"] == pytest.approx(math.pi, rel=1e-4)
    assert found["straight_m"] == pytest.approx(2.0)
    assert found["ate_floor_m"] == pytest.approx(0.0, abs=1e-6)


def test_a_map_is_compared_with_its_own_truth_after_alignment(tmp_path):
    run = straight_run(tmp_path, (0.0, 0.0, 0.0))
    rows = [(0.5 * i, 3.0, 0.5 * i, 1.0, 0.0) for i in range(21)]  # other axes
    run.write_trajectory("truth/trajectory.txt", rows)
    run.write_json("summary.json", {"kind": "map"})
    found = evaluate(run)
    assert found["ate_floor_m"] == pytest.approx(0.0, abs=1e-9)
    assert not {"position_rmse_m", "pose_anees"} & set(found)


@pytest.mark.parametrize(
    ("name", "content", "figure", "words"),
    [
        ("panorama", {"views": [{"placed": True, "frame": 0}, {"placed": False, "frame": 9}], "obstacles": [], "gaps": []}, "views_placed", "no ground truth"),
        ("monocular", {"frames": 9, "judged": 4, "iou": 0.9, "iou_min": 0.5}, "floor_iou_median", "depth camera judges"),
        ("monocular", {"frames": 9, "judged": 0}, "frames", "no depth image"),
    ],
)  # fmt: skip
def test_a_run_without_trajectory_says_what_cannot_be_judged(
    tmp_path, name, content, figure, words
):
    run = RunFolder.create(tmp_path / "run")
    run.write_json(f"{name}.json", content)
    found = evaluate(RunFolder.open(run.root))
    assert figure in found
    assert words in closing_table(found)
    RunFolder(tmp_path).write_trajectory("their.txt", [(1.0, 0.0, 0.0, 0.0, 0.0)])
    with pytest.raises(InputError, match=f"kind {name} without trajectory.txt"):
        evaluate(run, tmp_path / "their.txt")


@pytest.mark.parametrize("kind", ["simulation", "map", "panorama", "monocular"])
def test_only_a_walk_is_judged_by_its_contacts(tmp_path, kind):
    run = RunFolder.create(tmp_path)
    run.write_json("summary.json", {"kind": kind})
    rows = [(0.0, 0.4, "box"), (1.0, -0.1, "box")]
    run.write_csv("truth/clearance.csv", ("stamp_s", "clearance_m", "object"), rows)
    judged = {one.target.figure for one in verdicts(evaluate(run))}
    assert ("contacts" in judged) == (kind == "simulation")


def test_the_folder_of_a_batch_is_sent_to_the_verb_for_many(tmp_path):
    RunFolder(tmp_path).write_csv("summary.csv", ("recording", "run"), [("x", "old/a"), ("y", "")])
    with pytest.raises(InputError, match="`surefoot batch evaluate"):
        evaluate(RunFolder.open(tmp_path))


def test_the_closing_table_shows_the_figures_of_a_surface():
    shown = closing_table({"surface_accuracy_mm": 7.25, "surface_fscore_2cm": 0.5})
    assert "7.2 mm" in shown
    assert "50.0%" in shown


def test_the_floor_figures_are_the_known_tilt_and_shift_of_a_plane(tmp_path):
    run = RunFolder.create(tmp_path)
    true = Plane(np.array([0.0, -0.8, -0.6]), 0.4)
    tilt = math.radians(2.0)
    rows, truth = [], []
    for i in range(4):
        normal = math.cos(tilt) * true.normal + math.sin(tilt) * true.tangents[0]
        covariance = (tilt**2, 0.0, 0.0, tilt**2, 0.0, 0.003**2)
        state = "expected" if i == 3 else "seen"
        rows.append((0.1 * i, "tof", *normal.tolist(), 0.403, *covariance, 0.5, state))
        truth.append((0.1 * i, "tof", *true.normal.tolist(), 0.4))
    run.write_csv("floor.csv", (*FLOOR_HEADER, *UPPER, "share", "state"), rows)
    run.write_csv("truth/floor.csv", FLOOR_HEADER, truth)
    found = evaluate(run)
    assert found["floor_tof_angle_deg_median"] == pytest.approx(2.0)
    assert found["floor_tof_height_mm_max"] == pytest.approx(3.0)
    assert found["floor_tof_height_mm_bias"] == pytest.approx(3.0)
    assert found["floor_tof_seen_share"] == 0.75
    # one deviation of tilt (tan of 2 degrees, to first order) and one of height
    assert found["floor_tof_anees"] == pytest.approx((math.tan(tilt) / tilt) ** 2 + 1.0, rel=1e-3)


def test_innovations_are_checked_for_size_and_whiteness(tmp_path):
    rng = np.random.default_rng(8)
    run = RunFolder.create(tmp_path)
    header = ("stamp_s", "source", "identity", "whitened_0", "whitened_1")
    rows = [(0.1 * i, "landmark", i % 3, *rng.normal(size=2).tolist()) for i in range(900)]
    slow = rng.normal(size=2)
    for i in range(400):  # of the expected size, but autocorrelated
        slow = 0.8 * slow + 0.6 * rng.normal(size=2)
        rows.append((0.1 * i, "track", 7, *slow.tolist()))
    run.write_csv("innovations.csv", header, rows)
    found = evaluate(run)
    assert found["landmark_consistent"]
    assert found["landmark_anis"] == pytest.approx(2.0, abs=4.5 * math.sqrt(4 / 900))
    assert found["landmark_nis_inside_share"] == pytest.approx(0.95, abs=4.5 * 0.0073)
    assert found["landmark_calibration_error"] < 0.05
    assert found["landmark_whiteness_max"] < 2.0
    assert found["track_lag1"] == pytest.approx(0.8, abs=0.1)
    assert found["track_whiteness_max"] > 5.0


def test_standard_deviations_of_half_the_size_show_in_the_calibration():
    rng = np.random.default_rng(4)
    exact, overconfident = rng.chisquare(3, 4000), 4.0 * rng.chisquare(3, 4000)
    assert calibration_error(exact, 3) < 0.02
    assert calibration_error(overconfident, 3) > 0.25


def test_the_ospa_distance_counts_errors_misses_and_false_tracks():
    two = np.array([[0.0, 0.0], [3.0, 0.0]])
    assert ospa(two, two[::-1]) == 0.0
    assert ospa(two + np.array([0.1, 0.0]), two) == pytest.approx(0.1)
    assert ospa(two[:1], two, 0.5) == pytest.approx(0.25)  # half of the objects missed
    assert ospa(two, two[:1], 0.5) == pytest.approx(0.25)
    assert ospa(two[:1], two, 0.5, order=2.0) == pytest.approx(math.sqrt(0.125))
    assert ospa(np.zeros((0, 2)), two, 0.7) == 0.7
    assert ospa(np.zeros((0, 2)), np.zeros((0, 2))) == 0.0
    assert ospa(two + 10.0, two, 0.5) == 0.5


@given(seeds, st.integers(0, 4), st.integers(0, 4), st.integers(0, 4), st.sampled_from([1.0, 2.0]))
def test_the_ospa_distance_is_a_metric(seed, n, m, k, order):
    rng = np.random.default_rng(seed)
    a, b, c = (rng.uniform(-1, 1, (size, 2)) for size in (n, m, k))
    assert ospa(a, b, 0.8, order) == pytest.approx(ospa(b, a, 0.8, order))
    assert ospa(a, c, 0.8, order) <= ospa(a, b, 0.8, order) + ospa(b, c, 0.8, order) + 1e-12


def test_tracks_are_assigned_to_the_nearest_obstacles(tmp_path):
    run = RunFolder.create(tmp_path)
    truth, tracks = [], []
    for i in range(10):
        t = 0.5 * i
        truth += [(t, "cart", 0.05 * t, 0.0, 0.05, 0.0, 0.1), (t, "post", 3.0, 1.0, 0.0, 0.0, 0.1)]
        if i < 8:
            mean = [0.05 * t + 0.03, 0.04, 0.05, 0.02]
            number = 7 if i < 4 else 9
            tracks.append(
                {"stamp": t, "track": number, "mean": mean, "covariance": np.eye(4).tolist()}
            )
        # a track of an object that the truth does not list, and one just beyond the gate of the post
        tracks.append(
            {"stamp": t, "track": 1, "mean": [-2.0, -2, 0, 0], "covariance": np.eye(4).tolist()}
        )
        tracks.append(
            {"stamp": t, "track": 2, "mean": [3.0, 1.51, 0, 0], "covariance": np.eye(4).tolist()}
        )
    names = ("stamp_s", "identity", "x_m", "y_m", "vx_mps", "vy_mps", "radius_m")
    run.write_csv("truth/obstacles.csv", names, truth)
    run.write_json("obstacles.json", {"tracks": tracks, "footprints": []})
    found = evaluate(run)
    assert found["moving_obstacle_count"] == found["static_obstacle_count"] == 1
    assert found["moving_obstacle_tracked_share"] == pytest.approx(0.8)
    assert found["moving_obstacle_position_rmse_m"] == pytest.approx(0.05)
    assert found["moving_obstacle_velocity_rmse_mps"] == pytest.approx(0.02)
    assert found["moving_obstacle_anees"] == pytest.approx(0.05**2 + 0.02**2)
    assert found["moving_obstacle_track_changes"] == 1
    assert found["static_obstacle_tracked_share"] == 0.0
    assert "static_obstacle_position_rmse_m" not in found


def test_a_track_without_detection_keeps_its_obstacle_near_another_one(tmp_path):
    run = RunFolder.create(tmp_path)
    truth, tracks = [], []
    for i in range(6):
        t = 0.5 * i
        truth += [(t, "cart", 0.1 * t, 0.0, 0.1, 0.0, 0.1), (t, "post", 2.0, 0.0, 0.0, 0.0, 0.1)]
        mean = (
            [0.1 * t, 0.0, 0.1, 0.0] if i < 3 else [2.0, 0.0, 0.1, 0.0]
        )  # predicted into the post
        P = np.eye(4).tolist()
        tracks.append({"stamp": t, "track": 1, "mean": mean, "covariance": P, "seen": min(t, 1.0)})
    names = ("stamp_s", "identity", "x_m", "y_m", "vx_mps", "vy_mps", "radius_m")
    run.write_csv("truth/obstacles.csv", names, truth)
    run.write_json("obstacles.json", {"tracks": tracks, "footprints": []})
    found = evaluate(run)
    assert found["moving_obstacle_tracked_share"] == 1.0
    assert found["static_obstacle_tracked_share"] == 0.0


def test_times_are_reported_per_stage_and_in_total_without_the_first_frame(tmp_path):
    run = RunFolder.create(tmp_path)
    rows = [(0.0, 900.0, 9.0), *((0.1 * i, float(i), 1.0) for i in range(1, 102))]
    run.write_csv("timing.csv", ("stamp_s", "floor", "grid"), rows)
    found = evaluate(run)["timing_ms"]
    assert found["floor"] == pytest.approx({"p50": 51.0, "p95": 96.0, "max": 101.0})
    assert found["total"]["p50"] == pytest.approx(52.0)


@pytest.mark.parametrize(
    ("anees", "words"),
    [
        (16.0, "MISSED, too sure: errors 2.00 times the claimed ones"),
        (1.0, "MISSED, too careful: errors 0.50 times the claimed ones"),
    ],
)
def test_a_missed_consistency_names_its_direction_and_factor(anees, words):
    figures = {"anees": anees, "anees_low": 3.3, "anees_high": 4.7, "consistent": False}
    metrics = {f"moving_obstacle_{name}": value for name, value in figures.items()}
    assert words in closing_table(metrics)
    assert words.removeprefix("MISSED, ") in verdict(metrics)[1]


def test_one_covariance_that_is_not_positive_definite_is_named_and_no_direction():
    whitened = np.random.default_rng(0).standard_normal((200, 3))
    whitened[7] = np.inf
    found = consistency_metrics(whitened, "pose")
    assert found["pose_anees_low"] < found["pose_anees"] < found["pose_anees_high"]
    assert "MISSED, 0.50% of the covariances are not positive definite" in closing_table(found)


def test_verdicts_count_moving_obstacles_and_footprints():
    metrics = {
        "position_rmse_m": 0.02,
        "moving_obstacle_tracked_share": 0.4,
        "ospa_m": 0.3,
        "poses_in_footprints": 3.0,
    }
    kind, text = verdict(metrics)
    assert kind == "bad"
    assert text.startswith("1 of 4 targets met; missed: ")
    assert "share of instants tracked (0.4, at least 0.8)" in text
    assert "OSPA (cut-off 0.5 m) (0.3 m, at most 0.25 m)" in text
    assert "inside footprints of obstacles (3, should be 0)" in text


def test_the_closing_table_lists_met_and_missed_targets(tmp_path):
    table = closing_table({"position_rmse_m": 0.02, "contacts": 2.0, "min_clearance_m": -0.01})
    lines = table.splitlines()
    assert lines[0].endswith("ok")
    assert lines[1].startswith("contacts")
    assert lines[1].split() == ["contacts", "2", "==", "0", "MISSED"]
    assert "smallest clearance" in lines[2]
    assert "nothing to compare" in closing_table({})
    assert "no ground truth" in closing_table({"path_m": 1.0})


def test_a_target_at_its_bound_is_met():
    metrics = {target.figure: target.bound for target in TARGETS}
    assert all(one.met and not one.miss for one in verdicts(metrics))
    assert len(verdicts(metrics)) == len(TARGETS)


def _turn(angle: float) -> np.ndarray:
    return np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
