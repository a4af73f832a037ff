"""The functions of the public library against geometry that is known."""

from __future__ import annotations

import heapq
import itertools
import math

import numpy as np
import pytest
from scipy.ndimage import maximum_filter, minimum_filter

import surefoot
from perception.depth.distortion import DistortionConfig
from perception.primitives.pose import head_rotation
from surefoot.config.schema import CALIBRATED_DISTORTION

CAMERA = surefoot.Camera.from_view(160, 120, 1.0, 0.8)
HEIGHT_M, TILT_RAD = 0.9, 0.5
UP = head_rotation(0.0, TILT_RAD).T @ np.array([0.0, 0.0, 1.0])
BOX = (1.4, 0.10, 0.40)  # x of the front, half width, height, m


def scene(box: bool = False, seed: int = 0, noise: bool = True) -> np.ndarray:
    """Depth of a floor 0.9 m below a camera that looks 0.5 rad down, perhaps with a box ahead, m."""
    rays = CAMERA.rays @ head_rotation(0.0, TILT_RAD).T
    with np.errstate(divide="ignore"):
        depth = HEIGHT_M / -rays[..., 2]
    depth[(depth < 0.0) | (depth > 4.0)] = np.nan
    if box:
        front, half, top = BOX
        hit = front / rays[..., 0]
        z = HEIGHT_M + hit * rays[..., 2]
        on = (np.abs(hit * rays[..., 1]) < half) & (z > 0.0) & (z < top)
        depth = np.where(on, np.fmin(depth, hit), depth)
    if noise:
        sigma = 0.0012 + 0.0019 * (depth - 0.4) ** 2
        depth = depth + sigma * np.random.default_rng(seed).normal(size=depth.shape)
    return depth


@pytest.mark.parametrize("up", [None, tuple(UP)])
def test_the_floor_is_the_true_plane_within_its_covariance(up):
    true = surefoot.Plane(UP, HEIGHT_M)
    for seed in range(5):
        found = surefoot.find_floor(scene(seed=seed), CAMERA, up)
        assert found is not None
        error = found.error_to(true)
        assert error @ np.linalg.solve(found.covariance, error) < 16.3  # chi-square, 3, 0.999
        assert found.angle_to(true) < math.radians(0.2)
        assert found.offset_m == pytest.approx(HEIGHT_M, abs=0.01)


@pytest.mark.parametrize("seed", range(3))
def test_the_floor_of_a_camera_with_eight_times_the_noise_is_found(seed):
    rng, true = np.random.default_rng(seed), surefoot.Plane(UP, HEIGHT_M)
    depth = scene(noise=False)
    depth = depth + 8.0 * (0.0012 + 0.0019 * (depth - 0.4) ** 2) * rng.normal(size=depth.shape)
    found = surefoot.find_floor(depth, CAMERA)
    assert found is not None
    error = found.error_to(true)
    assert error @ np.linalg.solve(found.covariance, error) < 16.3  # chi-square, 3, 0.999
    assert found.angle_to(true) < math.radians(1.0)


@pytest.mark.parametrize(
    ("calibrated", "kind"),
    [(True, CALIBRATED_DISTORTION.depth), (False, DistortionConfig().depth)],
)
def test_the_covariance_of_a_floor_is_that_of_depth_that_bends_as_it_should(calibrated, kind):
    true, depth, sigma_m = surefoot.Plane(UP, HEIGHT_M), scene(noise=False), 0.003
    u, v = (np.broadcast_to(one, depth.shape).ravel() for one in CAMERA.slopes)
    field = kind.field(u, v, depth.ravel(), np.full(depth.size, sigma_m), float(u.max()))
    squares, deviations = [], []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        bend = (field @ rng.normal(size=field.shape[1])).reshape(depth.shape)
        seen = depth * (1.0 + bend) + sigma_m * rng.normal(size=depth.shape)
        found = surefoot.find_floor(seen, CAMERA, UP, sigma_m=sigma_m, calibrated=calibrated)
        assert found is not None
        error = found.error_to(true)
        squares.append(error @ np.linalg.solve(found.covariance, error) / 3.0)
        deviations.append(np.sqrt(found.covariance[2, 2]))
    assert 0.2 < np.mean(squares) < 2.0
    assert np.mean(deviations) < 0.002 if calibrated else np.mean(deviations) > 0.008


