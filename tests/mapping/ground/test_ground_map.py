"""The map of surfaces against ground of known shape, seen from several places."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import pytest

from mapping.ground.config import GroundConfig
from mapping.ground.ground_map import GroundMap
from mapping.ground.surface import Border
from perception.primitives.errors import ConfigError, InputError
from perception.primitives.pose import Pose2, Pose3

sys.path.insert(0, str(Path(__file__).parent))

import ground_walks as walks

STAIRS = walks.scenes.stairs(0.16, 0.29, 4, 0.7)
DOWN = walks.scenes.stairs(0.16, 0.29, 4, 0.7, down=True)
KERB = walks.scenes.stairs(0.08, 0.3, 1, 0.9)
HOLE = [
    ((-2.0, 0.0), (1.0, 0.0), 3.0),
    ((1.0, 0.0), (1.0, -0.3), 3.0),
    ((1.0, -0.3), (1.5, -0.3), 3.0),
    ((1.5, -0.3), (1.5, 0.0), 3.0),
    ((1.5, 0.0), (5.0, 0.0), 3.0),
]
FLAT = [((-2.0, 0.0), (6.0, 0.0), 3.0)]
SURE = np.diag([0.002, 0.002, 0.002, *np.radians([0.1, 0.1, 0.1])]) ** 2
SURE_STEP = np.diag([0.001, 0.001, 0.001, 0.001]) ** 2


def seen(scene, tilt=0.6, steps=4):
    """A map of exact joints and a sensor without distortion, after some steps of 10 cm."""
    ground = GroundMap()
    T_body_camera = walks.scenes.pose(1.0, tilt)
    for k in range(steps):
        if k:
            ground.move(Pose2(0.1, 0.0, 0.0), 0.0, SURE_STEP)
        T = Pose3((0.1 * k, 0.0, 0.0)) @ T_body_camera
        ground.observe(walks.regions(scene, T, k), T_body_camera, SURE, walks.CAMERA)
    return ground


def at(surfaces, x, y=0.0):
    return [one for one in surfaces if one.contains(np.array([x, y]))]


@pytest.fixture(scope="module")
def stairs():
    return seen(STAIRS).surfaces


def test_every_tread_is_a_surface_of_its_own(stairs):
    for number in range(1, 5):
        middle = 0.7 - 0.3 + (number - 0.5) * 0.29
        (tread,) = at(stairs, middle)
        z, _ = tread.height_at(np.array([middle, 0.0]))
        assert z == pytest.approx(0.16 * number, abs=0.006)


def test_the_sides_of_a_tread_are_a_drop_before_and_a_rise_behind(stairs):
    (tread,) = at(stairs, 0.4 + 0.145)
    middles = (tread.outline + np.roll(tread.outline, -1, axis=0)) / 2.0
    across = np.abs(np.roll(tread.outline, -1, axis=0) - tread.outline)
    long = (across[:, 1] > 0.5) & (across[:, 0] < 0.1)
    x = {Border(int(b)): m for b, m in zip(tread.borders[long], middles[long, 0], strict=True)}
    assert x[Border.DROP] == pytest.approx(0.4, abs=0.008)
    assert x[Border.RISE] == pytest.approx(0.69, abs=0.008)
    assert tread.sigma_m[long].max() < 0.02


def test_corners_go_counterclockwise(stairs):
    for one in stairs:
        x, y = one.outline.T
        assert x @ np.roll(y, -1) > y @ np.roll(x, -1)


def test_errors_of_heights_and_sides_keep_to_their_covariance():
    made = [walks.walk(STAIRS, seed) for seed in range(2000, 2006)]
    made += [walks.walk(DOWN, seed, tilt=0.75) for seed in range(2006, 2012)]
    nees, wrong = walks.heights(made)
    assert 0.4 < nees < 2.0
    assert wrong < 0.05
    assert 0.3 < np.mean(walks.sides(made)) < 2.0


def test_one_view_does_not_tell_which_part_of_the_error_lasts():
    """The floor shows how the camera is tilted, whether by an offset of a joint or by sway."""
    T = walks.scenes.pose(1.0, 0.6)
    sigmas = []
    for share in (0.0, 0.1):
        ground = GroundMap(GroundConfig(lasting_share=share))
        ground.observe(walks.regions(STAIRS, T), T, walks.POSE, walks.CAMERA)
        assert len(ground.surfaces) == 6  # the ground at its feet, the floor, and four treads
        sigmas.append(np.concatenate([one.sigma_m for one in ground.surfaces]))
    assert sigmas[1] == pytest.approx(sigmas[0], rel=0.05)


def test_many_equal_views_leave_what_the_sensor_bends():
    one = walks.walk(FLAT, 2000, steps=1).surfaces
    many = walks.walk(FLAT, 2000, steps=12, step_m=0.0).surfaces
    sigmas = [max(s.height_at(np.array([1.8, 0.0]))[1] for s in found) for found in (one, many)]
    assert 0.004 < sigmas[1] < sigmas[0]  # .002 z and more by the bend


def test_at_the_start_a_disc_is_known_and_then_what_was_walked_on():
    ground = GroundMap()
    (disc,) = ground.surfaces
    assert disc.contains(np.array([0.08, 0.0]))
    assert not disc.contains(np.array([0.2, 0.0]))
    assert (disc.borders == Border.UNSEEN).all()
    below = at(seen(FLAT, steps=9).surfaces, 0.0)
    assert len(below) == 1  # the camera saw it from 60 cm away, and no more
    assert below[0].contains(np.array([0.4, 0.0]))


def test_a_motion_moves_surfaces_and_adds_its_error():
    ground = seen(STAIRS, steps=1)
    (before,) = at(ground.surfaces, 0.85)
    ground.move(Pose2(0.2, 0.1, 0.3), 0.05, np.diag([0.01, 0.01, 0.02, 0.005]) ** 2)
    there = Pose2(0.2, 0.1, 0.3).inverse().apply(np.array([0.85, 0.0]))
    (after,) = at(ground.surfaces, *there)
    z0, sigma0 = before.height_at(np.array([0.85, 0.0]))
    z1, sigma1 = after.height_at(there)
    assert z1 == pytest.approx(z0 - 0.05, abs=0.004)  # the feet tell the rise, too
    assert sigma1 > sigma0
    assert after.sigma_m.min() > before.sigma_m.min()


def test_after_a_step_up_the_tread_has_height_zero():
    one = walks.walk(STAIRS, 2000, steps=6, step_m=0.17)  # on the first tread
    assert one.height_m == pytest.approx(0.16)
    (below,) = at(one.surfaces, 0.0)
    z, sigma = below.height_at(np.zeros(2))
    assert abs(z) < 3.0 * sigma < 0.02
    assert len([s for s in one.surfaces if s.contains(np.array([0.28, 0.0]))]) == 1


def test_a_kerb_and_a_hole_are_levels_of_their_own():
    kerb = seen(KERB).surfaces
    (top,) = at(kerb, 1.0)
    assert top.height_at(np.array([1.0, 0.0]))[0] == pytest.approx(0.08, abs=0.006)
    (low,) = at(kerb, 0.45)
    assert low.height_at(np.array([0.45, 0.0]))[0] == pytest.approx(0.0, abs=0.006)
    hole = seen(HOLE).surfaces
    assert not at(hole, 0.85)  # its ground is out of view
    assert at(hole, 0.6)
    assert at(hole, 1.6)
    assert any((one.borders == Border.DROP).any() for one in at(hole, 0.6))


def test_nothing_stands_on_a_wall_or_below_a_box():
    wall = [((-2.0, 0.0), (1.5, 0.0), 3.0), ((1.5, 0.0), (1.5, 2.0), 3.0)]
    floor = seen(wall).surfaces
    assert at(floor, 0.9)
    assert all(abs(one.height[0]) < 0.02 for one in floor)
    box = [*FLAT, ((1.1, 0.0), (1.1, 0.2), 0.15), ((1.1, 0.2), (1.3, 0.2), 0.15)]
    found = seen(box).surfaces
    (top,) = at(found, 0.9)
    assert top.height_at(np.array([0.9, 0.0]))[0] == pytest.approx(0.2, abs=0.01)
    for y in (0.4, -0.4):
        (beside,) = at(found, 0.9, y)
        assert abs(beside.height_at(np.array([0.9, y]))[0]) < 0.01


@pytest.mark.parametrize("box_m", [0.02, 0.03])
def test_a_low_box_at_its_feet_does_not_sink_the_floor(box_m):
    """The height of the camera is known to a centimetre, and the box is nearer than the middle of the floor."""
    ground, T = GroundMap(), walks.scenes.pose(1.0, 0.75)
    box = [((0.55, 0.0), (0.55, box_m), 0.12), ((0.55, box_m), (0.75, box_m), 0.12)]
    for k, scene in enumerate((FLAT, FLAT, [*FLAT, *box], [*FLAT, *box])):
        ground.observe(walks.regions(scene, T, k), T, walks.POSE, walks.CAMERA)
    heights = {
        place: [one.height_at(np.array([place, 0.0]))[0] for one in at(ground.surfaces, place)]
        for place in (1.5, 0.65)
    }
    assert heights[1.5] == pytest.approx([0.0], abs=0.008)
    assert min(abs(z - box_m) for z in heights[0.65]) < 0.003


def test_ground_far_behind_is_forgotten():
    ground = seen(FLAT)
    for _ in range(4):
        ground.move(Pose2(0.5, 0.0, 0.0), 0.0, SURE_STEP)
    assert at(ground.surfaces, -0.5)
    for one in ground.surfaces:
        assert one.outline[:, 0].min() > -1.05


def test_what_is_wrong_is_said():
    ground = GroundMap()
    with pytest.raises(InputError, match="covariance of the motion"):
        ground.move(Pose2(), 0.0, -np.eye(4))
    with pytest.raises(InputError, match="finite"):
        ground.move(Pose2(math.nan, 0.0, 0.0), 0.0, np.eye(4))
    T = walks.scenes.pose(1.0, 0.6)
    bent = walks.regions(FLAT, T, config=walks.CONFIG)
    small = walks.scenes.Camera.from_view(32, 24, 1.0, 0.8)
    with pytest.raises(InputError, match="32 x 24"):
        ground.observe(bent, T, SURE, small)
    ground.observe(bent, T, SURE, walks.CAMERA)
    other = walks.exact(walks.Distortion(offset_m=0.01))
    with pytest.raises(InputError, match="one sensor"):
        ground.observe(walks.regions(FLAT, T, config=other), T, SURE, walks.CAMERA)
    with pytest.raises(ConfigError, match="lasting_share"):
        GroundConfig(lasting_share=2.0)
