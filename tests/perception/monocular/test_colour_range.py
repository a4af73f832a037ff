"""The compiled colour test against HSV computed pixel by pixel; learning of the floor's colours."""

import colorsys
import math

import numpy as np
import pytest

from perception.monocular.adaptation import FloorColourModel, grow_region
from perception.monocular.back_projection import camera_pose
from perception.monocular.colour_range import MIN_CHROMA, TOLERANT, ColourRange, colour_spread, mark
from perception.primitives.errors import ConfigError


def in_range(colour, limits):
    h, s, v = colorsys.rgb_to_hsv(*(channel / 255 for channel in colour))
    off = abs((360 * h - limits.hue_deg + 180) % 360 - 180)
    chroma = int(max(colour)) - int(min(colour))
    hue = limits.any_hue or off <= limits.hue_half_deg or chroma < MIN_CHROMA
    return (
        hue
        and limits.saturation[0] <= 255 * s <= limits.saturation[1]
        and limits.value[0] <= 255 * v <= limits.value[1]
    )


@pytest.mark.parametrize("hue", [3.0, 41.0, 119.0, 200.0, 299.0, 357.0])
@pytest.mark.parametrize("half", [10.0, 60.0, 180.0])
def test_the_kernel_accepts_the_colour_spread_hues(hue, half):
    rng = np.random.default_rng(int(hue + half))
    limits = ColourRange(hue, half, (20.0, 230.0), (40.0, 250.0))
    rgb = rng.integers(0, 256, (40, 50, 3), dtype=np.uint8)
    mask = np.zeros((40, 50), np.uint8)
    mark(rgb, limits, mask)
    wide = ColourRange(hue, half + 0.3, (19.9, 230.1), (40.0, 250.0))
    tight = ColourRange(hue, half - 0.3, (20.1, 229.9), (40.0, 250.0))
    for pixel, marked in zip(rgb.reshape(-1, 3), mask.ravel() > 0, strict=True):
        # integer normals move a limit by less than 0.3 deg
        assert in_range(pixel, tight) <= marked <= in_range(pixel, wide)


def test_a_soft_shadow_is_accepted_and_another_colour_is_not():
    rng = np.random.default_rng(1)
    floor = np.clip(rng.normal([180, 140, 95], 6, (500, 3)), 0, 255).astype(np.uint8)
    limits = colour_spread(floor).with_margins(TOLERANT)
    picture = np.array([[[153, 119, 81], [60, 90, 170], [180, 140, 95]]], np.uint8)
    mask = np.zeros((1, 3), np.uint8)
    mark(picture, limits, mask)
    assert mask.tolist() == [[255, 0, 255]]


GREY_TILES, CREAM_WALL = np.array([118.0, 121.0, 126.0]), np.array([128.0, 121.0, 107.0])


def test_a_cream_wall_in_shadow_is_not_accepted_as_grey_floor():
    """Both are achromatic, and the saturation of the wall lies in the range of the tiles."""
    rng = np.random.default_rng(6)
    tiles = np.clip(rng.normal(GREY_TILES, 5, (500, 3)), 0, 255).astype(np.uint8)
    limits = colour_spread(tiles).with_margins(TOLERANT)
    picture = np.array([[GREY_TILES, 0.8 * GREY_TILES, CREAM_WALL, 0.9 * CREAM_WALL]])
    mask = np.zeros((1, 4), np.uint8)
    mark(picture.astype(np.uint8), limits, mask)
    assert mask.tolist() == [[255, 255, 0, 0]]
    low, high = limits.saturation
    assert low < 255 * np.ptp(CREAM_WALL) / CREAM_WALL.max() < high


@pytest.mark.parametrize("warmth", [(-0.05, 0.02), (0.1, 0.3)])
def test_achromatic_colours_are_limited_by_warmth(warmth):
    rng = np.random.default_rng(7)
    limits = ColourRange(0.0, 180.0, (0.0, 255.0), (0.0, 255.0), warmth)
    rgb = rng.integers(1, 256, (40, 50, 3), dtype=np.uint8)
    mask = np.zeros((40, 50), np.uint8)
    mark(rgb, limits, mask)
    r, g, b = rgb.astype(float).transpose(2, 0, 1)
    found = (r - b) / (r + g + b)
    near = np.abs(found[..., None] - np.array(warmth)).min(axis=-1) < 1e-3
    inside = (found > warmth[0]) & (found < warmth[1])
    np.testing.assert_array_equal(mask[~near] > 0, inside[~near])


def test_the_region_follows_a_gradient_and_stops_at_an_edge():
    tiles = np.zeros((4, 12, 3), np.float32)
    tiles[:, :8] = (np.geomspace(100, 220, 8)[:, None] * np.array([1.0, 0.9, 0.8]))[None]
    tiles[:, 8:] = (60.0, 60.0, 140.0)
    region = grow_region(tiles, 2)
    assert region[:, :8].all()
    assert not region[:, 8:].any()