@pytest.mark.parametrize("sensor", ["depth", "tof", "stereo"])
def test_the_covariances_of_floor_and_regions_are_those_of_the_distortion_of_the_sensor(sensor):
    true, depth = surefoot.Plane(UP, HEIGHT_M), scene(noise=False)
    sigma_m = 0.008 if sensor == "stereo" else 0.003
    u, v = (np.broadcast_to(one, depth.shape).ravel() for one in CAMERA.slopes)
    noise = np.full(depth.size, sigma_m)
    field = DistortionConfig().of(sensor).field(u, v, depth.ravel(), noise, float(u.max()))
    squares: dict[str, list[float]] = {"floor": [], "region": []}
    for seed in range(30):
        rng = np.random.default_rng(seed)
        bend = (field @ rng.normal(size=field.shape[1])).reshape(depth.shape)
        seen = depth * (1.0 + bend) + sigma_m * rng.normal(size=depth.shape)
        floor = surefoot.find_floor(seen, CAMERA, UP, sigma_m=sigma_m, sensor=sensor)
        regions = surefoot.find_regions(seen, CAMERA, sigma_m=sigma_m, sensor=sensor)
        assert floor is not None
        for name, plane in (("floor", floor), ("region", regions[0].plane)):
            error = plane.error_to(true)
            squares[name].append(error @ np.linalg.solve(plane.covariance, error) / 3.0)
    for name, values in squares.items():
        assert 0.5 < np.mean(values) < 2.0, name


def test_the_noise_of_a_time_of_flight_camera_is_that_of_its_ranges():
    true, depth = surefoot.Plane(UP, HEIGHT_M), scene(noise=False)
    x, y = CAMERA.slopes
    along = 1.0 / np.sqrt(1.0 + x**2 + y**2)
    sigma_m = np.hypot(0.005, 0.004 * (depth / along / 1.3) ** 2) * along  # SR-4000, as documented
    found = surefoot.find_floor(depth, CAMERA, UP, sensor="tof", calibrated=True)
    given = surefoot.find_floor(depth, CAMERA, UP, sensor="tof", calibrated=True, sigma_m=sigma_m)
    other = surefoot.find_floor(depth, CAMERA, UP, calibrated=True)
    assert found is not None
    assert given is not None
    assert other is not None
    np.testing.assert_allclose(found.covariance, given.covariance, rtol=0.1, atol=1e-12)
    assert not np.allclose(found.covariance, other.covariance, rtol=0.3, atol=1e-12)
    assert found.angle_to(true) < math.radians(0.3)


def test_the_noise_of_stereo_must_be_given():
    with pytest.raises(surefoot.InputError, match="needs sigma_m"):
        surefoot.find_floor(scene(), CAMERA, UP, sensor="stereo")


def test_a_known_mount_gives_the_floor_in_the_same_frame():
    mount = surefoot.Pose3.from_rotation(head_rotation(0.0, TILT_RAD), np.array([0, 0, HEIGHT_M]))
    found = surefoot.find_floor(scene(), CAMERA, T_body_camera=mount)
    assert found is not None
    np.testing.assert_allclose(found.normal, UP, atol=0.005)


def test_integer_depth_with_its_scale_gives_the_same_floor():
    millimetres = np.nan_to_num(1000.0 * scene()).round().astype(np.uint16)
    found = surefoot.find_floor(millimetres, CAMERA, scale_per_metre=1000.0)
    assert found is not None
    assert found.offset_m == pytest.approx(HEIGHT_M, abs=0.01)


