"""Heights of the terrain map against closed forms, plain Python and their own variance."""

from __future__ import annotations

import math
from inspect import unwrap

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from mapping.grid.egocentric_grid import EgocentricGrid, GridConfig
from mapping.grid.heights import floor_form, pose_form
from perception.primitives.errors import InputError
from perception.primitives.gaussian import Gaussian
from perception.primitives.plane import Plane
from perception.primitives.pose import Pose2, Pose3

SMALL = GridConfig(side_m=0.75, cell_m=0.05)
BASE = SMALL.height_sigma_m**2
LEVEL = np.array([0.0, 0.0, 1.0])


def at(grid: EgocentricGrid, row: int, column: int, heights: list[float]) -> np.ndarray:
    """Points in the middle of a cell, of given heights."""
    xy = np.tile(grid.centre_of(row, column), (len(heights), 1))
    return np.column_stack([xy, heights])


def see(grid, points, obstacle, stamp_s=1.0, **more):
    grid.update(points, np.full(len(points), obstacle), stamp_s, np.zeros(2), **more)


def test_one_frame_gives_the_mean_and_the_variance_of_the_mean():
    grid = EgocentricGrid(SMALL, np.zeros(2))
    see(grid, at(grid, 5, 6, [0.10, 0.14, 0.12]), True)
    assert grid.height_m[5, 6] == pytest.approx(0.12)
    assert grid.height_variance_m2[5, 6] == pytest.approx(0.02**2 / 3 + BASE, rel=1e-5)
    assert np.isfinite(grid.height_m).sum() == 1


def test_depth_noise_bounds_the_variance_when_the_points_agree_by_chance():
    grid = EgocentricGrid(SMALL, np.zeros(2))
    see(grid, at(grid, 5, 6, [0.0]), False, sigma_m=np.array([0.03]))
    assert grid.height_variance_m2[5, 6] == pytest.approx(0.03**2 + BASE, rel=1e-5)


def test_the_variance_of_a_tilted_floor_grows_with_the_lever_arm():
    grid = EgocentricGrid(SMALL, np.array([2.0, 1.0]))
    floor = Plane(LEVEL, 0.0, np.diag([0.01**2, 0.02**2, 0.003**2]))
    row, column = grid.cell_of(np.array([2.1, 0.9]))
    see(grid, at(grid, row, column, [0.0]), False, floor=floor)
    x, y = grid.centre_of(row, column)
    lever = np.array([*(floor.tangents[:, :2] @ [x, y]), 1.0])
    expected = lever @ floor.covariance @ lever + BASE
    assert grid.height_variance_m2[row, column] == pytest.approx(expected, rel=1e-5)


def test_pose_variance_adds_to_the_height_of_slopes_and_not_of_level_cells():
    # Heights spread evenly over a cell of 5 cm, 4 cm in all: the slope is 0.8.
    grid = EgocentricGrid(SMALL, np.zeros(2))
    pose = Gaussian(np.zeros(3), np.diag([0.02**2, 0.02**2, 0.0]))
    heights = np.linspace(0.08, 0.12, 400).tolist()
    see(grid, at(grid, 5, 6, heights), True, pose=pose)
    see(grid, at(grid, 9, 6, [0.1] * 400), True, pose=pose)
    slope = grid.height_variance_m2[5, 6] - BASE
    assert math.sqrt(slope) == pytest.approx(0.8 * 0.02, rel=0.01)
    assert grid.height_variance_m2[9, 6] == pytest.approx(BASE, rel=1e-3)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_the_pose_form_is_the_positional_variance_of_a_place(seed):
    rng = np.random.default_rng(seed)
    root = rng.normal(0, [0.03, 0.03, 0.02], (3, 3))
    pose = Gaussian(rng.uniform(-2, 2, 3), root.T @ root)
    x, y = rng.uniform(-2, 2, 2)
    # Jacobian of where the place is drawn, by finite differences of the pose.
    body = Pose2(*pose.mean).inverse().lifted().apply(np.array([[x, y, 0.0]]))
    jacobian = np.zeros((2, 3))
    for axis in range(3):
        step = np.zeros(3)
        step[axis] = 1e-6
        moved = [Pose2(*(pose.mean + s)).lifted().apply(body)[0, :2] for s in (step, -step)]
        jacobian[:, axis] = (moved[0] - moved[1]) / 2e-6
    expected = np.trace(jacobian @ pose.covariance @ jacobian.T) / 2
    place = np.array([x, y, 1.0])
    assert place @ pose_form(pose) @ place == pytest.approx(expected, rel=1e-5, abs=1e-12)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_the_floor_form_does_not_depend_on_the_camera_pose(seed):
    rng = np.random.default_rng(seed)
    root = rng.normal(0, [0.01, 0.01, 0.005], (3, 3))
    turned = Pose2(0.0, 0.0, rng.uniform(-3, 3)).lifted().rotation
    camera = Pose3.from_rotation(turned, rng.uniform(-2, 2, 3))
    seen = Plane(LEVEL, 0.0, root.T @ root)
    world = seen.moved(camera)
    place = rng.uniform(-2, 2, 3)
    local = camera.inverse().apply(place[None])[0]
    lever = np.array([*(seen.tangents @ local), 1.0])
    level = np.array([place[0], place[1], 1.0])
    expected = lever @ seen.covariance @ lever
    assert level @ floor_form(world) @ level == pytest.approx(expected, rel=1e-6)