def test_a_region_does_not_grow_across_tiles_that_are_not_allowed():
    tiles = np.full((3, 5, 3), 90.0, np.float32)
    allowed = np.ones((3, 5), bool)
    allowed[:, 2] = False
    region = grow_region(tiles, 0, allowed)
    assert region[:, :2].all()
    assert not region[:, 2:].any()


def camera_at(x=0.0, y=0.0):
    """Camera pose of a robot at (x, y), m, looking ahead and down."""
    return camera_pose(np.array([x, y, 0.42]), 0.0, math.radians(30.0), 0.0)


def floor_picture(tone, rng, obstacle=False):
    image = rng.normal(np.array(tone), 3.0, (240, 240, 3))
    if obstacle:
        image[:, 60:] = rng.normal([40, 60, 160], 3.0, (240, 180, 3))
    return np.clip(image, 0, 255).astype(np.uint8)


def test_the_model_follows_slowly_fading_light():
    rng = np.random.default_rng(2)
    colours = FloorColourModel()
    for light in np.linspace(1.0, 0.45, 60):
        colours.learn(floor_picture(light * np.array([200, 180, 150]), rng))
    last = floor_picture(0.45 * np.array([200, 180, 150]), rng)
    mask = np.zeros((240, 240), np.uint8)
    mark(last, colours.range, mask)
    assert np.mean(mask > 0) > 0.95


def test_an_obstacle_in_the_patch_is_not_learnt():
    rng = np.random.default_rng(3)
    colours = FloorColourModel()
    colours.learn(floor_picture([200, 180, 150], rng), camera_at())
    for _ in range(20):
        seen = floor_picture([200, 180, 150], rng, obstacle=True)
        colours.learn(seen, camera_at())
    mask = np.zeros((240, 240), np.uint8)
    mark(seen, colours.range, mask)
    assert np.mean(mask[:, :60] > 0) > 0.95
    assert not mask[:, 60:].any()


def test_a_wall_with_an_oblique_edge_across_the_tiles_is_not_learnt():
    """The share of wall changes only little from tile to tile."""
    rng = np.random.default_rng(8)
    colours = FloorColourModel()
    colours.learn(floor_picture(GREY_TILES, rng))
    v, u = np.mgrid[0:240, 0:240]
    wall = u > 90 + v / 4
    for _ in range(60):
        seen = np.where(
            wall[..., None], floor_picture(CREAM_WALL, rng), floor_picture(GREY_TILES, rng)
        )
        colours.learn(seen)
    mask = np.zeros((240, 240), np.uint8)
    mark(seen, colours.range, mask)
    assert np.mean(mask[~wall] > 0) > 0.95
    assert np.mean(mask[wall] > 0) < 0.05


def test_a_rug_is_learnt_when_the_robot_walks_onto_it_and_not_when_it_stands_or_walks_past():
    rng = np.random.default_rng(4)
    rug = floor_picture([30, 130, 140], rng)
    motions = {
        "standing": (0.0, 0.0),
        "onto": (0.04, 0.0),
        "past": (0.0, 0.04),
        "backwards": (-0.04, 0.0),
    }
    for motion, (ahead, lateral) in motions.items():
        colours = FloorColourModel()
        colours.learn(floor_picture([200, 180, 150], rng), camera_at())
        for k in range(20):
            colours.learn(rug, camera_at(k * ahead, k * lateral))
        mask = np.zeros((240, 240), np.uint8)
        mark(rug, colours.range, mask)
        if motion == "onto":
            assert np.mean(mask > 0) > 0.95
        else:
            assert not mask.any(), motion


def test_a_rug_first_seen_while_looking_sideways_is_learnt_too():
    rng = np.random.default_rng(9)
    rug = floor_picture([30, 130, 140], rng)
    colours = FloorColourModel()
    colours.learn(floor_picture([200, 180, 150], rng), camera_at())
    for k in range(20):
        x, y, z = camera_at(0.04 * k).translation
        yaw = 0.0 if k % 2 else math.radians(75.0)
        colours.learn(rug, camera_pose(np.array([x, y, z]), yaw, math.radians(30.0), 0.0))
    mask = np.zeros((240, 240), np.uint8)
    mark(rug, colours.range, mask)
    assert np.mean(mask > 0) > 0.95


def test_a_range_with_exchanged_limits_is_refused():
    with pytest.raises(ConfigError, match="value"):
        ColourRange(0.0, 10.0, (0.0, 1.0), (200.0, 100.0))


def test_a_part_of_a_picture_without_pixels_is_left_as_it_is():
    every = ColourRange(0.0, 180.0, (0.0, 255.0), (0.0, 255.0))
    rgb = np.random.default_rng(10).integers(0, 256, (4, 6, 3), dtype=np.uint8)
    before, mask = rgb.copy(), np.zeros((4, 6), np.uint8)
    for part in (np.s_[:, 3:3], np.s_[2:2]):
        mark(rgb[part], every, mask[part])
    assert np.array_equal(rgb, before)
    assert not mask.any()
    mark(rgb, every, mask)
    assert (mask == 255).all()