def test_a_road_before_a_far_hill_is_found_once_its_unit_is_stated():
    """A stereo pair of a car, 1.65 m above the road; most pixels show what is 60 m away."""
    camera = surefoot.Camera(310, 94, 180.0, 180.0, 155.0, 47.0)
    down = camera.rays[..., 1]
    with np.errstate(divide="ignore"):
        depth = np.where(down > 0.1, 1.65 / down, 60.0)
    sigma = 0.01 + 1e-3 * depth**2 / 4.0
    depth = depth + sigma * np.random.default_rng(0).normal(size=depth.shape)
    given = {"sigma_m": sigma, "sensor": "stereo", "farthest_m": 15.0}
    with pytest.raises(surefoot.InputError, match="1 if floats are metres"):
        surefoot.find_floor(depth, camera, **given)
    found = surefoot.find_floor(depth, camera, scale_per_metre=1.0, **given)
    assert found is not None
    assert found.offset_m == pytest.approx(1.65, abs=0.03)
    with pytest.raises(surefoot.InputError, match="1000 if the values are millimetres"):
        surefoot.find_floor(
            (1000.0 * depth).astype(np.uint16), camera, scale_per_metre=1.0, **given
        )


def test_no_floor_in_a_wall():
    wall = np.full((120, 160), 1.5)
    assert surefoot.find_floor(wall, CAMERA, UP) is None
    assert surefoot.find_obstacles(wall, CAMERA, up=UP) is None


@pytest.mark.parametrize(
    ("depth", "camera", "message"),
    [
        (np.ones((120, 160), np.uint16), CAMERA, "scale_per_metre"),
        (1000.0 * np.ones((120, 160)), CAMERA, "millimetres"),
        (np.ones((60, 160)), CAMERA, r"expects \(120, 160\)"),
        (np.ones((120, 160, 3)), CAMERA, "expected"),
        (np.ones((120, 160), bool), CAMERA, "expected"),
    ],
)
def test_a_wrong_depth_image_is_refused_with_what_was_expected(depth, camera, message):
    with pytest.raises(surefoot.InputError, match=message):
        surefoot.find_floor(depth, camera)


def test_a_camera_with_nan_is_refused():
    with pytest.raises(surefoot.InputError, match="fx"):
        surefoot.Camera(160, 120, math.nan, 100.0, 80.0, 60.0)


def test_a_box_on_the_floor_is_found_at_its_place():
    found = surefoot.find_obstacles(scene(box=True), CAMERA)
    assert found is not None
    assert len(found) == 1
    (box,) = found
    front, half, top = BOX
    assert box.placed
    assert box.height_m == pytest.approx(top, abs=0.03)
    assert box.footprint.length_m == pytest.approx(2 * half, abs=0.03)
    assert abs(box.centre[1]) < 0.02
    assert front - 0.02 < box.centre[0] < front + half  # only the front is seen
    again = surefoot.find_obstacles(
        scene(box=True), CAMERA, surefoot.find_floor(scene(box=True), CAMERA)
    )
    assert again is not None
    np.testing.assert_allclose(again[0].centre, box.centre, atol=0.01)


@pytest.mark.parametrize(
    ("kept", "lost", "placed"),
    [
        ((0.15, 0.2), (-0.3, 0.3), False),  # a strip of its front alone, nothing beside it
        ((-0.2, 0.1), (-0.3, 0.3), False),  # without its right end
        ((-0.2, 0.2), (-0.3, 0.2), True),  # the shadow of a pair of cameras 0.1 m apart on its left
        ((-0.2, 0.2), None, True),  # nothing behind it in range, but floor in front of that
    ],
)
def test_an_object_whose_end_lies_in_a_hole_of_the_depth_is_not_placed(kept, lost, placed):
    """A hole wider than the cameras are apart is no shadow: the object may go on in it."""
    depth = scene()
    rays = CAMERA.rays @ head_rotation(0.0, TILT_RAD).T
    hit = BOX[0] / rays[..., 0]
    right, z = -hit * rays[..., 1], HEIGHT_M + hit * rays[..., 2]
    level = (z > 0.0) & (z < BOX[2])
    if lost is None:
        depth[depth > 2.2] = np.nan
    else:
        depth[level & (right > lost[0]) & (right < lost[1])] = np.nan
    depth = np.where(level & (right > kept[0]) & (right < kept[1]), hit, depth)
    (found,) = surefoot.find_obstacles(depth, CAMERA, baseline_m=0.1)
    assert found.placed == placed


def test_no_obstacles_on_an_empty_floor():
    assert surefoot.find_obstacles(scene(), CAMERA) == []