class PlainFusion:
    """The same fusion cell by cell in plain Python, on the grid's own belief."""

    def __init__(self) -> None:
        self.cells: dict[tuple[int, int], tuple[float, float, bool]] = {}

    def update(self, grid, points, flags, moving, sigma, shared) -> None:
        believed = grid.probability > 0.5
        lattice = [tuple(c) for c in grid.cell_of(points[:, :2]).tolist()]
        for cell in sorted(set(lattice)):
            if not all(0 <= v < grid.config.cells for v in cell):
                continue
            mine = np.array([c == cell for c in lattice])
            obstacle = mine & flags
            rising = obstacle.sum() >= 3
            chosen = obstacle if rising else mine & ~flags
            if cell in self.cells and self.cells[cell][2] != believed[cell]:
                del self.cells[cell]
            if not chosen.any() or rising != believed[cell]:
                continue
            z = points[chosen, 2]
            each = max(z.var(ddof=1) if len(z) > 1 else 0.0, np.mean(sigma[chosen] ** 2))
            uneven = z.var(ddof=1) if len(z) > 1 else 0.0
            uneven = max(0.0, uneven - np.mean(sigma[chosen] ** 2))
            slope2 = max(12 * uneven / grid.cell_m**2, self.slope2(grid, cell, z.mean(), rising))
            common = shared[0] + slope2 * shared[1]
            mean, new = z.mean(), each / len(z) + BASE + common
            old = self.cells.get(cell)
            if old is None or (mine & moving).any() or (mean - old[0]) ** 2 > 9 * (old[1] + new):
                self.cells[cell] = mean, new, rising
            else:
                gain = old[1] / (old[1] + new)
                fused = max((1 - gain) * old[1], min(common, old[1]))
                self.cells[cell] = old[0] + gain * (mean - old[0]), fused, rising

    def slope2(self, grid, cell, height, rising) -> float:
        total = 0.0
        for axis in np.eye(2, dtype=int):
            beside = {side: tuple((np.array(cell) + side * axis).tolist()) for side in (-1, 1)}
            rises = [
                side * (self.cells[there][0] - height)
                for side, there in beside.items()
                if there in self.cells and self.cells[there][2] == rising
            ]
            total += np.mean(rises or [0.0]) ** 2 / grid.cell_m**2
        return total


def test_kernel_and_plain_python_fuse_the_same():
    rng = np.random.default_rng(8)
    grid, twin = EgocentricGrid(GridConfig(side_m=0.35), np.zeros(2)), PlainFusion()
    floor = Plane(LEVEL, 0.0, np.diag([0.0, 0.0, 0.004**2]))
    pose = Gaussian(np.zeros(3), np.diag([0.01**2, 0.03**2, 0.0]))
    shared = 0.004**2, (0.01**2 + 0.03**2) / 2
    for k in range(40):
        points = rng.uniform(-0.2, 0.2, (150, 3)) * [1, 1, 0.05]
        flags = rng.random(150) < 0.3
        points[flags, 2] += 0.1 + 0.2 * (k > 20)
        moving = flags & (points[:, 0] > 0.12)
        sigma = rng.uniform(0.001, 0.02, 150)
        grid.update(
            points,
            flags,
            1.0 + k,
            np.zeros(2),
            is_moving=moving,
            sigma_m=sigma,
            floor=floor,
            pose=pose,
        )
        twin.update(grid, points, flags, moving, sigma, shared)
        expected = np.full((2, 7, 7), np.nan)
        for cell, (height, variance, _) in twin.cells.items():
            expected[(slice(None), *cell)] = height, variance
        np.testing.assert_allclose(grid.height_m, expected[0], rtol=1e-4, atol=1e-6)
        np.testing.assert_allclose(grid.height_variance_m2, expected[1], rtol=1e-3)


