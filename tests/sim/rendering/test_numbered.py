"""Ranges from PyBullet's camera against planes of known range and against ray casting."""

import math

import cv2
import numpy as np
import pytest

from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError, SurefootError
from perception.primitives.pose import Pose2, Pose3, head_rotation
from sim.rendering.numbered import NumberedScene
from sim.rendering.renderer import Renderer, choose_renderer
from sim.robot_config import RobotConfig
from sim.scene import FloorArea, MovingObject, Scene, StaticObject
from sim.scenes import catalogue
from sim.sensors.tof_camera import TofCamera, TofConfig
from sim.shapes import Box, Cylinder
from sim.world import World

CAMERA = Camera.from_view(176, 144, math.radians(44), math.radians(35))
EYE_M = 0.383
STEP = 2.0**-16 / 0.1  # of a depth buffer of 16 bits that begins at 0.1 m, relative to z^2


@pytest.fixture(params=["egl", "tiny"])
def renderer(request):
    if request.param == "egl" and choose_renderer("auto") != "egl":
        pytest.skip("the EGL renderer does not work on this machine")
    return request.param


def scene(*objects, moving_objects=(), extent=(-1.0, -4.0, 9.0, 4.0)):
    area = (FloorArea("planks/oak", extent),)
    return Scene("test", 0, extent, area, objects, moving_objects, (), Pose2(), (), 0.5)


def ahead(tilt_rad=0.0):
    return Pose3.from_rotation(head_rotation(0.0, tilt_rad), np.array([0.0, 0.0, EYE_M]))


def images(hits):
    shape = (CAMERA.height, CAMERA.width)
    return [part.reshape(shape) for part in (hits.distance_m, hits.cosine, hits.albedo)]


def test_the_floor_has_the_range_angle_and_albedo_of_a_plane(renderer):
    pose = ahead(0.8)
    with World(scene(), renderer) as world:
        distance, cosine, albedo = images(world.ranges().look(CAMERA, pose))
    unit = CAMERA.rays / np.linalg.norm(CAMERA.rays, axis=-1, keepdims=True)
    down = -(unit @ pose.rotation[2])
    expected = EYE_M / down
    assert np.abs(distance - expected).max() < STEP * expected.max() ** 2
    np.testing.assert_allclose(cosine, down, atol=1e-6)
    assert (albedo == np.float32(0.5)).all()


def test_a_box_before_a_wall_has_its_own_range_and_albedo(renderer):
    wall = StaticObject("wall", (Box((3.5, 0.0, 1.5), (1.0, 8.0, 3.0)),), 0.8)
    box = StaticObject("box", (Box((1.4, 0.1, 0.4), (0.4, 0.3, 0.8)),), 0.3)
    with World(scene(wall, box), renderer) as world:
        distance, cosine, albedo = images(world.ranges().look(CAMERA, ahead()))
    slant = np.linalg.norm(CAMERA.rays, axis=-1)
    y, z = -CAMERA.rays[..., 0], EYE_M - CAMERA.rays[..., 1] * 3.0
    on_box = (y * 1.2 > -0.04) & (y * 1.2 < 0.24) & (EYE_M - CAMERA.rays[..., 1] * 1.2 > 0.01)
    on_wall = ((y * 1.2 < -0.07) | (y * 1.2 > 0.27)) & (z > 0.01)
    for where, x, reflects in ((on_box, 1.2, 0.3), (on_wall, 3.0, 0.8)):
        assert where.sum() > 1000
        assert np.abs(distance / slant - x)[where].max() < STEP * x**2
        assert (albedo[where] == np.float32(reflects)).all()
        np.testing.assert_allclose(cosine[where], 1.0 / slant[where], atol=1e-6)


def test_beyond_its_reach_nothing_is_met(renderer):
    with World(scene(extent=(-1.0, -4.0, 2.0, 4.0)), renderer) as world:
        distance, cosine, albedo = images(world.ranges().look(CAMERA, ahead(-0.5)))
    assert np.isinf(distance).all()
    assert not cosine.any()
    assert not albedo.any()


def test_a_moving_object_moves_in_the_ranges_too(renderer):
    parts = (Cylinder((0.0, 0.0, 0.4), 0.2, 0.8),)
    one = MovingObject("robot 1", (1.5, 0.0), 0.0, 0.2, 10.0, parts, 0.7, phase_s=0.0)
    with World(scene(moving_objects=(one,)), renderer) as world:
        fronts = []
        for seconds in (0.0, 2.0, 0.0):
            world.advance(seconds)
            hits = world.ranges().look(CAMERA, ahead())
            middle = 72 * CAMERA.width + 88
            assert hits.albedo[middle] == np.float32(0.7)
            fronts.append(float(hits.distance_m[middle]))
        later = float(world.ranges(after_s=1.0).look(CAMERA, ahead()).distance_m[middle])
    expected = [1.3, 1.7, 1.7, 1.9]
    np.testing.assert_allclose([*fronts, later], expected, atol=STEP * 1.9**2 + 1e-3)  # polygon


