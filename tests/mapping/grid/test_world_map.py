"""The world map: its content does not depend on where it grows."""

from __future__ import annotations

from inspect import unwrap

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage
from scipy.special import betaln, expit

from mapping.grid.egocentric_grid import EgocentricGrid, GridConfig
from mapping.grid.evidence import probability_of
from mapping.grid.world_map import SHARES, WorldMap, WorldMapConfig, low_obstacle
from perception.primitives.errors import ConfigError, InputError
from perception.primitives.gaussian import Gaussian
from perception.primitives.plane import Plane

CELL_M = 0.05
CAMERA = np.array([-2.0, 0.3, 1.2])


def level(xy: np.ndarray, height_m: float = 0.0) -> np.ndarray:
    return np.column_stack([xy, np.full(len(xy), height_m)])


def ratio_of_beta_binomials(n: float, k: float) -> float:
    """Posterior of even odds by SciPy."""
    a1, b1, a0, b0 = SHARES
    odds = betaln(k + a1, n - k + b1) - betaln(a1, b1) - betaln(k + a0, n - k + b0) + betaln(a0, b0)
    return float(expit(odds))


@settings(max_examples=20, deadline=None)
@given(
    st.lists(
        st.tuples(st.floats(-20, 20), st.floats(-20, 20), st.booleans()), min_size=1, max_size=8
    )
)
def test_its_content_does_not_depend_on_where_it_grows(places):
    world = WorldMap()
    seen: dict[tuple[int, int], list[float]] = {}
    for k, (x, y, raised) in enumerate(places):
        points = level(np.tile([x, y], (3, 1)), 0.3 if raised else 0.0)
        world.update(points, np.full(3, raised), float(k), CAMERA)
        cell = tuple(np.floor(np.array([x, y]) * (1 / CELL_M)).astype(int).tolist())
        seen.setdefault(cell, []).append(float(raised))
    assert world.known.sum() == len(seen)
    for cell, looks in seen.items():
        row, column = world.cell_of((np.array(cell) + 0.5) * CELL_M)
        expected = ratio_of_beta_binomials(len(looks), sum(looks))
        assert world.probability[row, column] == pytest.approx(expected, abs=1e-5)


def judged_by_numpy(points, flags, sigma, camera, variance_m2):
    """Verdict and weight of a frame for every cell of its window, without loops over points or compiled code."""
    cells = np.floor(points[:, :2] / CELL_M).astype(int)
    first = cells.min(axis=0)
    column, row = (cells - first).T
    shape = (row.max() + 1, column.max() + 1)
    floor, static, noise, height = (np.zeros(shape) for _ in range(4))
    np.add.at(floor, (row[~flags], column[~flags]), 1)
    for layer, values in ((static, 1.0), (noise, sigma[flags] ** 2), (height, points[flags, 2])):
        np.add.at(layer, (row[flags], column[flags]), values)
    count = np.maximum(static, 1)
    rows, columns = np.indices(shape)
    x, y = (
        (first[0] + columns + 0.5) * CELL_M - camera[0],
        (first[1] + rows + 0.5) * CELL_M - camera[1],
    )
    distance = np.sqrt(x * x + y * y + (height / count - camera[2]) ** 2)
    most, towards = static.copy(), np.zeros(shape)
    around = np.pad(static, 1)
    for dr in (-1, 0, 1):
        for dc in (-1, 0, 1):
            beside = around[1 + dr : 1 + dr + shape[0], 1 + dc : 1 + dc + shape[1]]
            fuller = beside > most
            most[fuller] = beside[fuller]
            towards[fuller] = (np.abs(x * dc + y * dr) / max(np.hypot(dr, dc), 1))[fuller]
    reach = np.sqrt(noise / count) * towards / distance / CELL_M / 1.702
    own = static / np.maximum(static + most * reach, 1e-9)
    shows = static >= 3
    weight = np.where(shows, np.where(floor > 0, 1, own), (static < 3) & (floor > 0))
    verdict = np.where(shows, np.where(floor > 0, own, 1), 0.0)
    cross = np.array([[0, 1, 0], [1, 0, 1], [0, 1, 0]])
    beside = ndimage.correlate((weight > 0).astype(float), cross, mode="constant")
    total = ndimage.correlate(verdict * (weight > 0), cross, mode="constant")
    share = min(0.8, 1 - (1 - np.sqrt(2 / np.pi * variance_m2) / CELL_M) ** 2)
    blurred = (1 - share) * verdict + share * total / np.maximum(beside, 1)
    return first, weight, np.where(beside > 0, blurred, verdict)