def test_height_errors_are_consistent_with_their_variance():
    # A bumpy floor, 20 frames, depth noise only: NEES of each cell is chi-square.
    rng = np.random.default_rng(5)
    config = GridConfig(side_m=1.55, height_sigma_m=1e-5)
    grid = EgocentricGrid(config, np.zeros(2))
    true = rng.normal(0.0, 0.002, (31, 31))
    sigma = rng.uniform(0.004, 0.02, (31, 31))
    rows, columns = np.indices((31, 31)).reshape(2, -1)
    for k in range(20):
        xy = np.repeat(grid.centres().reshape(-1, 2), 6, axis=0)
        noise = np.repeat(sigma.ravel(), 6)
        z = np.repeat(true.ravel(), 6) + noise * rng.standard_normal(len(noise))
        see(grid, np.column_stack([xy, z]), False, 1.0 + k, sigma_m=noise)
    nees = (grid.height_m - true)[rows, columns] ** 2 / grid.height_variance_m2[rows, columns]
    # max(spread, noise) is a little more than the truth: six points scatter by chance, too.
    assert stats.chi2.ppf(1e-4, 961) / 961 * 0.75 < nees.mean() < stats.chi2.ppf(0.9999, 961) / 961


def test_errors_common_to_all_frames_are_not_averaged_away():
    # One wrong floor for all frames: the variance must go on covering it.
    rng = np.random.default_rng(6)
    offset = 0.004
    floor = Plane(LEVEL, 0.0, np.diag([0.0, 0.0, offset**2]))
    nees = []
    for _ in range(60):
        grid = EgocentricGrid(GridConfig(side_m=0.15), np.zeros(2))
        error = rng.normal(0, offset)
        for k in range(30):
            z = error + 0.003 * rng.standard_normal(8)
            see(grid, at(grid, 1, 1, z.tolist()), False, 1.0 + k, floor=floor)
        nees.append(grid.height_m[1, 1] ** 2 / grid.height_variance_m2[1, 1])
    assert stats.chi2.ppf(1e-3, 60) / 60 < np.mean(nees) < stats.chi2.ppf(0.999, 60) / 60


@pytest.mark.parametrize("cell_m", [0.02, 0.05, 0.25])
@pytest.mark.parametrize("slope", [0.0, 0.3])
def test_depth_noise_is_not_taken_for_a_slope_along_which_the_pose_error_counts(cell_m, slope):
    # A plane seen in ten frames of one pose error: the claims fit the errors whatever the size of a cell.
    rng = np.random.default_rng(9)
    noise, sigma = 0.01, 0.02
    pose = Gaussian(np.zeros(3), np.diag([sigma**2, sigma**2, 0.0]))
    nees = []
    for _ in range(100):
        grid = EgocentricGrid(GridConfig(side_m=9 * cell_m, cell_m=cell_m), np.zeros(2))
        off = rng.normal(0.0, sigma, 2)
        for k in range(10):
            xy = rng.uniform(-4.5 * cell_m, 4.5 * cell_m, (81 * 20, 2))
            z = slope * xy[:, 0] + rng.normal(0.0, noise, len(xy))
            points = np.column_stack([xy + off, z])
            see(grid, points, False, 1.0 + k, sigma_m=np.full(len(xy), noise), pose=pose)
        inner = np.s_[3:-3, 3:-3]
        error = (grid.height_m - slope * grid.centres()[..., 0])[inner]
        nees.append(np.nanmean(error**2 / grid.height_variance_m2[inner]))
    assert 0.3 < np.mean(nees) < 2.0


def test_a_mean_outside_the_gate_replaces_the_height():
    grid = EgocentricGrid(SMALL, np.zeros(2))
    for k in range(5):
        see(grid, at(grid, 5, 6, [0.10, 0.10, 0.11]), True, 1.0 + k)
    see(grid, at(grid, 5, 6, [0.30, 0.30, 0.31]), True, 6.0)
    assert grid.height_m[5, 6] == pytest.approx(0.3033, abs=1e-3)


