"""Coloured obstacles in rendered images: detection and consistency."""

from __future__ import annotations

import math

import numpy as np
import pytest

from perception.obstacles.colour_detection import (
    CAMERA_HEIGHT_SIGMA_M,
    HEAD_PITCH_SIGMA_RAD,
    HEAD_YAW_SIGMA_RAD,
    ColouredConfig,
    detect,
    nearest_colour,
    patches,
)
from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError
from perception.primitives.frame import ColourView
from perception.primitives.pose import Pose3, head_rotation
from sim.scene import Scene, StaticObject
from sim.scenes.rooms import empty_room
from sim.sensors.cameras import ImageConfig, colour_picture
from sim.shapes import Cylinder
from sim.world import World

ROBOTS = ("#e88028", "#96be3c", "#8654b0")
NAMES = ("orange", "lime", "violet")
CONFIG = ColouredConfig(colours=ROBOTS)
IMAGES = ImageConfig(640, 480, 75.0, (0.0, 0.0, 0.0))
HEIGHT_M = 0.42


def scene(places: np.ndarray) -> Scene:
    """An empty room, 5 x 4 m, with painted cylinders at (x, y) in the room."""
    room = empty_room(0)
    painted = tuple(
        StaticObject(
            f"robot {k}",
            (Cylinder((float(x), float(y), 0.2), 0.10, 0.40, f"stripes/{NAMES[k % 3]}"),),
        )
        for k, (x, y) in enumerate(places)
    )
    return Scene(
        room.name,
        0,
        room.extent,
        room.floor,
        room.static_objects + painted,
        (),
        (),
        room.start,
        room.goals,
    )


def test_coloured_robots_are_found_consistently_with_their_covariance():
    rng = np.random.default_rng(4)
    middle = np.array([2.5, 2.0])
    bearings = np.arange(11) * 2 * math.pi / 11 + rng.uniform(-0.1, 0.1, 11)
    ranges = rng.uniform(0.7, 1.75, 11)
    local = ranges[:, None] * np.stack([np.cos(bearings), np.sin(bearings)], axis=-1)
    there = found = invented = 0
    normalised, radii = [], []
    with World(scene(middle + local), seed=0) as world:
        for _ in range(24):
            pan, tilt = rng.uniform(-math.pi, math.pi), rng.uniform(0.3, 0.45)
            eye = np.array([0.0, 0.0, HEIGHT_M])
            true = Pose3.from_rotation(head_rotation(pan, tilt), eye)
            told = Pose3.from_rotation(
                head_rotation(
                    pan + rng.normal() * HEAD_YAW_SIGMA_RAD,
                    tilt + rng.normal() * HEAD_PITCH_SIGMA_RAD,
                ),
                eye + np.array([0.0, 0.0, rng.normal() * CAMERA_HEIGHT_SIGMA_M]),
            )
            T_world_camera = Pose3((*middle.tolist(), 0.0)) @ true
            rgb = colour_picture(world, IMAGES, T_world_camera, rng)
            detections = detect(ColourView(rgb, IMAGES.camera, told), CONFIG)
            matched = 0
            for place in local:
                away = float(np.hypot(*place))
                aside = 0.12 * np.array([-place[1], place[0]]) / away
                corners = [place * (1 - 0.11 / away) - aside, place * (1 - 0.11 / away) + aside]
                camera_points = true.inverse().apply(
                    np.array([[*c, z] for c in corners for z in (0.0, 0.2)])
                )
                whole = bool(np.all(camera_points[:, 2] > 0.1))
                if whole:
                    whole = bool(
                        np.all(IMAGES.camera.contains(IMAGES.camera.project(camera_points)))
                    )
                near = [d for d in detections if np.hypot(*(d.position - place)) < 0.3]
                there, found = there + whole, found + (whole and bool(near))
                matched += bool(near)
                if near:
                    error = near[0].position - place
                    normalised.append(error @ np.linalg.solve(near[0].covariance, error))
                    radii.append(near[0].radius_m)
            invented += len(detections) - matched
    assert there >= 35
    assert found / there >= 0.95
    assert invented == 0
    assert np.mean(radii) == pytest.approx(0.10, abs=0.01)
    assert 1.0 < np.mean(normalised) < 3.2