def test_looks_agree_with_numpy():
    rng = np.random.default_rng(4)
    world = WorldMap()
    points = np.column_stack([rng.normal(0.0, 0.4, (6000, 2)), np.zeros(6000)])
    flags = points[:, 0] > 0.2 + 0.1 * rng.standard_normal(6000)
    points[flags, 2] = rng.uniform(0.1, 0.5, flags.sum())
    sigma = rng.uniform(0.005, 0.03, 6000)
    pose = Gaussian(np.zeros(3), np.diag([4e-4, 4e-4, 0.0]))
    world.update(points, flags, 1.0, CAMERA, sigma_m=sigma, pose=pose)
    first, weight, verdict = judged_by_numpy(points, flags, sigma, CAMERA, 4e-4)
    looked = np.argwhere(weight > 0)
    mine = world.cell_of((looked[:, ::-1] + first + 0.5) * CELL_M)
    assert len(looked) > 300
    for (row, column), cell in zip(looked, mine, strict=True):
        n = float(weight[row, column])
        expected = ratio_of_beta_binomials(n, n * float(verdict[row, column]))
        shown = float(probability_of(world._layers("log_odds")["log_odds"][tuple(cell)][None])[0])
        assert shown == pytest.approx(expected, abs=1e-4)
    assert world.known.sum() == len(looked)


def test_empty_frames_leave_an_empty_map():
    world = WorldMap()
    world.update(np.zeros((0, 3)), np.zeros(0, bool), 1.0, CAMERA)
    world.update(np.full((4, 3), np.nan), np.ones(4, bool), 1.0, CAMERA)
    assert world.probability.shape == (0, 0)


def test_many_rays_of_one_frame_are_one_look():
    few, many = WorldMap(), WorldMap()
    few.update(level(np.tile([0.52, 0.52], (3, 1)), 0.3), np.ones(3, bool), 1.0, CAMERA)
    many.update(level(np.tile([0.52, 0.52], (900, 1)), 0.3), np.ones(900, bool), 1.0, CAMERA)
    assert many.probability.max() == few.probability[few.known][0]


def test_an_obstacle_that_came_stayed_for_its_share_of_the_frames_wherever_the_map_grew():
    world = WorldMap()
    for k in range(8):
        came = k >= 6
        world.update(level(np.tile([0.52, 0.52], (4, 1))), np.full(4, came), float(k), CAMERA)
        if k == 4:
            world.update(level(np.array([[-9.0, -9.0]])), np.zeros(1, bool), float(k), CAMERA)
    assert world.stay[tuple(world.cell_of(np.array([0.52, 0.52])))] == 2 / 8
    assert world.stay.max() == 2 / 8


def test_looks_that_contradict_each_other_leave_a_doubt_however_many_they_are():
    world = WorldMap()
    for k in range(400):
        raised = k % 2 == 0
        points = level(np.tile([0.52, 0.52], (4, 1)), 0.3 if raised else 0.0)
        world.update(points, np.full(4, raised), float(k), CAMERA)
    assert 0.1 < world.probability[world.known][0] < 0.9


def test_an_uncertain_pose_blurs_the_edge_of_an_obstacle_and_not_its_inside():
    grid = np.stack(np.meshgrid(np.arange(0.01, 1.0, 0.0125), np.arange(0.01, 1.0, 0.0125)), -1)
    xy = grid.reshape(-1, 2)
    flags = xy[:, 0] > 0.5
    points = np.column_stack([xy, np.where(flags, 0.3, 0.0)])
    claims = []
    for sigma_m in (0.0, 0.03):
        world, pose = WorldMap(), Gaussian(np.zeros(3), np.diag([sigma_m**2, sigma_m**2, 0.0]))
        for stamp in range(20):
            world.update(points, flags, float(stamp), CAMERA, pose=pose)
        claims.append(
            [
                float(world.probability[tuple(world.cell_of(np.array([x, 0.5])))])
                for x in (0.525, 0.8)
            ]
        )
    (sure_edge, sure_inside), (edge, inside) = claims
    assert inside == sure_inside
    assert edge < sure_edge - 0.05