def test_ranges_in_a_home_agree_with_ray_casting(renderer):
    home = catalogue.load("home", 3)
    pose = home.start.lifted() @ Pose3.from_rotation(
        head_rotation(0.3, 0.4), np.array([0.0, 0.0, EYE_M])
    )
    with World(home, renderer, 3) as world:
        rendered, cast = (world.ranges(name).look(CAMERA, pose) for name in ("camera", "rays"))
        measured = [
            TofCamera(TofConfig(), np.random.default_rng(5)).measure(world.ranges(name), pose)[0]
            for name in ("camera", "rays")
        ]
    error = np.abs(rendered.distance_m - cast.distance_m)
    near = (cast.distance_m > 0.3) & (cast.distance_m < 3.0)
    assert near.mean() > 0.5
    assert np.median(error[near]) < 1e-3
    assert np.percentile(error[near], 99) < 1e-3
    assert np.mean(rendered.albedo != cast.albedo) < 1e-3
    assert np.mean(np.abs(rendered.cosine - cast.cosine) > 1e-4) < 1e-3
    assert np.nanpercentile(np.abs(measured[0] - measured[1]), 99) < 1e-3


def test_the_numbers_of_many_objects_take_memory_in_proportion():
    class Shown(Renderer):
        def __init__(self):
            self.pixels = 0

        def show(self, mesh):
            self.pixels += mesh.texture[..., 0].size
            return 0

        def place(self, body, x, y):
            pass

    def pixels(count):
        parts = (Cylinder((0.0, 0.0, 0.4), 0.2, 0.8),)
        one = MovingObject("robot 1", (1.5, 0.0), 0.0, 0.2, 10.0, parts, 0.7, phase_s=0.0)
        shown = Shown()
        NumberedScene(scene(moving_objects=(one,) * count), shown)
        return shown.pixels

    assert pixels(80) < 9 * pixels(10)


def small_room():
    wall = StaticObject("wall", (Box((2.0, 0.0, 0.5), (0.2, 2.0, 1.0)),), 0.8)
    side = StaticObject("side", (Box((1.5, 0.9, 0.3), (0.3, 0.3, 0.6), 0.4, "wood/oak"),), 0.3)
    return scene(wall, side, extent=(0.0, -1.0, 2.2, 1.5))


def test_pictures_and_ranges_do_not_see_each_other(renderer):
    with World(small_room(), renderer) as world:
        picture = world.picture(CAMERA, ahead(0.2))
        ranges = world.ranges().look(CAMERA, ahead(0.2)).distance_m
        again = world.picture(CAMERA, ahead(0.2))
    with World(small_room(), renderer) as world:
        alone = world.ranges().look(CAMERA, ahead(0.2)).distance_m
    assert np.array_equal(picture, again)
    assert np.array_equal(ranges, alone)


def test_two_open_worlds_with_egl_are_refused_and_one_after_the_other_is_not():
    if choose_renderer("auto") != "egl":
        pytest.skip("the EGL renderer does not work on this machine")
    room = scene()
    with World(room, "egl") as world, World(room, "egl") as other:
        world.ranges()
        with pytest.raises(SurefootError, match="close that world first, or use 'tiny'"):
            other.ranges()
        world.close()
        assert np.isfinite(other.ranges().look(CAMERA, ahead(0.8)).distance_m).all()


def test_both_renderers_are_equally_bright():
    if choose_renderer("auto") != "egl":
        pytest.skip("the EGL renderer does not work on this machine")
    pictures = []
    for renderer in ("egl", "tiny"):
        with World(small_room(), renderer) as world:
            pictures.append(world.picture(CAMERA, ahead(0.2)).astype(float))
    egl, tiny = (cv2.GaussianBlur(one, (0, 0), 4.0) for one in pictures)  # they filter differently
    ratio = egl / tiny
    assert 0.99 < np.median(ratio) < 1.01
    assert np.percentile(np.abs(ratio - 1.0), 95) < 0.03


def test_an_unknown_source_of_ranges_is_refused():
    with pytest.raises(ConfigError, match="tof_source='lidar' is unknown; choose camera, rays"):
        RobotConfig(tof_source="lidar")
