"""Both searches choose the floor by the prior and the points below it, not by its size."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy import stats

from perception.depth.distortion import Distortion, DistortionConfig
from perception.depth.points import Points
from perception.floor.choose import FloorConfig, find, find_lower
from perception.floor.prior import handheld_prior, kinematic_prior
from perception.primitives.errors import ConfigError
from perception.primitives.plane import Plane

METHODS = ("ransac", "hough")
CRATES = ((0.9, 1.2, -0.5, -0.1, 0.0, 0.25), (1.4, 1.7, 0.2, 0.6, 0.0, 0.45))


def off(found, true):
    """Angle in degrees and height in mm."""
    return np.degrees(found.angle_to(true)), 1e3 * abs(found.offset_m - true.offset_m)


def bent_points(points, size, rng):
    """The points with a random smooth error of depth of a given size: a quadric of the slopes for each part."""
    z = points.xyz[:, 2]
    u, v = (points.xyz[:, axis] / z for axis in (0, 1))
    u, v = u / np.abs(u).max(), v / np.abs(u).max()
    quadric = np.column_stack([np.ones_like(u), u, v, u * u, u * v, v * v])
    error = sum(
        part * growth * (quadric @ rng.normal(size=6))
        for part, growth in (
            (size.offset_m, 1.0 / z),
            (size.share, 1.0),
            (size.share_per_m, z),
            (size.noises, points.sigma / z),
        )
    )
    return Points(points.xyz * (1.0 + error)[:, None], points.sigma, points.pixels)


@pytest.fixture(params=METHODS)
def config(request):
    return FloorConfig(method=request.param)


@pytest.mark.parametrize("seed", range(4))
def test_the_floor_under_crates_is_found_to_a_fraction_of_a_degree(look, config, seed):
    room = look(seed, boxes=CRATES)
    found = find(room.points, handheld_prior(None), np.random.default_rng(seed), config)
    angle, height = off(found.plane, room.floor)
    assert angle < 0.1  # bar of the field: 0.02 deg and 0.3 mm with 16 times the points
    assert height < 1.0
    assert found.plane.normal @ room.floor.normal > 0.0


@pytest.mark.parametrize("distance", np.linspace(1.8, 2.5, 8))
def test_facing_a_wall_the_floor_is_found_and_never_the_wall(look, config, distance):
    room = look(3, height_m=1.2, pitch_deg=18.0, wall_m=float(distance))
    assert np.mean(room.height > 0.02) > 0.6  # the wall is the larger plane
    for prior in (handheld_prior(None), kinematic_prior(room.T_body_camera, 0.02, 0.01)):
        found = find(room.points, prior, np.random.default_rng(0), config)
        angle, height = off(found.plane, room.floor)
        assert angle < 0.5
        assert height < 5.0


def test_a_table_larger_than_the_floor_is_not_the_floor(look, config):
    table = (0.5, 2.8, -2.0, 0.6, 0.70, 0.73)
    room = look(1, height_m=1.4, pitch_deg=40.0, boxes=(table,))
    assert np.mean(np.abs(room.height - 0.73) < 0.01) > 1.5 * np.mean(room.height < 0.01)
    found = find(room.points, handheld_prior(None), np.random.default_rng(0), config)
    angle, height = off(found.plane, room.floor)
    assert angle < 0.5
    assert height < 5.0


def test_without_a_floor_in_view_none_is_found(look, config):
    wall_alone = look(0, height_m=1.2, pitch_deg=0.0, wall_m=1.5, with_floor=False)
    rng = np.random.default_rng(0)
    assert find(wall_alone.points, handheld_prior(None), rng, config) is None
    prior = kinematic_prior(wall_alone.T_body_camera, 0.02, 0.01)
    assert find(wall_alone.points, prior, rng, config) is None


def test_a_shelf_with_points_below_it_is_not_a_floor(look, config):
    boards = tuple((1.0, 1.5, -0.6, 0.6, z, z + 0.02) for z in (0.3, 0.6, 0.9))
    room = look(0, height_m=1.3, pitch_deg=30.0, boxes=boards, wall_m=1.5, with_floor=False)
    found = find(room.points, handheld_prior(None), np.random.default_rng(0), config)
    assert found is None or abs(1.3 - found.plane.offset_m) < 0.35  # at most the lowest board


def test_the_joint_angles_keep_the_floor_at_the_edge_of_a_step_down(look, config):
    room = look(2, pitch_deg=35.0)
    x, n = room.T_body_camera.apply(room.points.xyz)[:, 0], len(room.points)
    rays = room.points.xyz * (0.70 / 0.40)  # the same rays, down to a bottom 0.3 m below
    deep = x > 0.7
    assert np.mean(deep) > 0.3
    points = Points(np.where(deep[:, None], rays, room.points.xyz), room.points.sigma, np.arange(n))
    prior = kinematic_prior(room.T_body_camera, 0.02, 0.01)
    found = find(points, prior, np.random.default_rng(0), config)
    angle, height = off(found.plane, room.floor)
    assert angle < 0.3
    assert height < 3.0
    assert found.below_share > 0.25


def test_a_rolled_camera_finds_the_floor(look, config):
    room = look(5, height_m=0.3, pitch_deg=35.0, roll_deg=20.0)
    found = find(room.points, handheld_prior(None), np.random.default_rng(0), config)
    assert off(found.plane, room.floor)[0] < 0.2


def test_the_same_seed_gives_the_same_bits(look, config):
    room = look(0, boxes=CRATES)
    planes = [
        find(room.points, handheld_prior(None), np.random.default_rng(7), config).plane
        for _ in range(2)
    ]
    np.testing.assert_array_equal(planes[0].normal, planes[1].normal)
    np.testing.assert_array_equal(planes[0].covariance, planes[1].covariance)
    assert planes[0].offset_m == planes[1].offset_m


def test_the_order_of_the_points_does_not_matter(look, config):
    room = look(0, boxes=CRATES)
    order = np.random.default_rng(1).permutation(len(room.points))
    shuffled = Points(room.points.xyz[order], room.points.sigma[order], room.points.pixels[order])
    one, other = (
        find(points, handheld_prior(None), np.random.default_rng(7), config).plane
        for points in (room.points, shuffled)
    )
    assert np.degrees(one.angle_to(other)) < 0.01
    assert abs(one.offset_m - other.offset_m) < 1e-4


def test_both_methods_find_the_same_plane(look):
    for seed in range(5):
        room = look(seed, height_m=0.3 + 0.2 * seed, pitch_deg=20.0 + 5.0 * seed, boxes=CRATES)
        one, other = (
            find(
                room.points,
                handheld_prior(None),
                np.random.default_rng(seed),
                FloorConfig(method=method),
            ).plane
            for method in METHODS
        )
        assert np.degrees(one.angle_to(other)) < 0.01
        assert abs(one.offset_m - other.offset_m) < 1e-4


def test_the_covariance_of_a_calibrated_camera_is_consistent_with_the_error(look, config):
    left = Distortion(share=0.001)
    config = dataclasses.replace(config, distortion=DistortionConfig(depth=left))
    squares = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        room = look(
            seed,
            height_m=rng.uniform(0.35, 1.2),
            pitch_deg=rng.uniform(15.0, 45.0),
            boxes=CRATES[:1],
            reach_m=4.0,
            size=(100, 75),
        )
        found = find(bent_points(room.points, left, rng), handheld_prior(None), rng, config)
        e = found.plane.error_to(room.floor)
        squares.append(float(e @ np.linalg.solve(found.plane.covariance, e)) / 3.0)
    assert 0.4 < np.mean(squares) < 1.5


def test_a_distant_strip_of_floor_is_fused_with_the_joint_angles(look):
    room = look(0, pitch_deg=0.0, reach_m=3.5)
    far = room.points.xyz[:, 2] > 3.0
    sliver = Points(room.points.xyz[far], room.points.sigma[far], room.points.pixels[far])
    prior = kinematic_prior(room.T_body_camera, np.radians(1.2), 0.01)
    found = find(sliver, prior, np.random.default_rng(0))
    for i in range(3):
        assert found.plane.covariance[i, i] <= prior.covariance[i, i] * (1 + 1e-9)
    assert off(found.plane, room.floor)[0] < 1.0


def test_too_few_points_give_no_floor(look):
    room = look(0)
    few = Points(room.points.xyz[:60], room.points.sigma[:60], room.points.pixels[:60])
    none = Points(room.points.xyz[:0], room.points.sigma[:0], room.points.pixels[:0])
    for points in (few, none):
        assert find(points, handheld_prior(None), np.random.default_rng(0)) is None


def test_an_invalid_configuration_is_refused_with_a_message():
    with pytest.raises(ConfigError, match="choose ransac, hough, printed"):
        FloorConfig(method="least squares")


def test_at_a_step_up_the_floor_is_chosen_and_not_the_larger_landing(look, config):
    landing = (0.75, 6.0, -5.0, 5.0, 0.0, 0.14)
    for seed in range(3):
        room = look(seed, height_m=0.6, pitch_deg=35.0, boxes=(landing,))
        assert np.mean(room.height > 0.1) > np.mean(room.height < 0.01)
        prior = kinematic_prior(room.T_body_camera, np.radians(1.2), 0.01)
        found = find(room.points, prior, np.random.default_rng(seed), config)
        angle, height = off(found.plane, room.floor)
        assert angle < 0.5
        assert height < 5.0


@pytest.mark.parametrize("camera_m", [0.07, 0.2, 0.6, 1.8])
def test_cameras_from_ankle_to_head_height_find_their_floor(look, config, camera_m):
    near = 4.0 * camera_m
    box = (near, near + 0.3, -0.2, 0.2, 0.0, 0.3)
    room = look(1, height_m=camera_m, pitch_deg=20.0, boxes=(box,), reach_m=4.0)
    for prior in (handheld_prior(None), kinematic_prior(room.T_body_camera, 0.02, 0.01)):
        found = find(room.points, prior, np.random.default_rng(0), config)
        angle, height = off(found.plane, room.floor)
        assert angle < 0.3
        assert height < 2.0


def test_the_second_plane_is_taken_if_the_first_is_not_a_floor(look):
    ramp_like = (0.7, 6.0, -5.0, 5.0, 0.0, 0.3)
    room = look(0, height_m=0.6, pitch_deg=40.0, boxes=(ramp_like,))
    prior = kinematic_prior(
        room.T_body_camera, np.radians(8.0), 0.12
    )  # the landing is within reach
    found = find(room.points, prior, np.random.default_rng(0))
    assert abs(found.plane.offset_m - 0.6) < 0.01


@pytest.mark.parametrize("ramp_deg", [8.0, 10.0, 12.0])
@pytest.mark.parametrize("seed", range(4))
def test_the_floor_before_a_ramp_is_chosen_and_not_the_larger_ramp(look, ramp_deg, seed):
    room = look(seed, height_m=1.0, pitch_deg=35.0, reach_m=4.0)
    T, slope = room.T_body_camera, np.tan(np.radians(ramp_deg))
    rays = (room.points.xyz / room.points.xyz[:, 2:]) @ T.rotation.T
    floor = -T.position[2] / rays[:, 2]
    ramp = (slope * (T.position[0] - 1.2) - T.position[2]) / (rays[:, 2] - slope * rays[:, 0])
    z = np.where(ramp > 0.0, np.minimum(floor, ramp), floor)
    rng = np.random.default_rng([seed, 7])
    z = z + room.points.sigma * rng.normal(size=len(z))
    points = Points(rays @ T.rotation * z[:, None], room.points.sigma, room.points.pixels)
    found = find(points, handheld_prior(room.floor.normal), rng)
    e = found.plane.error_to(room.floor)
    assert float(e @ np.linalg.solve(found.plane.covariance, e)) < stats.chi2.ppf(0.999, 3)
    assert found.plane.angle_to(room.floor) < np.radians(ramp_deg) / 2.0


def test_a_floor_that_the_prior_doubts_is_not_given_up_for_a_tilted_copy_of_it(look, config):
    tilt = np.radians(1.2)
    for seed in range(60, 80):
        rng = np.random.default_rng([seed, 5])
        height, pitch = rng.uniform(0.4, 1.3), rng.uniform(20.0, 45.0)
        room = look(seed, height, pitch, CRATES[: seed % 3], reach_m=3.0)
        for sigmas in (2.5, 3.3):
            heading, (first, second) = rng.uniform(0.0, 2.0 * np.pi), room.floor.tangents
            aside = np.cos(heading) * first + np.sin(heading) * second
            normal = room.floor.normal + sigmas * tilt * aside
            prior = Plane(
                normal / np.linalg.norm(normal),
                room.floor.offset_m,
                np.diag([tilt**2, tilt**2, 0.01**2]),
            )
            found = find(room.points, prior, np.random.default_rng(seed), config)
            assert found is None or off(found.among_points, room.floor)[0] < 0.3


@pytest.mark.parametrize("sensor", ["tof", "stereo", "depth"])
def test_the_covariance_covers_a_random_bend_of_each_sensor(look, sensor):
    distortion = FloorConfig().distortion.of(sensor)
    squares = []
    for seed in range(60):
        rng = np.random.default_rng([seed, 3])
        room = look(
            seed,
            height_m=rng.uniform(0.5, 1.2),
            pitch_deg=rng.uniform(20.0, 45.0),
            boxes=CRATES[:1],
            reach_m=4.0,
            size=(100, 75),
        )
        bent = bent_points(room.points, distortion, rng)
        found = find(bent, handheld_prior(None), rng, sensor=sensor)
        e = found.plane.error_to(room.floor)
        squares.append(float(e @ np.linalg.solve(found.plane.covariance, e)) / 3.0)
    assert 0.4 < np.mean(squares) < 1.7
    assert np.mean(np.array(squares) < stats.chi2.ppf(0.95, 3) / 3.0) > 0.85


def test_a_sensor_that_bends_more_than_its_kind_is_trusted_less(look):
    widths, squares = [], []
    for times in (1.0, 2.5):
        for seed in range(20):
            room = look(seed, height_m=1.1, pitch_deg=40.0, boxes=(), reach_m=4.0, size=(100, 75))
            rng = np.random.default_rng([seed, 5])
            usual = FloorConfig().distortion.depth
            size = Distortion(share=times * usual.share, share_per_m=times * usual.share_per_m)
            bent = bent_points(room.points, size, rng)
            found = find(bent, handheld_prior(None), rng, sensor="depth")
            e = found.plane.error_to(room.floor)
            widths.append(np.sqrt(np.trace(found.plane.covariance)))
            squares.append(float(e @ np.linalg.solve(found.plane.covariance, e)) / 3.0)
    assert np.mean(widths[20:]) > 1.25 * np.mean(widths[:20])
    assert np.median(squares[20:]) < 3.2  # 6 without a look at the residuals


def test_an_unknown_sensor_is_refused_by_name(look):
    room = look(0)
    with pytest.raises(ConfigError, match="sensor='sonar'"):
        find(room.points, handheld_prior(None), np.random.default_rng(0), sensor="sonar")


def test_an_error_common_to_all_points_does_not_change_their_heights(look):
    room = look(0, height_m=0.8)
    found = find(room.points, handheld_prior(None), np.random.default_rng(0), sensor="depth")
    among, whole = found.among_points.covariance, found.plane.covariance
    assert np.trace(among) < 0.1 * np.trace(whole)
    rest = found.among_points.distance(room.points.xyz)[room.height < 1e-9]
    assert abs(np.median(rest)) < 1e-3


def staircase(riser_m, tread_m, first_m, steps=8):
    """Boxes of a straight staircase across the whole width, going up ahead."""
    last = first_m + steps * tread_m + 3.0
    return tuple(
        (first_m + k * tread_m, last, -5.0, 5.0, 0.0, (k + 1) * riser_m) for k in range(steps)
    )


@pytest.mark.parametrize("noise", [1.0, 3.0])
@pytest.mark.parametrize(("riser_m", "tread_m"), [(0.17, 0.29), (0.15, 0.32), (0.18, 0.25)])
def test_stairs_are_treads_and_never_a_ramp(look, config, riser_m, tread_m, noise):
    floors = 0
    for height_m, pitch_deg, first_m in ((0.45, 20.0, 0.4), (1.0, 35.0, 0.8), (1.4, 20.0, 1.5),
                                         (1.4, 50.0, 0.8)):  # fmt: skip
        steps = staircase(riser_m, tread_m, first_m)
        room = look(1, height_m=height_m, pitch_deg=pitch_deg, boxes=steps, noise=noise)
        points = Points(room.points.xyz, noise * room.points.sigma, room.points.pixels)
        found = find(points, handheld_prior(None), np.random.default_rng(3), config, "depth")
        if found is None:  # it may be unsure which tread is the floor
            continue
        floors += 1
        angle, _ = off(found.plane, room.floor)
        assert angle < 4.0
        steps_up = (room.floor.offset_m - found.plane.offset_m) / riser_m
        assert abs(steps_up - round(steps_up)) < 0.3
        tread = Plane(room.floor.normal, room.floor.offset_m - round(steps_up) * riser_m)
        e = found.plane.error_to(tread)
        assert float(e @ np.linalg.solve(found.plane.covariance, e)) < stats.chi2.ppf(0.999, 3)
    assert floors >= 1


def below(room, height_m):
    """The plane that far below the camera of a room, as earlier images have it."""
    up = room.T_body_camera.rotation.T @ np.array([0.0, 0.0, 1.0])
    return Plane(up, height_m, np.diag([0.07**2, 0.07**2, 0.1**2]))


def test_a_lower_floor_shows_that_the_expected_one_was_a_table(look, config):
    room = look(0, height_m=1.5, pitch_deg=40.0, boxes=((0.3, 1.3, -0.8, 0.2, 0.7, 0.75),))
    rng = np.random.default_rng(0)
    assert np.mean(np.abs(room.height - 0.75) < 0.01) > 0.3
    lower = find_lower(room.points, below(room, 0.75), rng, config)
    angle, height = off(lower.plane, room.floor)
    assert angle < 0.3
    assert height < 5.0
    assert find_lower(room.points, below(room, 1.5), rng, config) is None


def test_the_foot_of_a_flight_is_not_the_floor_of_its_top(look, config):
    top = ((-1.0, 1.3, -2.0, 2.0, 1.45, 1.5),)
    room = look(0, height_m=2.9, pitch_deg=40.0, boxes=top)
    assert np.mean(room.height < 0.01) > 0.1
    assert find_lower(room.points, below(room, 1.4), np.random.default_rng(0), config) is None


@pytest.mark.filterwarnings("error")
def test_an_image_without_depth_has_no_lower_floor_and_warns_of_nothing():
    """As after a hand before the camera, once the floor is known."""
    nothing = Points(np.zeros((0, 3)), np.zeros(0), np.zeros(0, np.int64))
    expected = Plane(np.array([0.0, -1.0, 0.0]), 0.8, np.diag([0.02**2, 0.02**2, 0.02**2]))
    assert find_lower(nothing, expected, np.random.default_rng(0)) is None
