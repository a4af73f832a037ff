"""The compiled colour test against HSV computed pixel by pixel; what ranges take in and leave out."""

import colorsys
import math

import numpy as np
import pytest

from perception.monocular.adaptation import AdaptationConfig, FloorColours, grown
from perception.monocular.back_projection import camera_pose
from perception.monocular.colour_range import ColourRange, RangeConfig, mark, range_of
from perception.primitives.errors import ConfigError


def plainly(colour, limits):
    h, s, v = colorsys.rgb_to_hsv(*(channel / 255 for channel in colour))
    off = abs((360 * h - limits.hue_deg + 180) % 360 - 180)
    chroma = int(max(colour)) - int(min(colour))
    hue = limits.any_hue or off <= limits.hue_half_deg or chroma < limits.least_chroma
    return (
        hue
        and limits.saturation[0] <= 255 * s <= limits.saturation[1]
        and limits.value[0] <= 255 * v <= limits.value[1]
    )


@pytest.mark.parametrize("hue", [3.0, 41.0, 119.0, 200.0, 299.0, 357.0])
@pytest.mark.parametrize("half", [10.0, 60.0, 180.0])
def test_the_wedge_of_colours_is_the_range_of_hues(hue, half):
    rng = np.random.default_rng(int(hue + half))
    limits = ColourRange(hue, half, (20.0, 230.0), (40.0, 250.0), 28.0)
    rgb = rng.integers(0, 256, (40, 50, 3), dtype=np.uint8)
    mask = np.zeros((40, 50), np.uint8)
    mark(rgb, limits, mask)
    wide = ColourRange(hue, half + 0.3, (19.9, 230.1), (40.0, 250.0), 28.0)
    tight = ColourRange(hue, half - 0.3, (20.1, 229.9), (40.0, 250.0), 28.0)
    for pixel, marked in zip(rgb.reshape(-1, 3), mask.ravel() > 0, strict=True):
        # integer normals turn a border by less than 0.3 deg
        assert plainly(pixel, tight) <= marked <= plainly(pixel, wide)


def test_a_soft_shadow_is_floor_and_another_colour_is_not():
    rng = np.random.default_rng(1)
    floor = np.clip(rng.normal([180, 140, 95], 6, (500, 3)), 0, 255).astype(np.uint8)
    limits = range_of(floor, RangeConfig())
    picture = np.array([[[153, 119, 81], [60, 90, 170], [180, 140, 95]]], np.uint8)
    mask = np.zeros((1, 3), np.uint8)
    mark(picture, limits, mask)
    assert mask.tolist() == [[255, 0, 255]]


GREY_TILES, CREAM_WALL = np.array([118.0, 121.0, 126.0]), np.array([128.0, 121.0, 107.0])


def test_a_cream_wall_in_its_own_shade_is_no_grey_floor():
    """Both have less chroma than a hue needs; the wall's saturation lies in the range of the tiles'."""
    rng = np.random.default_rng(6)
    tiles = np.clip(rng.normal(GREY_TILES, 5, (500, 3)), 0, 255).astype(np.uint8)
    limits = range_of(tiles, RangeConfig())
    picture = np.array([[GREY_TILES, 0.8 * GREY_TILES, CREAM_WALL, 0.9 * CREAM_WALL]])
    mask = np.zeros((1, 4), np.uint8)
    mark(picture.astype(np.uint8), limits, mask)
    assert mask.tolist() == [[255, 255, 0, 0]]
    low, high = limits.saturation
    assert low < 255 * np.ptp(CREAM_WALL) / CREAM_WALL.max() < high


@pytest.mark.parametrize("warmth", [(-0.05, 0.02), (0.1, 0.3)])
def test_colours_of_any_hue_are_bounded_by_their_warmth(warmth):
    rng = np.random.default_rng(7)
    limits = ColourRange(0.0, 180.0, (0.0, 255.0), (0.0, 255.0), 28.0, warmth)
    rgb = rng.integers(1, 256, (40, 50, 3), dtype=np.uint8)
    mask = np.zeros((40, 50), np.uint8)
    mark(rgb, limits, mask)
    r, g, b = rgb.astype(float).transpose(2, 0, 1)
    found = (r - b) / (r + g + b)
    near = np.abs(found[..., None] - np.array(warmth)).min(axis=-1) < 1e-3
    inside = (found > warmth[0]) & (found < warmth[1])
    np.testing.assert_array_equal(mask[~near] > 0, inside[~near])


