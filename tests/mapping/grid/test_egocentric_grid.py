"""The terrain map against a fixed map, a NumPy version and closed forms."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapping.grid.egocentric_grid import EgocentricGrid, GridConfig
from mapping.grid.evidence import OBSTACLE_POINTS, EvidenceConfig, log_odds
from mapping.grid.scrolling import whole_cells
from perception.primitives.errors import ConfigError, InputError
from perception.primitives.pose import Pose2

CELL_M = 0.05
inside = st.floats(-CELL_M / 2, CELL_M / 2, exclude_max=True)
metres = st.floats(-3.0, 3.0)
SMALL = GridConfig(side_m=0.75, cell_m=0.05)


def p_of(odds: float) -> float:
    return 1 / (1 + np.exp(-odds))


def cell_points(grid: EgocentricGrid, row: int, column: int, count: int) -> np.ndarray:
    """Points spread inside one cell."""
    spread = np.linspace(-0.4, 0.4, count)[:, None] * grid.cell_m
    return grid.centre_of(row, column) + spread


def see(
    grid: EgocentricGrid,
    row: int,
    column: int,
    stamp_s: float,
    obstacle: bool,
    moving: bool = False,
    count: int = 3,
) -> None:
    points = cell_points(grid, row, column, count)
    grid.update(
        points, np.full(count, obstacle), stamp_s, np.zeros(2), is_moving=np.full(count, moving)
    )


@given(st.tuples(inside, inside), st.tuples(metres, metres))
def test_a_step_is_whole_cells_plus_a_remainder(offset, step):
    cells, rest = whole_cells(np.array(offset), np.array(step), CELL_M)
    np.testing.assert_allclose(cells * CELL_M + rest, np.add(offset, step), atol=1e-12)
    assert np.all(np.abs(rest) <= CELL_M / 2 + 1e-12)


def test_the_printed_eq_2_loses_the_offset_in_the_centre_cell():
    # Three steps of 0.02 m: 0.06 m is one cell and 0.01 m; eq. (2) as printed loses the first two.
    rest, literal, crossed = np.zeros(2), np.zeros(2), 0
    for _ in range(3):
        cells, rest = whole_cells(rest, np.array([0.02, 0.0]), CELL_M)
        crossed += cells[0]
        _, literal = whole_cells(literal, np.array([0.02, 0.0]), CELL_M, literal=True)
    assert crossed == 1
    assert rest[0] == pytest.approx(0.01, abs=1e-15)
    assert literal[0] == pytest.approx(0.02, abs=1e-15)


class FixedMap:
    """The same evidence on a dictionary of world cells: slow, plain, without any shifting."""

    def __init__(self, grid: EgocentricGrid, start: np.ndarray) -> None:
        self.anchor = start - grid.cell_m / 2
        self.cell_m = grid.cell_m
        self.half = grid.config.cells // 2
        self.evidence = grid.config.evidence
        self.cells: dict[tuple[int, int], tuple[float, float]] = {}

    def window(self, position: np.ndarray) -> tuple[int, int]:
        x, y = np.floor((position - self.anchor) / self.cell_m).astype(int) - self.half
        return int(x), int(y)

    def keep_only(self, position: np.ndarray) -> None:
        x0, y0 = self.window(position)
        n = 2 * self.half + 1
        self.cells = {
            (x, y): value
            for (x, y), value in self.cells.items()
            if x0 <= x < x0 + n and y0 <= y < y0 + n
        }

    def update(
        self, points: np.ndarray, is_obstacle: np.ndarray, stamp_s: float, position: np.ndarray
    ) -> None:
        x0, y0 = self.window(position)
        n = 2 * self.half + 1
        tally: dict[tuple[int, int], list[int]] = {}
        lattice = np.floor((points - self.anchor) / self.cell_m).astype(int)
        for (x, y), obstacle in zip(lattice.tolist(), is_obstacle, strict=True):
            if x0 <= x < x0 + n and y0 <= y < y0 + n:
                tally.setdefault((x, y), [0, 0])[int(obstacle)] += 1
        e = self.evidence
        for key, (floor, obstacle) in tally.items():
            old = self.cells.get(key)
            if obstacle >= OBSTACLE_POINTS:
                odds = log_odds(0.85) if old is None else min(old[0] + e.obstacle, e.limit)
            elif floor:
                odds = log_odds(0.15) if old is None else max(old[0] + e.floor, -e.limit)
            else:
                continue
            self.cells[key] = (odds, stamp_s)

    def arrays(self, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        n = 2 * self.half + 1
        p, t = np.ones((n, n)), np.zeros((n, n))
        x0, y0 = self.window(position)
        for (x, y), (odds, stamp_s) in self.cells.items():
            p[y - y0, x - x0], t[y - y0, x - x0] = p_of(odds), stamp_s
        return p, t


def test_a_thousand_random_steps_agree_with_a_fixed_map():
    # Seed 003, E3: identical cells, offset error below 1e-9 m.
    rng = np.random.default_rng(3)
    start = np.array([1.234, -0.777])
    grid = EgocentricGrid(SMALL, start)
    fixed = FixedMap(grid, start)
    pose = Pose2(*start, 0.3)
    for k in range(1000):
        pose = pose @ Pose2(
            rng.uniform(-0.03, 0.08), rng.uniform(-0.03, 0.03), rng.uniform(-0.25, 0.25)
        )
        position = np.array([pose.x, pose.y])
        points = position + rng.uniform(-0.5, 0.5, (120, 2))
        is_obstacle = points[:, 0] % 0.3 < 0.15
        grid.move(position)
        grid.update(points, is_obstacle, k + 1.0, position)
        fixed.keep_only(position)
        fixed.update(points, is_obstacle, k + 1.0, position)
        assert np.abs(grid.position - position).max() < 1e-9
        assert np.abs(grid.offset).max() <= grid.cell_m / 2 + 1e-12
        p, t = fixed.arrays(position)
        np.testing.assert_allclose(grid.probability, p, atol=2e-6)  # float32 log-odds
        np.testing.assert_array_equal(grid.updated_s, t)


@settings(max_examples=30, deadline=None)
@given(st.lists(st.tuples(metres, metres), min_size=1, max_size=6))
def test_moving_there_and_back_keeps_the_cells_that_stayed_inside(steps):
    grid = EgocentricGrid(SMALL, np.zeros(2))
    n = SMALL.cells
    rng = np.random.default_rng(0)
    points = rng.uniform(-0.37, 0.37, (600, 2))
    grid.update(points, rng.random(600) < 0.5, 1.0, np.zeros(2))
    before, known = grid.probability, grid.known
    inside = np.ones((n, n), bool)
    for step in steps:
        grid.move(np.array(step))
        first_row, first_column = (
            -grid.cell_of(np.zeros(2)) + n // 2
        )  # of the window, from the start's
        kept_rows = (np.arange(n) >= first_row) & (np.arange(n) < first_row + n)
        kept_columns = (np.arange(n) >= first_column) & (np.arange(n) < first_column + n)
        inside &= kept_rows[:, None] & kept_columns[None, :]
    grid.move(np.zeros(2))
    np.testing.assert_array_equal(grid.probability[inside], before[inside])
    assert np.all(grid.probability[~inside] == 1.0)
    np.testing.assert_array_equal(grid.known, known & inside)


def test_a_shift_moves_the_offset_and_not_the_data():
    grid = EgocentricGrid(SMALL, np.zeros(2))
    see(grid, 7, 7, 1.0, obstacle=True)
    array, n = grid._log_odds, SMALL.cells
    before = array.copy()
    grid.move(np.array([0.05, 0.0]))
    assert grid._log_odds is array
    changed = array != before
    assert changed.sum() == 0  # the column that entered was unseen before, too
    assert grid.known[7, 6]  # one column further back
    grid.move(np.array([0.05 * 8, 0.0]))
    assert (array != before).sum() == 1  # now the seen cell has left
    assert not grid.known.any()
    assert grid.probability.shape == (n, n)


def test_the_origin_is_the_lower_left_corner_and_rows_run_along_y():
    grid = EgocentricGrid(SMALL, np.array([2.0, 1.0]))
    np.testing.assert_allclose(grid.origin, [2.0 - 0.375, 1.0 - 0.375], atol=1e-12)
    np.testing.assert_array_equal(grid.cell_of(np.array([2.0 + 0.1, 1.0])), [7, 9])
    np.testing.assert_allclose(grid.centre_of(7, 9), [2.1, 1.0], atol=1e-12)
    np.testing.assert_allclose(grid.centres()[7, 9], [2.1, 1.0], atol=1e-12)
    np.testing.assert_allclose(grid.centres()[0, 0] - grid.cell_m / 2, grid.origin, atol=1e-12)
    see(grid, 7, 9, 1.0, obstacle=True)
    assert grid.known[7, 9]
    assert grid.known.sum() == 1


def test_a_cell_never_seen_has_probability_one_and_time_zero():
    grid = EgocentricGrid(SMALL, np.zeros(2))
    assert np.all(grid.probability == 1.0)
    assert np.all(grid.updated_s == 0.0)
    see(grid, 0, 0, 0.0, obstacle=True)  # a run may start at stamp 0
    assert grid.known[0, 0]
    assert grid.probability[0, 0] == pytest.approx(0.85)


def test_observations_add_up_in_log_odds_within_the_limit():
    grid = EgocentricGrid(SMALL, np.zeros(2))
    expected = log_odds(0.15)
    see(grid, 3, 4, 1.0, obstacle=False)
    assert grid.probability[3, 4] == pytest.approx(0.15, abs=1e-6)
    for k, obstacle in enumerate([False, True, True, True, True, True, False]):
        see(grid, 3, 4, 2.0 + k, obstacle)
        expected = float(np.clip(expected + (1.73 if obstacle else -0.85), -3.9, 3.9))
        assert grid.probability[3, 4] == pytest.approx(p_of(expected), abs=1e-6)
        assert grid.updated_s[3, 4] == 2.0 + k


@pytest.mark.parametrize(("obstacle_points", "expected"), [(2, 0.15), (3, 0.85)])
def test_an_obstacle_needs_three_points_and_then_wins_over_floor(obstacle_points, expected):
    grid = EgocentricGrid(SMALL, np.zeros(2))
    points = cell_points(grid, 5, 5, 40)
    grid.update(points, np.arange(40) < obstacle_points, 1.0, np.zeros(2))
    assert grid.probability[5, 5] == pytest.approx(expected, abs=1e-6)


def test_two_obstacle_points_alone_leave_a_cell_unseen():
    grid = EgocentricGrid(SMALL, np.zeros(2))
    grid.update(cell_points(grid, 5, 5, 2), np.ones(2, bool), 1.0, np.zeros(2))
    assert not grid.known.any()


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_the_order_of_points_does_not_matter(seed):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-0.5, 0.5, (400, 2))
    flags = rng.random(400) < 0.4
    order = rng.permutation(400)
    a, b = EgocentricGrid(SMALL, np.zeros(2)), EgocentricGrid(SMALL, np.zeros(2))
    a.update(points, flags, 1.0, np.zeros(2), sensor_height_m=0.4)
    b.update(points[order], flags[order], 1.0, np.zeros(2), sensor_height_m=0.4)
    np.testing.assert_array_equal(a.probability, b.probability)
    assert np.all((a.probability >= 0) & (a.probability <= 1))


def test_points_outside_and_nan_change_nothing():
    grid = EgocentricGrid(SMALL, np.zeros(2))
    points = np.array(
        [[np.nan, 0.0], [0.0, np.nan], [9.0, 0.0], [0.0, -9.0], [np.inf, 0.0]]
    ).repeat(5, 0)
    grid.update(points, np.ones(len(points), bool), 1.0, np.zeros(2))
    grid.update(np.zeros((0, 2)), np.zeros(0, bool), 2.0, np.zeros(2))
    assert not grid.known.any()


def test_points_in_single_precision_land_in_the_same_cells():
    rng = np.random.default_rng(1)
    points = rng.uniform(-0.4, 0.4, (500, 2)).astype(np.float32)
    a, b = EgocentricGrid(SMALL, np.zeros(2)), EgocentricGrid(SMALL, np.zeros(2))
    a.update(points, np.ones(500, bool), 1.0, np.zeros(2))
    b.update(points.astype(np.float64), np.ones(500, bool), 1.0, np.zeros(2))
    np.testing.assert_array_equal(a.known, b.known)


def test_one_floor_observation_clears_a_moving_obstacle_and_not_a_wall():
    grid = EgocentricGrid(SMALL, np.zeros(2))
    for k in range(5):
        see(grid, 2, 2, 1.0 + k, obstacle=True, moving=True)
        see(grid, 9, 9, 1.0 + k, obstacle=True)
    assert grid.probability[2, 2] > 0.5
    assert grid.moving[2, 2]
    for cell in ((2, 2), (9, 9)):
        see(grid, *cell, 9.0, obstacle=False)
    assert grid.probability[2, 2] < 0.5
    assert not grid.moving[2, 2]
    assert grid.probability[9, 9] > 0.9


def test_an_obstacle_that_turns_out_to_move_is_cleared_by_one_floor_observation():
    grid = EgocentricGrid(SMALL, np.zeros(2))
    for k in range(5):
        see(grid, 2, 2, 1.0 + k, obstacle=True)
    see(grid, 2, 2, 6.0, obstacle=True, moving=True)
    see(grid, 2, 2, 7.0, obstacle=False)
    assert grid.probability[2, 2] < 0.5


def test_static_points_in_a_cell_outweigh_moving_ones():
    grid = EgocentricGrid(SMALL, np.zeros(2))
    points = np.tile(cell_points(grid, 4, 4, 3), (2, 1))
    grid.update(points, np.ones(6, bool), 1.0, np.zeros(2), is_moving=np.arange(6) < 3)
    assert not grid.moving[4, 4]
    assert grid.probability[4, 4] == pytest.approx(0.85, abs=1e-6)


def test_moving_obstacles_out_of_view_fade_to_one_half_and_are_forgotten():
    grid = EgocentricGrid(SMALL, np.zeros(2))
    see(grid, 2, 2, 1.0, obstacle=True, moving=True)
    see(grid, 3, 3, 1.0, obstacle=True)
    start = float(grid.probability[2, 2])
    grid.age(4.0)
    assert grid.probability[2, 2] == start  # in view in the latest frame
    see(grid, 9, 9, 2.0, obstacle=False)
    for _ in range(4):
        grid.age(1.0)
    assert grid.probability[2, 2] == pytest.approx(0.5 + (start - 0.5) * np.exp(-0.4), abs=1e-5)
    grid.age(30.0)
    assert not grid.known[2, 2]
    assert grid.updated_s[2, 2] == 0.0
    assert grid.probability[3, 3] == pytest.approx(0.85, abs=1e-6)  # static obstacles do not age


def test_a_ray_clears_only_the_cells_in_which_it_is_lower_than_an_obstacle():
    # Camera 0.4 m high, lowest obstacle 0.03 m: 7.5 % of a ray of 1.5 m, that is 0.1125 m or two cells.
    grid = EgocentricGrid(GridConfig(), np.zeros(2))
    row, column = grid.cell_of(np.array([1.5, 0.0]))
    see_args = (cell_points(grid, row, column, 3), np.zeros(3, bool), 1.0, np.zeros(2))
    grid.update(*see_args, sensor_height_m=0.4)
    np.testing.assert_array_equal(np.flatnonzero(grid.known[row]), [column - 2, column - 1, column])
    assert grid.known.sum() == 3
    other = EgocentricGrid(GridConfig(), np.zeros(2))
    other.update(*see_args)
    assert other.known.sum() == 1


def test_a_ray_never_clears_a_cell_with_points():
    grid = EgocentricGrid(GridConfig(), np.zeros(2))
    row, column = grid.cell_of(np.array([1.5, 0.0]))
    points = np.concatenate(
        [cell_points(grid, row, column, 3), cell_points(grid, row, column - 1, 3)]
    )
    grid.update(points, np.arange(6) >= 3, 1.0, np.zeros(2), sensor_height_m=0.4)
    assert grid.probability[row, column - 1] == pytest.approx(0.85, abs=1e-6)


def test_marking_an_obstacle_as_moving_fades_its_cells_only():
    grid = EgocentricGrid(SMALL, np.zeros(2))
    for stamp in (1.0, 2.0, 3.0):
        see(grid, 7, 7, stamp, obstacle=True)
        see(grid, 7, 11, stamp, obstacle=True)
    see(grid, 7, 8, 3.0, obstacle=False)
    grid.mark_moving(grid.centre_of(7, 7)[None], np.array([0.06]))
    assert grid.moving.sum() == 1
    assert 0.5 < grid.probability[7, 7] < grid.probability[7, 11]
    assert grid.known.sum() == 3
    assert grid.probability[7, 8] < 0.5
    see(grid, 7, 7, 4.0, obstacle=False)
    assert grid.probability[7, 7] < 0.5
    grid.mark_moving(grid.centre_of(7, 11)[None], np.array([0.06]))
    grid.age(60.0)
    assert not grid.known[7, 11]


def test_a_step_longer_than_the_grid_clears_it():
    grid = EgocentricGrid(SMALL, np.zeros(2))
    see(grid, 7, 7, 1.0, obstacle=True)
    grid.move(np.array([100.0, -50.0]))
    assert not grid.known.any()
    np.testing.assert_allclose(grid.position, [100.0, -50.0], atol=1e-9)


@pytest.mark.parametrize("copied", [lambda grid: pickle.loads(pickle.dumps(grid)), copy.deepcopy])
def test_a_pickled_grid_accepts_further_updates_like_the_original(copied):
    rng = np.random.default_rng(11)
    grid = EgocentricGrid(SMALL, np.zeros(2))

    def step(one: EgocentricGrid, points: np.ndarray, stamp_s: float) -> None:
        one.move(points[0, :2])
        one.update(
            points,
            points[:, 2] > 0.05,
            stamp_s,
            np.zeros(2),
            sensor_height_m=0.4,
            sees_through=lambda places: places[:, 0] % 0.3 < 0.15,
        )
        one.age(0.3)

    frames = rng.uniform(-0.4, 0.4, (6, 300, 3))
    for k in range(3):
        step(grid, frames[k], 1.0 + k)
    other = copied(grid)
    for k in range(3, 6):
        for one in (grid, other):
            step(one, frames[k], 1.0 + k)
    for name, layer in grid.snapshot().items():
        np.testing.assert_array_equal(other.snapshot()[name], layer, err_msg=name)


def test_bad_input_is_refused_with_its_reason():
    with pytest.raises(ConfigError, match=r"70 cells of 0\.05 m, expected an odd"):
        GridConfig(side_m=3.5, cell_m=0.05)
    assert GridConfig(side_m=3.5, cell_m=0.02).cells == 175
    assert GridConfig().cells == 71
    with pytest.raises(ConfigError, match=r"cell_m=5\.0 must lie between"):
        GridConfig(cell_m=5.0)
    with pytest.raises(ConfigError, match="limit=0"):
        EvidenceConfig(limit=0.1)
    grid = EgocentricGrid(SMALL, np.zeros(2))
    with pytest.raises(InputError, match="not finite"):
        grid.move(np.array([np.nan, 0.0]))


def test_kernel_and_numpy_counts_agree():
    from mapping.grid import _evidence_kernels

    rng = np.random.default_rng(5)
    n, rows, columns = 30_000, 40, 60  # more than one block
    points = rng.uniform(-2, 2, (n, 2))
    points[rng.random(n) < 0.05] = np.nan
    kinds = rng.integers(0, 3, n).astype(np.uint8)
    anchor, first = np.array([0.013, -0.02]), np.array([-25, -18])
    tally = np.ones(3 * rows * columns + 1, np.int32)
    _evidence_kernels.count_points(points, kinds, anchor, 20.0, first, rows, columns, tally)
    expected = np.zeros((3, rows, columns), int)
    finite = np.isfinite(points[:, 0])
    cells = np.floor((points[finite] - anchor) * 20.0).astype(int) - first
    inside = ((cells >= 0) & (cells < [columns, rows])).all(axis=1)
    np.add.at(expected, (kinds[finite][inside], cells[inside, 1], cells[inside, 0]), 1)
    np.testing.assert_array_equal(tally[:-1].reshape(3, rows, columns), expected)
    assert tally[-1] == n - inside.sum()