def seen_from_above(kind: str, x: float, y: float, half: tuple[float, float], top: float, rng):
    """Depth of a floor with a box (half sides) or a cylinder (radius), 1.2 m below a camera that looks 0.6 rad down."""
    camera = surefoot.Camera.from_view(320, 240, 1.05, 0.85)
    rays = camera.rays @ head_rotation(0.0, 0.6).T
    height = 1.2
    with np.errstate(divide="ignore", invalid="ignore"):
        floor, lid = height / -rays[..., 2], (height - top) / -rays[..., 2]
        if kind == "box":
            sides = [
                ((c - h) / r, (c + h) / r)
                for c, h, r in ((x, half[0], rays[..., 0]), (y, half[1], rays[..., 1]))
            ]
            enter = np.maximum.reduce([np.minimum(*side) for side in (*sides, (floor, lid))])
            leave = np.minimum.reduce([np.maximum(*side) for side in (*sides, (floor, lid))])
            body = np.where((enter < leave) & (enter > 0.0), enter, np.inf)
        else:
            a, b = rays[..., 0] ** 2 + rays[..., 1] ** 2, rays[..., 0] * x + rays[..., 1] * y
            root = np.sqrt(b**2 - a * (x**2 + y**2 - half[0] ** 2))
            side = np.where(height + (b - root) / a * rays[..., 2] < top, (b - root) / a, lid)
            body = np.where((side < (b + root) / a) & (side > 0.0), side, np.inf)
    z = np.fmin(np.where(floor > 0.0, floor, np.inf), body)
    z = np.where(z < 4.0, z, np.nan)
    return camera, z + (0.0012 + 0.0019 * (z - 0.4) ** 2) * rng.normal(size=z.shape)


@pytest.mark.parametrize("kind", ["box", "cylinder"])
def test_the_centre_of_an_object_whose_top_is_seen_is_that_of_its_outline(kind):
    errors, squares = [], []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        place, half = (
            np.array([rng.uniform(1.1, 2.0), rng.uniform(-0.4, 0.4)]),
            rng.uniform(0.06, 0.2, 2),
        )
        camera, depth = seen_from_above(kind, *place, half, rng.uniform(0.1, 0.6), rng)
        (found,) = surefoot.find_obstacles(depth, camera)
        assert found.placed
        error = found.centre - place
        errors.append(float(error @ place) / math.hypot(*place))
        squares.append(error @ np.linalg.solve(found.covariance, error) / 2.0)
    assert abs(np.mean(errors)) < 0.015
    assert np.sqrt(np.mean(np.square(errors))) < 0.03
    assert np.mean(squares) < 1.5


def test_mixed_pixels_at_edges_do_not_make_an_obstacle_larger():
    """Seven of ten pixels at a jump of depth lie anywhere between both sides, as a time-of-flight camera gives them."""
    sizes, squares = [], []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        place, radius = np.array([rng.uniform(1.1, 1.8), rng.uniform(-0.3, 0.3)]), 0.15
        camera, depth = seen_from_above("cylinder", *place, np.full(2, radius), 0.5, rng)
        whole = np.nan_to_num(depth, nan=4.0)
        low, high = minimum_filter(whole, 3), maximum_filter(whole, 3)
        mixed = (high - low > 0.1 * low) & (rng.random(depth.shape) < 0.7)
        depth[mixed] = rng.uniform(low, high)[mixed]
        (found,) = surefoot.find_obstacles(depth, camera)
        sizes.append(found.radius_m - radius)
        error = found.centre - place
        squares.append(error @ np.linalg.solve(found.covariance, error) / 2.0)
    assert abs(np.mean(sizes)) < 0.02
    assert np.mean(squares) < 2.0


@pytest.mark.parametrize(("ahead_m", "placed"), [(1.0, True), (0.6, False)])
def test_an_obstacle_whose_front_lies_below_the_image_is_not_placed(ahead_m, placed):
    """A box 0.3 m deep; the lowest row looks at the height of its top 0.52 m ahead."""
    rng = np.random.default_rng(0)
    camera, depth = seen_from_above("box", ahead_m, 0.0, (0.15, 0.2), 0.35, rng)
    (found,) = surefoot.find_obstacles(depth, camera)
    assert found.placed == placed
    error = found.centre - [ahead_m, 0.0]
    assert error @ np.linalg.solve(found.covariance, error) < 4.0