def test_a_gradient_is_followed_and_an_edge_is_not_crossed():
    tiles = np.zeros((4, 12, 3), np.float32)
    tiles[:, :8] = (np.linspace(90, 220, 8)[:, None] * np.array([1.0, 0.9, 0.8]))[None]
    tiles[:, 8:] = (60.0, 60.0, 140.0)
    joined = grown(tiles, 2, 0.2, 0.06)
    assert joined[:, :8].all()
    assert not joined[:, 8:].any()


def eye(x=0.0, y=0.0):
    """Of a robot that has walked so far ahead and aside, m; it looks ahead and down."""
    return camera_pose(np.array([x, y, 0.42]), 0.0, math.radians(30.0), 0.0)


def floor_picture(tone, rng, obstacle=False):
    image = rng.normal(np.array(tone), 3.0, (240, 240, 3))
    if obstacle:
        image[:, 60:] = rng.normal([40, 60, 160], 3.0, (240, 180, 3))
    return np.clip(image, 0, 255).astype(np.uint8)


def test_light_that_fades_slowly_is_followed():
    rng = np.random.default_rng(2)
    colours = FloorColours(AdaptationConfig())
    for light in np.linspace(1.0, 0.45, 60):
        colours.learn(floor_picture(light * np.array([200, 180, 150]), rng))
    last = floor_picture(0.45 * np.array([200, 180, 150]), rng)
    mask = np.zeros((240, 240), np.uint8)
    mark(last, colours.range, mask)
    assert np.mean(mask > 0) > 0.95


def test_an_obstacle_in_the_patch_teaches_nothing():
    rng = np.random.default_rng(3)
    colours = FloorColours(AdaptationConfig())
    colours.learn(floor_picture([200, 180, 150], rng), eye())
    for _ in range(20):
        seen = floor_picture([200, 180, 150], rng, obstacle=True)
        colours.learn(seen, eye())
    mask = np.zeros((240, 240), np.uint8)
    mark(seen, colours.range, mask)
    assert np.mean(mask[:, :60] > 0) > 0.95
    assert not mask[:, 60:].any()


def test_a_wall_whose_foot_runs_aslant_through_the_tiles_teaches_nothing():
    """From one tile to the next only a little more of it is wall."""
    rng = np.random.default_rng(8)
    colours = FloorColours(AdaptationConfig())
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


def test_a_rug_becomes_floor_by_walking_on_it_and_not_by_standing_before_it_or_walking_along_it():
    rng = np.random.default_rng(4)
    rug = floor_picture([30, 130, 140], rng)
    ways = {
        "stands": (0.0, 0.0),
        "walks on": (0.04, 0.0),
        "along": (0.0, 0.04),
        "back": (-0.04, 0.0),
    }
    for way, (ahead, aside) in ways.items():
        colours = FloorColours(AdaptationConfig())
        colours.learn(floor_picture([200, 180, 150], rng), eye())
        for k in range(20):
            colours.learn(rug, eye(k * ahead, k * aside))
        mask = np.zeros((240, 240), np.uint8)
        mark(rug, colours.range, mask)
        if way == "walks on":
            assert np.mean(mask > 0) > 0.95
        else:
            assert not mask.any(), way


def test_a_rug_first_seen_by_a_glance_aside_becomes_floor_too():
    rng = np.random.default_rng(9)
    rug = floor_picture([30, 130, 140], rng)
    colours = FloorColours(AdaptationConfig())
    colours.learn(floor_picture([200, 180, 150], rng), eye())
    for k in range(20):
        x, y, z = eye(0.04 * k).translation
        aside = 0.0 if k % 2 else math.radians(75.0)
        colours.learn(rug, camera_pose(np.array([x, y, z]), aside, math.radians(30.0), 0.0))
    mask = np.zeros((240, 240), np.uint8)
    mark(rug, colours.range, mask)
    assert np.mean(mask > 0) > 0.95


def test_a_range_upside_down_is_refused():
    with pytest.raises(ConfigError, match="value"):
        ColourRange(0.0, 10.0, (0.0, 1.0), (200.0, 100.0), 28.0)