def test_the_height_of_an_obstacle_is_removed_with_the_obstacle():
    grid = EgocentricGrid(SMALL, np.zeros(2))
    see(grid, at(grid, 5, 6, [0.10, 0.10, 0.11]), True)
    for k in range(2):
        see(grid, at(grid, 5, 6, [0.0]), False, 2.0 + k)
        assert grid.height_m[5, 6] == pytest.approx(0.1033, abs=1e-3)  # still occupied
    see(grid, at(grid, 5, 6, [0.001]), False, 4.0)
    assert grid.probability[5, 6] < 0.5
    assert grid.height_m[5, 6] == pytest.approx(0.001)


def test_a_cell_cleared_by_a_ray_has_no_height():
    grid = EgocentricGrid(GridConfig(), np.zeros(2))
    row, column = grid.cell_of(np.array([1.5, 0.0]))
    see(grid, at(grid, row, column, [0.0, 0.001, 0.002]), False, sensor_height_m=0.4)
    assert grid.known[row].sum() == 3
    assert np.isfinite(grid.height_m[row]).sum() == 1


def test_heights_scroll_with_the_grid_and_entering_cells_have_none():
    grid = EgocentricGrid(SMALL, np.zeros(2))
    see(grid, at(grid, 7, 9, [0.2] * 3), True)
    grid.move(np.array([0.10, -0.05]))
    assert grid.height_m[8, 7] == pytest.approx(0.2)
    assert np.isfinite(grid.height_m).sum() == 1
    grid.move(np.array([2.0, 0.0]))
    assert np.isnan(grid.height_m).all()
    assert np.isnan(grid.height_variance_m2).all()


def test_points_without_heights_keep_the_stored_heights():
    grid = EgocentricGrid(SMALL, np.zeros(2))
    see(grid, at(grid, 7, 9, [0.2] * 3), True)
    see(grid, at(grid, 7, 9, [0.5] * 3)[:, :2], True, 2.0)
    assert grid.height_m[7, 9] == pytest.approx(0.2)
    assert np.isfinite(grid.height_m).sum() == 1


def test_a_forgotten_cell_has_no_height():
    grid = EgocentricGrid(SMALL, np.zeros(2))
    see(grid, at(grid, 3, 7, [0.2] * 3), True, is_moving=np.ones(3, np.bool_))
    see(grid, at(grid, 7, 7, [0.2] * 3), True)
    see(grid, at(grid, 0, 0, [0.0]), False, 2.0)
    grid.mark_moving(grid.centre_of(7, 7)[None], np.array([0.06]))
    grid.age(100.0)
    assert np.isfinite(grid.height_m).sum() == 1
    assert np.isfinite(grid.height_m[0, 0])


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_the_order_of_points_changes_heights_by_rounding_only(seed):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-0.5, 0.5, (400, 3))
    flags = points[:, 2] > 0.1
    order = rng.permutation(400)
    a, b = EgocentricGrid(SMALL, np.zeros(2)), EgocentricGrid(SMALL, np.zeros(2))
    a.update(points, flags, 1.0, np.zeros(2))
    b.update(points[order], flags[order], 1.0, np.zeros(2))
    np.testing.assert_array_equal(a.probability, b.probability)
    np.testing.assert_allclose(a.height_m, b.height_m, rtol=1e-5, atol=1e-7)
    variance = a.height_variance_m2
    assert (variance[np.isfinite(a.height_m)] > 0).all()


def test_points_outside_and_nan_heights_change_nothing():
    grid = EgocentricGrid(SMALL, np.zeros(2))
    points = np.array([[9.0, 0, 0], [0, 0, np.nan], [np.nan, 0, 0], [0, -np.inf, 0]]).repeat(5, 0)
    see(grid, points, True)
    assert not grid.known.any()
    assert np.isnan(grid.height_m).all()
    see(grid, at(grid, 7, 7, [0.1] * 3), True, 2.0)  # nothing is left over from the frame before
    assert grid.known.sum() == 1
    assert grid.height_m[7, 7] == pytest.approx(0.1)


def test_bad_input_is_refused_with_its_reason():
    grid = EgocentricGrid(SMALL, np.zeros(2))
    with pytest.raises(InputError, match="2 points but 1 sigmas"):
        unwrap(EgocentricGrid.update)(  # without the check of shapes
            grid, np.zeros((2, 3)), np.zeros(2, bool), 1.0, np.zeros(2), sigma_m=np.zeros(1)
        )