def test_the_footprint_of_a_block_is_its_rectangle():
    x, y, z = np.meshgrid(
        np.arange(1, 1.51, 0.02), np.arange(0, 0.31, 0.02), np.arange(0.02, 0.4, 0.02)
    )
    (found,) = surefoot.find_footprints(np.stack([x, y, z], axis=-1).reshape(-1, 3))
    assert found.box is not None
    np.testing.assert_allclose(found.box.centre, [1.25, 0.15], atol=0.02)
    assert found.box.length_m == pytest.approx(0.5, abs=0.03)
    assert found.box.width_m == pytest.approx(0.3, abs=0.03)
    assert found.seen.all()
    with pytest.raises(surefoot.InputError, match=r"\(n, 3\)"):
        surefoot.find_footprints(np.zeros((5, 2)))
    with pytest.raises(surefoot.InputError, match=r"expected \(5, 2\)"):
        surefoot.find_footprints(np.zeros((5, 3)), sensor_m=np.zeros((4, 2)))


def test_two_faces_are_a_box_from_outside_and_a_corner_from_inside():
    along, height = np.arange(0, 1.0, 0.02), np.arange(0.02, 0.4, 0.02)
    one = np.array([(x, 0.0, z) for x in along for z in height])
    other = np.array([(0.0, y, z) for y in along for z in height])
    points = np.concatenate([one, other])
    outside, within = (np.tile([s, s], (len(points), 1)) for s in (-1.5, 0.8))
    (box,) = surefoot.find_footprints(points, sensor_m=outside)
    assert box.box is not None
    assert box.seen.sum() == 2
    corner = surefoot.find_footprints(points, sensor_m=within)
    assert len(corner) == 2
    assert all(one.box.width_m < 0.05 for one in corner)


def test_stereo_depth_is_that_of_a_textured_plane_within_its_sigma():
    rng = np.random.default_rng(1)
    texture = rng.integers(0, 256, (120, 220), np.uint8)
    shift = 12  # px: Z = f B / d
    left, right = texture[:, 20:180], texture[:, 20 + shift : 180 + shift]
    camera = surefoot.Camera(160, 120, 200.0, 200.0, 79.5, 59.5)
    found = surefoot.stereo_depth(left, right, camera, 0.06)
    true = 200.0 * 0.06 / shift
    inner = found.depth_m[10:-10, 40:-10]
    assert np.isfinite(inner).mean() > 0.95
    errors = np.abs(inner - true) / found.sigma_m[10:-10, 40:-10]
    assert np.nanmean(errors < 2.0) > 0.95
    assert 0.0 <= found.reliability.min() <= found.reliability.max() <= 1.0
    with pytest.raises(surefoot.InputError, match="uint8"):
        surefoot.stereo_depth(left.astype(float), right, camera, 0.06)


def test_the_gaze_turns_to_the_obstacle_that_is_vague_fast_and_near():
    vague = np.diag([0.02, 0.02])
    found = surefoot.gaze_map(
        (1.0, -0.1),
        [(0.7, 0.7), (0.8, -0.8)],
        [(0.0, -0.1), (0.0, 0.0)],
        [vague, vague],
        way_weight=0.05,
    )
    psi = math.sqrt(0.02) * 0.1 / math.hypot(0.7, 0.7) / 0.02  # eq. (3)
    assert found.psi_obstacles.tolist() == pytest.approx([psi, 0.0])  # the second one stands
    assert found.best.pan_rad > math.radians(20.0)
    assert found.values.shape == (len(found.pans_rad), len(found.tilts_rad))
    assert found.values.max() == pytest.approx(
        found.values[
            np.argmin(np.abs(found.pans_rad - found.best.pan_rad)),
            np.argmin(np.abs(found.tilts_rad - found.best.tilt_rad)),
        ]
    )


