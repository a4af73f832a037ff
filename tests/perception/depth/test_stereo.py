"""Stereo: known and measured disparities, calibration of sigma, unreliable image regions."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from perception.depth import _stereo_trust_kernels as kernels
from perception.depth.block_matching import match
from perception.depth.points import from_depth
from perception.depth.stereo import StereoConfig, depth, disparity
from perception.floor.choose import find
from perception.floor.prior import handheld_prior
from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError, InputError
from perception.primitives.frame import StereoView

RATING = kernels.Rating(np.float32(0.15), np.float32(0.12), np.float32(0.035))
CAMERA = Camera(320, 240, 277.0, 277.0, 159.5, 119.5)
BASELINE_M = 0.08


def texture(rng, shape):
    """Aperiodic texture of six octaves."""
    image = np.zeros(shape, dtype=np.float32)
    for octave in range(6):
        grain = rng.normal(size=(max(shape[0] >> octave, 2), max(shape[1] >> octave, 2)))
        image += 12.0 * cv2.resize(
            grain.astype(np.float32), shape[::-1], interpolation=cv2.INTER_CUBIC
        )
    return image


def pair(truth, seed=0, noise=2.0, plain=None):
    """Grey pair of a scene whose disparity depends on the row alone; no texture from column `plain` on."""
    rng = np.random.default_rng(seed)
    height, width = truth.shape
    scene = texture(rng, (height, width + 200))
    v, u = np.mgrid[0:height, 0:width].astype(np.float32)
    left = cv2.remap(scene, u, v, cv2.INTER_CUBIC)
    right = cv2.remap(scene, u + truth.astype(np.float32), v, cv2.INTER_CUBIC)
    if plain is not None:
        left[u >= plain], right[u >= plain - truth] = 0.0, 0.0
    grey = [
        np.clip(128.0 + image + rng.normal(0.0, noise, image.shape), 0, 255).astype(np.uint8)
        for image in (left, right)
    ]
    return StereoView(grey[0], grey[1], BASELINE_M, CAMERA)


RAMP = np.linspace(5.0, 40.0, 240)[:, None].repeat(320, axis=1)


@pytest.fixture(params=["block", "sgbm", "bm"])
def config(request):
    return StereoConfig(method=request.param)


def test_a_slanted_plane_has_its_true_disparity(config):
    found = disparity(pair(RAMP), config)
    visible = np.arange(320)[None, :] > RAMP + 8
    reliable = found.reliability >= config.least_reliability
    assert np.mean(reliable[visible]) > 0.85  # StereoBM leaves a border out
    error = (found.disparity_px - RAMP)[reliable]
    assert np.mean(np.abs(error) > 1.0) < 0.005
    assert np.sqrt(np.mean(error[np.abs(error) < 1.0] ** 2)) < 0.25  # seed 003: sigma_d
    assert abs(np.median(error)) < 0.05
    assert np.mean(found.reliability[visible] > 0.5) > 0.85  # StereoBM leaves a border out


@pytest.mark.parametrize("noise", [1.0, 2.0, 4.0])
def test_sigma_matches_the_actual_errors(config, noise):
    found = disparity(pair(RAMP, seed=3, noise=noise), config)
    reliable = found.reliability >= config.least_reliability
    error = (found.disparity_px - RAMP)[reliable]
    right = np.abs(error) < 1.0
    normalised = np.sqrt(np.mean((error[right] / found.sigma_px[reliable][right]) ** 2))
    assert 0.5 < normalised < 1.5


def test_reliability_separates_wrong_disparities_from_correct_ones(config):
    stairs = np.where(np.arange(240)[:, None] < 120, 12.0, 24.0).repeat(320, axis=1)
    found = disparity(pair(stairs, plain=220), config)
    error = np.abs(found.disparity_px - stairs)
    there = np.isfinite(error)
    wrong = error[there] > 1.0
    order = np.argsort(found.reliability[there], kind="stable")
    rank = np.empty(len(order))
    rank[order] = np.arange(1, len(order) + 1)
    right = ~wrong
    area = rank[right].sum() - right.sum() * (right.sum() + 1) / 2
    assert area / (right.sum() * wrong.sum()) > 0.85  # seed 003, E2


def test_votes_equal_those_of_a_direct_count():
    rng = np.random.default_rng(5)
    drawn = rng.integers(3, 7, (24, 33)).astype(np.float32) + rng.uniform(-0.5, 0.5, (24, 33))
    drawn = drawn.astype(np.float32)
    drawn[5, 7], drawn[9, 20] = np.nan, 30.0  # no disparity; beyond the left border
    columns = np.arange(33, dtype=np.float32)
    there = (drawn >= 2.0) & (drawn <= columns)
    whole = np.where(there, np.trunc(16.0 * np.nan_to_num(drawn)), -8000.0)
    padded, expected = np.pad(whole, 10, mode="edge"), np.zeros((24, 33))
    for step, weight, limit in ((2, 3, 16), (5, 1, 24)):
        for i in range(-2, 3):
            for j in range(-2, 3):
                rows, places = 10 + step * i, 10 + step * j
                other = padded[rows : rows + 24, places : places + 33] - whole
                rows, places = 10 - step * i, 10 - step * j
                opposite = padded[rows : rows + 24, places : places + 33] - whole
                slanted = np.abs(other + opposite) <= limit
                slanted &= np.abs(other - opposite) <= 32 * step  # half a pixel per pixel
                agrees = (np.abs(other) <= limit) | slanted
                expected += weight * agrees * (i != 0 or j != 0)
    sixteenths, votes = kernels.in_sixteenths(drawn), np.empty(drawn.shape, np.int16)
    for y, row in enumerate(votes):
        kernels.count_votes(sixteenths, y, row)
    np.testing.assert_array_equal(votes, expected)


def test_given_disparities_get_the_same_costs_as_searched_ones():
    view = pair(RAMP)
    own = match(view.left, view.right, 48, RATING, keep_costs=True)
    judged = match(view.left, view.right, 48, RATING, own.disparity_px, keep_costs=True)
    same = np.rint(own.disparity_px) == np.rint(own.disparity_px - 1e-3)  # not half-way between two
    agree = judged.costs.transpose(0, 2, 1)[same] == own.costs.transpose(0, 2, 1)[same]
    assert np.mean(agree.all(axis=1)) > 0.95  # the sub-pixel part may reach the next disparity


def test_depth_and_its_sigma_follow_from_disparity(config):
    view = pair(RAMP)
    matched, seen = disparity(view, config), depth(view, config)
    fB = 277.0 * BASELINE_M
    ok = np.isfinite(seen.z)
    np.testing.assert_allclose(seen.z[ok], fB / matched.disparity_px[ok], rtol=1e-5)
    np.testing.assert_allclose(
        seen.sigma[ok], seen.z[ok] ** 2 * matched.sigma_px[ok] / fB, rtol=1e-4
    )
    assert np.array_equal(ok, np.isfinite(seen.sigma))
    assert np.all(matched.reliability[ok] >= config.least_reliability)


def test_a_wall_without_texture_has_no_depth(config):
    seen = depth(pair(RAMP, plain=180), config)
    assert np.mean(np.isfinite(seen.z[:, 190:])) < 0.05  # seed 003-E7
    assert np.mean(np.isfinite(seen.z[:, 60:170])) > 0.8


def plain_pair(left, right, seed=0, noise=2.0):
    """A pair of images without texture, with sensor noise."""
    rng = np.random.default_rng(seed)
    grey = [
        np.clip(image + rng.normal(0.0, noise, image.shape), 0, 255).astype(np.uint8)
        for image in (left, right)
    ]
    return StereoView(grey[0], grey[1], BASELINE_M, CAMERA)


def test_beside_the_lone_edge_of_a_plain_board_there_is_no_depth(config):
    left, right = np.full((240, 320), 90.0), np.full((240, 320), 90.0)
    left[60:, 150:220], right[60:, 130:200] = 150.0, 150.0  # 20 px before a plain wall
    z = depth(plain_pair(left, right), config).z
    assert np.mean(np.isfinite(z[:, 100:150])) < 0.005  # the wall, where blocks see the edge


def test_a_textured_thing_before_a_plain_wall_keeps_its_depth():
    rng = np.random.default_rng(4)
    patch = 120.0 + texture(rng, (60, 60))
    left, right = np.full((240, 320), 90.0), np.full((240, 320), 90.0)
    left[100:160, 150:210], right[100:160, 130:190] = patch, patch
    z = depth(plain_pair(left, right)).z
    inner = z[110:150, 160:200]
    assert np.mean(np.isfinite(inner)) > 0.8
    assert np.nanmax(np.abs(277.0 * BASELINE_M / inner - 20.0)) < 1.0


def test_unrelated_images_give_no_depth(config):
    one, other = pair(RAMP, seed=1), pair(RAMP, seed=2)
    seen = depth(StereoView(one.left, other.right, BASELINE_M, CAMERA), config)
    assert np.mean(np.isfinite(seen.z)) < 0.05


def test_the_left_border_is_matched_too(config):
    far = np.full((240, 320), 6.0)
    seen = depth(pair(far), config)
    assert (
        np.mean(np.isfinite(seen.z[20:-20, 20:60])) > 0.8
    )  # within the search range of the border


def test_reliable_pixels_of_a_real_pair_are_correct(recordings, config):
    folder = recordings / "middlebury_motorcycle"
    left, right = (
        cv2.imread(str(folder / f"motorcycle_{side}.png"), cv2.IMREAD_GRAYSCALE)
        for side in ("left", "right")
    )
    truth = np.load(folder / "motorcycle_disp.npz")["arr_0"]
    camera = Camera(741, 500, 994.978, 994.978, 311.193, 254.877)
    found = disparity(StereoView(left, right, 0.193, camera), config)
    known = np.isfinite(found.disparity_px) & np.isfinite(truth)
    wrong = np.abs(found.disparity_px - truth)[known] > 2.0
    reliable = found.reliability[known] >= config.least_reliability
    assert np.mean(wrong[reliable]) < 0.05  # StereoBM with its own filters: 0.067 of 85 %
    assert np.mean(wrong[reliable]) < 0.5 * np.mean(wrong)
    assert np.mean(reliable) > 0.7


def test_the_floor_of_a_real_pair_is_found(recordings, config):
    folder = recordings / "rtabmap_3it"
    left, right = (
        cv2.imread(str(folder / f"stereo_50_{side}.jpg"), cv2.IMREAD_GRAYSCALE)
        for side in ("left", "right")
    )
    camera = Camera(640, 480, 487.609, 487.609, 318.116, 249.444)
    points = from_depth(depth(StereoView(left, right, 0.11969, camera), config), 0.2, 6.0, 2)
    found = find(points, handheld_prior(None), np.random.default_rng(0))
    assert abs(found.plane.offset_m - 1.11) < 0.02
    assert abs(np.degrees(np.arcsin(-found.plane.normal[2])) - 3.7) < 0.5  # down by 3.7 deg
    assert found.share > 0.85


def test_invalid_input_is_refused_with_a_message():
    view = pair(RAMP)
    with pytest.raises(InputError, match="must be rectified to one size"):
        depth(StereoView(view.left[:-1], view.right[:-1], BASELINE_M, CAMERA))
    with pytest.raises(InputError, match=r"baseline_m=0\.0"):
        depth(StereoView(view.left, view.right, 0.0, CAMERA))
    with pytest.raises(ConfigError, match="choose block, sgbm, bm"):
        StereoConfig(method="elas")
    with pytest.raises(ConfigError, match="most_disparity_px=8"):
        StereoConfig(most_disparity_px=8)


def test_a_wide_pair_sees_what_is_near():
    """A wall 0.5 m before a pair of 20 cm, at 210 px."""
    camera = Camera(640, 60, 525.0, 525.0, 319.5, 29.5)
    scene = 128.0 + texture(np.random.default_rng(0), (60, 1000))
    images = [np.clip(scene[:, start : start + 640], 0, 255).astype(np.uint8) for start in (0, 210)]
    found = depth(StereoView(*images, 0.2, camera))
    shown = found.z[:, 230:]
    assert np.mean(np.isfinite(shown)) > 0.8
    assert np.nanmax(np.abs(shown - 0.5)) < 0.005


def test_a_floor_that_slants_by_a_quarter_of_a_pixel_per_row_is_seen():
    """As a pair of 12 cm sees it from 46 cm above it."""
    slanted = 10.0 + 0.26 * np.arange(240.0)[:, None].repeat(320, axis=1)
    config = StereoConfig()
    found = disparity(pair(slanted), config)
    visible = np.arange(320)[None, :] > slanted + 8
    reliable = found.reliability >= config.least_reliability
    assert np.mean(reliable[visible]) > 0.85
    assert np.mean(np.abs(found.disparity_px - slanted)[reliable & visible] > 1.0) < 0.005