def test_a_surface_that_may_be_a_low_obstacle_is_one_as_often_as_claimed():
    """Even odds of floor and of an obstacle of any height up to half a metre, measured with one centimetre."""
    rng = np.random.default_rng(2)
    obstacle = rng.random(200_000) < 0.5
    true = np.where(obstacle, rng.uniform(0.03, 0.5, len(obstacle)), 0.0)
    measured = np.abs(true + rng.normal(0.0, 0.01, len(true)))
    p = low_obstacle(measured.astype(np.float32), np.full(len(true), 1e-4, np.float32))
    for low, high in ((0.0, 0.05), (0.05, 0.3), (0.3, 0.7), (0.7, 0.95), (0.95, 1.01)):
        chosen = (p >= low) & (p < high)
        assert chosen.sum() > 300
        assert np.mean(obstacle[chosen]) == pytest.approx(np.mean(p[chosen]), abs=0.05)


def test_the_height_of_what_looks_like_floor_decides_with_its_doubt():
    sure, unsure = (
        Plane(np.array([0.0, 0.0, 1.0]), 0.0, np.diag([1e-12, 1e-12, v])) for v in (2.5e-5, 9e-4)
    )
    claims = {}
    for name, floor, height_m in (
        ("floor", sure, 0.0),
        ("step", sure, 0.05),
        ("doubt", unsure, 0.05),
    ):
        world = WorldMap()
        for stamp in range(50):
            xy = np.tile([0.52, 0.52], (5, 1))
            world.update(level(xy, height_m), np.zeros(5, bool), float(stamp), CAMERA, floor=floor)
        claims[name] = float(world.probability[world.known][0])
    assert claims["floor"] < 0.02
    assert claims["step"] > 0.95
    assert 0.05 < claims["doubt"] < 0.6


def test_heights_are_means_with_the_variance_that_does_not_average_out():
    rng = np.random.default_rng(1)
    floor = Plane(np.array([0.0, 0.0, 1.0]), 0.0, np.diag([1e-12, 1e-12, 9e-6]))
    world = WorldMap()
    xy = np.tile([0.52, 0.52], (200, 1))
    for stamp in range(40):
        points = np.column_stack([xy, 0.4 + rng.normal(0.0, 0.01, 200)])
        world.update(
            points,
            np.ones(200, bool),
            float(stamp),
            CAMERA,
            sigma_m=np.full(200, 0.01),
            floor=floor,
        )
    cell = tuple(world.cell_of(np.array([0.52, 0.52])))
    assert world.height_m[cell] == pytest.approx(0.4, abs=0.002)
    assert 8.99e-6 < world.height_variance_m2[cell] < 12e-6


def test_a_moving_obstacle_leaves_no_trail_on_floor_that_is_seen_again():
    # A disc walks 2 m through a seen floor; each frame shows the floor it no longer covers.
    rng = np.random.default_rng(6)
    grid, world = EgocentricGrid(GridConfig(), np.zeros(2)), WorldMap()
    for k in range(60):
        centre = np.array([-1.0 + 0.035 * k, 0.1])
        points = rng.uniform(-1.5, 1.5, (20_000, 2))
        distance = np.linalg.norm(points - centre, axis=1)
        flags = distance < 0.15
        grid.update(points, flags, k + 1.0, np.zeros(2), is_moving=flags)
        world.update(level(points, 0.0), flags, k + 1.0, CAMERA, is_moving=flags)
        grid.age(0.3)
        world.age(0.3)
    occupied = grid.known & (grid.probability >= 0.5)
    gap = np.linalg.norm(grid.centres() - centre, axis=-1)
    assert np.all(occupied[gap < 0.10])
    assert not np.any(occupied[gap > 0.23])  # the radius, and the diagonal of a cell
    assert (world.known & (world.probability >= 0.5)).sum() <= 60


def test_outliers_far_away_do_not_enlarge_the_map():
    world = WorldMap(WorldMapConfig(most_cells=90_000))
    near = np.random.default_rng(0).uniform(-1, 1, (300, 2))
    everything = level(np.concatenate([near, [[1e7, 0.0], [0.0, -1e9]]]))
    world.update(everything, np.zeros(302, bool), 1.0, CAMERA)
    assert world.dropped == 2
    assert world.probability.size <= 90_000
    known = world.known.sum()
    world.update(np.array([[1e6, 1e6, 0.0]]), np.zeros(1, bool), 2.0, CAMERA)
    assert world.dropped == 3
    assert world.known.sum() == known