def test_without_obstacles_the_gaze_shows_the_waypoint():
    found = surefoot.gaze_map((1.0, 0.3))
    axes = head_rotation(found.best.pan_rad, found.best.tilt_rad)
    right, down, ahead = axes.T @ np.array([1.0, 0.3, -0.38])
    assert abs(right / ahead) < math.tan(math.radians(22.0))
    assert abs(down / ahead) < math.tan(math.radians(17.5))


def test_gaze_input_of_the_wrong_shape_is_refused():
    with pytest.raises(surefoot.InputError, match="waypoint"):
        surefoot.gaze_map((1.0, 0.0, 0.0))
    with pytest.raises(surefoot.InputError, match="covariances"):
        surefoot.gaze_map((1.0, 0.0), [(1.0, 0.0)])
    with pytest.raises(surefoot.InputError, match="unknown setting"):
        surefoot.gaze_map((1.0, 0.0), colour="red")


def dijkstra_cost(price: np.ndarray, blocked: np.ndarray, start: tuple, goal: tuple) -> float:
    """Least cost on the 8-neighbour lattice, by Dijkstra's method."""
    done: set[tuple] = set()
    queue = [(0.0, start)]
    while queue:
        cost, node = heapq.heappop(queue)
        if node == goal:
            return cost
        if node in done:
            continue
        done.add(node)
        for dr in (-1, 0, 1):
            for dc in (-1, 0, 1):
                r, c = node[0] + dr, node[1] + dc
                inside = 0 <= r < price.shape[0] and 0 <= c < price.shape[1]
                if inside and not blocked[r, c] and (dr or dc):
                    step = math.hypot(dr, dc) * (price[node] + price[r, c]) / 2.0
                    heapq.heappush(queue, (cost + step, (r, c)))
    return math.inf


def test_the_path_costs_no_more_than_dijkstras_and_keeps_clear():
    from planning.search.astar import prepare
    from planning.search.potential import SearchConfig

    occupied = np.zeros((60, 80), bool)
    occupied[20:45, 40] = True
    start, goal = np.array([0.52, 1.53]), np.array([3.52, 1.53])
    path = surefoot.find_path(occupied, 0.05, start, goal)
    assert path is not None
    np.testing.assert_allclose(path[[0, -1]], [start, goal])
    terrain = prepare(
        occupied.astype(float), np.zeros_like(occupied), np.zeros(2), 0.05, start, SearchConfig()
    )
    best = 0.05 * dijkstra_cost(terrain.price, terrain.blocked, (30, 10), (30, 70))
    assert terrain.cost_m(path) <= best + 0.05  # ends lie inside their cells, not at the centres
    walls = (np.argwhere(occupied)[:, ::-1] + 0.5) * 0.05
    dense = np.concatenate([np.linspace(a, b, 50) for a, b in itertools.pairwise(path)])
    apart = np.linalg.norm(dense[:, None] - walls, axis=2).min()
    assert apart > 0.16 - 0.025 * math.sqrt(2.0)  # body radius less half a cell's diagonal


@pytest.mark.parametrize("place", [(0.5, 0.5), (0.5, 0.525), (0.51, 0.51), (0.549, 0.5)])
def test_a_path_begins_and_ends_at_the_given_points_also_on_borders_of_cells(place):
    goal = (1.5 + place[0], 1.0 + place[1])
    path = surefoot.find_path(np.zeros((60, 60)), 0.05, place, goal)
    np.testing.assert_allclose(path[[0, -1], :2], [place, goal], atol=1e-9)


def test_no_path_through_a_closed_wall():
    occupied = np.zeros((40, 40), bool)
    occupied[:, 20] = True
    assert surefoot.find_path(occupied, 0.05, (0.4, 1.0), (1.7, 1.0)) is None


def test_unknown_cells_are_nan_and_can_be_crossed():
    cells = np.zeros((40, 40))
    cells[:, 20] = np.nan
    assert surefoot.find_path(cells, 0.05, (0.4, 1.0), (1.7, 1.0)) is not None


def test_a_map_of_integers_is_refused():
    with pytest.raises(surefoot.InputError, match="probabilities"):
        surefoot.find_path(np.zeros((40, 40), np.int8), 0.05, (0.4, 1.0), (1.7, 1.0))