def test_shadows_keep_the_colour_and_grey_has_none():
    for k, colour in enumerate(ROBOTS):
        rgb = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)], float)
        shades = np.array([rgb * share for share in (0.35, 0.6, 1.0)]).astype(np.uint8)
        assert np.all(nearest_colour(shades[None], CONFIG) == k)
    greys = np.repeat(np.arange(0, 256, 15, dtype=np.uint8)[None, :, None], 3, axis=2)
    assert np.all(nearest_colour(greys, CONFIG) == -1)


def test_patches_at_the_border_are_ignored():
    rgb = np.zeros((100, 120, 3), np.uint8)
    rgb[10:40, 0:20] = rgb[60:100, 50:70] = rgb[20:50, 60:80] = (232, 128, 40)
    (whole,) = patches(rgb, CONFIG)
    assert (whole.left, whole.right, whole.foot) == (59.5, 79.5, 49.5)


def test_without_colours_or_a_camera_pose_there_are_no_detections():
    rgb = np.zeros((100, 120, 3), np.uint8)
    rgb[60:90, 50:70] = (232, 128, 40)
    camera = Camera.from_view(120, 100, 1.0, 0.8)
    place = Pose3.from_rotation(head_rotation(0.0, 0.5), np.array([0.0, 0.0, 0.4]))
    assert detect(ColourView(rgb, camera, place), ColouredConfig()) == []
    assert detect(ColourView(rgb, camera), CONFIG) == []
    assert len(detect(ColourView(rgb, camera, place), CONFIG)) == 1


def test_a_foot_above_the_horizon_gives_no_detection():
    rgb = np.zeros((100, 120, 3), np.uint8)
    rgb[5:30, 50:70] = (232, 128, 40)
    camera = Camera.from_view(120, 100, 1.0, 0.8)
    level = Pose3.from_rotation(head_rotation(0.0, 0.0), np.array([0.0, 0.0, 0.4]))
    assert detect(ColourView(rgb, camera, level), CONFIG) == []


def test_the_disc_of_an_ideal_cylinder_is_accurate_to_a_pixel():
    """Its outline by geometry: sides by the tangents, foot by the nearest floor point."""
    camera = Camera.from_view(1280, 960, math.radians(60.0), math.radians(47.0))
    place = Pose3.from_rotation(head_rotation(0.0, 0.45), np.array([0.0, 0.0, 0.5]))
    rays = camera.rays @ place.rotation.T
    t = np.where(rays[..., 2] < 0, -0.5 / rays[..., 2], np.inf)
    centre, radius = np.array([1.1, 0.07]), 0.09
    flat = np.hypot(rays[..., 0], rays[..., 1])
    bearing = np.arctan2(rays[..., 1], rays[..., 0]) - math.atan2(centre[1], centre[0])
    away = float(np.hypot(*centre))
    off = away * np.sin(bearing)
    inside = np.abs(off) < radius
    front = away * np.cos(bearing) - np.sqrt(np.maximum(radius**2 - off**2, 0.0))
    hits = inside & (front / flat < t) & (0.5 + rays[..., 2] * front / flat < 0.35)
    rgb = np.zeros((*hits.shape, 3), np.uint8)
    rgb[hits] = (150, 190, 60)
    (found,) = detect(ColourView(rgb, camera, place), CONFIG)
    np.testing.assert_allclose(found.position, centre, atol=8e-3)  # a pixel is 4 mm there
    assert found.radius_m == pytest.approx(radius, abs=2e-3)
    assert found.height_m == pytest.approx(0.35, abs=0.03)


@pytest.mark.parametrize("colour", ["orange", "#12345", "#gggggg"])
def test_an_invalid_colour_is_refused_with_a_message(colour):
    with pytest.raises(ConfigError, match="write it as"):
        ColouredConfig(colours=(colour,))