def test_a_map_that_may_not_grow_further_is_still_kept_up_to_date_everywhere():
    # A corridor along x, longer than the limit allows; then something stands at its beginning.
    rng = np.random.default_rng(1)
    world = WorldMap(WorldMapConfig(most_cells=65_536))
    for k in range(60):
        places = np.column_stack([rng.uniform(0.4 * k, 0.4 * k + 1.0, 300), rng.uniform(0, 1, 300)])
        world.update(level(places), np.zeros(300, bool), float(k), CAMERA)
    assert world.dropped > 0
    box = np.tile([0.52, 0.52, 0.2], (5, 1))
    for k in range(20):
        world.update(box, np.ones(5, bool), 100.0 + k, CAMERA)
    cell = tuple(world.cell_of(box[0, :2]))
    assert world.updated_s[cell] == 119.0
    assert world.probability[cell] > 0.5


def test_bad_input_is_refused_with_its_reason():
    with pytest.raises(ConfigError, match=r"cell_m=0\.0 must be positive"):
        WorldMapConfig(cell_m=0.0)
    with pytest.raises(ConfigError, match="most_cells=10"):
        WorldMapConfig(most_cells=10)
    with pytest.raises(InputError, match="2 points but 1 flags"):
        unwrap(WorldMap.update)(  # without the check of shapes
            WorldMap(), np.zeros((2, 3)), np.zeros(1, bool), 1.0, CAMERA
        )


def test_claims_at_the_face_of_a_wall_are_as_often_right_as_they_say():
    """Thick walls that begin anywhere in a cell, with depth noise, and a pose error that lasts over all looks."""
    rng = np.random.default_rng(3)
    claims, truth = [], []
    for _ in range(400):
        face_m, error_m = 1.0 + rng.uniform(-0.05, 0.05), rng.normal(0.0, 0.01)
        noise_m = rng.uniform(0.003, 0.02)
        world, pose = WorldMap(), Gaussian(np.zeros(3), np.diag([1e-4, 1e-4, 0.0]))
        for stamp in range(5):
            x = face_m + error_m + rng.normal(0.0, noise_m, 600)
            wall = np.column_stack([x, rng.uniform(0.2, 0.35, 600), np.full(600, 0.3)])
            before = rng.uniform(0.7, 1.1, 400)
            floor = level(np.column_stack([before, rng.uniform(0.2, 0.35, 400)]))
            points = np.concatenate([wall, floor[before < face_m + error_m]])
            is_obstacle = np.arange(len(points)) < 600
            sigma = np.full(len(points), noise_m)
            world.update(points, is_obstacle, float(stamp), CAMERA, sigma_m=sigma, pose=pose)
        for cell in range(17, 23):
            row, column = world.cell_of(np.array([(cell + 0.5) * CELL_M, 0.275]))
            if column < world.known.shape[1] and world.known[row, column]:
                claims.append(world.probability[row, column])
                truth.append(cell >= np.floor(face_m / CELL_M))
    p, occupied = np.array(claims), np.array(truth)
    assert np.mean(occupied[p < 0.25]) < 0.1
    claimed = (p > 0.75) & (p < 0.9)
    assert claimed.sum() > 100
    assert np.mean(occupied[claimed]) == pytest.approx(np.mean(p[claimed]), abs=0.15)
    assert np.mean(occupied[p > 0.9]) > 0.9


def test_a_thin_leg_in_front_of_a_wall_stays_in_the_map():
    """A leg has fewer points than the wall behind it, but more than noise."""
    world = WorldMap()
    wall = np.column_stack([np.full(400, 1.02), np.repeat(np.arange(0.005, 0.05, 0.005), 45)[:400]])
    leg = np.column_stack([np.full(60, 0.96), np.full(60, 0.02)])
    points = level(np.concatenate([wall, leg]), 0.3)
    for stamp in (1.0, 2.0):
        world.update(points, np.ones(460, bool), stamp, CAMERA, sigma_m=np.full(460, 0.005))
    assert world.probability[tuple(world.cell_of(np.array([0.96, 0.02])))] > 0.85
