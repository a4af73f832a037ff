"""Features: OpenCV's keypoints, our orientations, and their rotation with the image."""

from __future__ import annotations

import re

import cv2
import numpy as np
import pytest
from scipy.spatial import cKDTree

from perception.features import _orientation_kernels as kernels
from perception.features.gaussian_hermite import gradient
from perception.features.matching import match
from perception.features.mdghm_sift import SiftConfig, _gradient_field, _moment_masks, detect
from perception.features.pictures import amplitude_picture, range_picture
from perception.primitives.errors import ConfigError, InputError

OURS = [SiftConfig(), SiftConfig(first_order=False), SiftConfig(method="difference")]
ALL = [*OURS, SiftConfig(moments_in_descriptor=True), SiftConfig(method="opencv")]


def picture(side=160, seed=0):
    rng = np.random.default_rng(seed)
    grey = np.full((side, side), 110.0)
    for _ in range(60):
        corners = cv2.boxPoints(
            (
                tuple(float(v) for v in rng.uniform(10, side - 10, 2)),
                tuple(float(v) for v in rng.uniform(5, side / 5, 2)),
                float(rng.uniform(0, 180)),
            )
        )
        cv2.fillConvexPoly(grey, corners.astype(np.int32), float(rng.uniform(10, 240)))
    return np.clip(cv2.GaussianBlur(grey, (0, 0), 0.8), 0, 255).astype(np.uint8)


def off_deg(angles, others):
    return np.degrees(np.abs((angles - others + np.pi) % (2 * np.pi) - np.pi))


@pytest.mark.parametrize("first_order", [False, True])
def test_the_kernel_agrees_with_the_gradient_by_moments(first_order):
    level = np.random.default_rng(0).uniform(0, 1, (50, 60)).astype(np.float32)
    masks = _moment_masks(1.6, (1, 3, 5))
    gx, gy = _gradient_field(level, masks, first_order)
    magnitude, direction = gradient(level, first_order=first_order)
    np.testing.assert_allclose(np.hypot(gx, gy), magnitude, atol=1e-5)
    clear = magnitude > 1e-3
    assert off_deg(np.arctan2(gy, gx), direction)[clear].max() < 0.2


def test_the_fast_arc_tangent_is_accurate():
    rng = np.random.default_rng(1)
    x, y = rng.normal(size=(2, 5000)).astype(np.float32)
    out = np.empty(5000, np.float32)
    kernels.angles(x, y, 5000, out)
    assert np.abs(out - np.arctan2(y, x)).max() < 2e-5


@pytest.mark.parametrize("config", OURS)
def test_keypoints_agree_with_opencv(config):
    image = picture()
    ours, theirs = detect(image, config), detect(image, SiftConfig(method="opencv"))
    distance, nearest = cKDTree(ours.pixels).query(theirs.pixels)
    near = distance < 1.0
    assert near.mean() > 0.85
    ratio = ours.sigma_px[nearest[near]] / theirs.sigma_px[near]
    assert np.median(np.abs(np.log(ratio))) < 0.05
    assert 0.8 < len(ours) / len(theirs) < 1.25


def test_directions_by_differences_agree_with_opencv():
    image = picture()
    ours = detect(image, SiftConfig(method="difference"))
    theirs = detect(image, SiftConfig(method="opencv"))
    best = []
    for pixel, sigma, angle in zip(theirs.pixels, theirs.sigma_px, theirs.angle_rad, strict=True):
        near = np.linalg.norm(ours.pixels - pixel, axis=1) < 1.0
        near &= np.abs(np.log(ours.sigma_px / sigma)) < 0.2
        if near.any():
            best.append(off_deg(ours.angle_rad[near], angle).min())
    assert np.median(best) < 3.0


@pytest.mark.parametrize("config", ALL)
def test_features_rotate_with_the_image(config):
    image = picture()
    turned = np.ascontiguousarray(np.rot90(image))  # (u, v) -> (v, side - 1 - u)
    one, other = detect(image, config), detect(turned, config)
    pairs = match(one.descriptors, other.descriptors)
    assert len(pairs) > 0.6 * len(one)
    u, v = one.pixels[pairs[:, 0]].T
    there = np.column_stack([v, len(image) - 1 - u])
    right = np.linalg.norm(there - other.pixels[pairs[:, 1]], axis=1) < 1.5
    assert right.mean() > 0.95
    angle = one.angle_rad[pairs[right, 0]] - np.pi / 2
    assert np.median(off_deg(angle, other.angle_rad[pairs[right, 1]])) < 2.0


def test_as_printed_all_directions_lie_in_one_quadrant():
    angle = np.degrees(detect(picture(), SiftConfig(literal=True)).angle_rad)
    assert len(angle) > 20
    assert angle.min() > -10.0
    assert angle.max() < 100.0
    ours = np.degrees(detect(picture(), SiftConfig()).angle_rad)
    assert (ours.min(), ours.max()) < (-100.0, 100.0)


@pytest.mark.parametrize("config", ALL)
def test_descriptors_have_unit_length(config):
    found = detect(picture(), config)
    assert len(found) > 20
    np.testing.assert_allclose(np.linalg.norm(found.descriptors, axis=1), 1.0, atol=1e-3)


@pytest.mark.parametrize("config", ALL)
def test_features_are_reproducible_bit_for_bit(config):
    one, other = detect(picture(), config), detect(picture(), config)
    assert np.array_equal(one.pixels, other.pixels)
    assert np.array_equal(one.descriptors, other.descriptors)


@pytest.mark.parametrize("config", ALL)
def test_an_image_without_contrast_has_no_features(config):
    assert len(detect(np.full((90, 120), 77, np.uint8), config)) == 0
    assert len(detect(np.full((9, 12), 77, np.uint8), config)) == 0


def test_features_lie_in_the_mask_and_number_at_most_the_limit():
    image = picture()
    valid = np.zeros(image.shape, bool)
    valid[:, :80] = True
    found = detect(image, SiftConfig(most=25), valid)
    assert len(found) == 25
    assert found.pixels[:, 0].max() < 80.5
    every = detect(image, None, valid)
    assert found.response.min() >= np.sort(every.response)[-25]


def test_a_blob_is_found_at_its_centre_and_scale():
    v, u = np.mgrid[0:100, 0:120]
    for sigma in (3.0, 5.0):
        blob = 40 + 180 * np.exp(-((u - 61.3) ** 2 + (v - 48.6) ** 2) / (2 * sigma**2))
        found = detect(blob.astype(np.uint8))
        strongest = int(np.argmax(found.response))
        np.testing.assert_allclose(found.pixels[strongest], [61.3, 48.6], atol=0.15)
        # the difference of Gaussians answers most where the lower blur equals the blob, over root k
        assert found.sigma_px[strongest] == pytest.approx(sigma / 2 ** (1 / 6), rel=0.15)


def test_an_oblique_view_of_graffiti_is_matched_as_well_as_by_opencv(recordings):
    folder = recordings / "opencv_samples"
    images = [
        cv2.imread(str(folder / name), 0)[::2, ::2].copy() for name in ("graf1.png", "graf3.png")
    ]
    text = re.search(r"<data>(.*?)</data>", (folder / "H1to3p.xml").read_text(), re.DOTALL)
    matrix = np.array([float(word) for word in text.group(1).split()]).reshape(3, 3)
    half = np.diag([0.5, 0.5, 1.0])
    matrix = half @ matrix @ np.linalg.inv(half)
    right = {}
    for config in (SiftConfig(), SiftConfig(method="opencv")):
        one, other = (detect(image, config) for image in images)
        pairs = match(one.descriptors, other.descriptors)
        lifted = np.column_stack([one.pixels[pairs[:, 0]], np.ones(len(pairs))]) @ matrix.T
        off = np.linalg.norm(lifted[:, :2] / lifted[:, 2:] - other.pixels[pairs[:, 1]], axis=1)
        right[config.method] = int((off < 3.0).sum())
    assert right["mdghm"] >= 0.8 * right["opencv"]


def test_matches_agree_with_exhaustive_search():
    rng = np.random.default_rng(4)
    a, b = rng.normal(size=(40, 16)), rng.normal(size=(60, 16))
    b[:30] = a[:30] + 0.2 * rng.normal(size=(30, 16))
    a, b = (x / np.linalg.norm(x, axis=1, keepdims=True) for x in (a, b))
    distance = np.linalg.norm(a[:, None] - b[None], axis=2)
    expected = []
    for i in range(40):
        order = np.argsort(distance[i])
        if (
            distance[i, order[0]] < 0.8 * distance[i, order[1]]
            and distance[:, order[0]].argmin() == i
        ):
            expected.append((i, order[0]))
    found = match(a.astype(np.float32), b.astype(np.float32))
    np.testing.assert_array_equal(found, expected)
    assert len(match(np.zeros((0, 16), np.float32), b.astype(np.float32))) == 0


def test_range_and_amplitude_pictures_have_contrast_and_no_holes():
    v, u = np.mgrid[0:144, 0:176].astype(np.float32)
    range_m = 1.5 + 0.05 * np.sin(u / 5) * np.sin(v / 5)
    range_m[40:50, 60:90] = np.nan
    grey = range_picture(range_m, 5.0)
    assert grey.std() > 20.0
    filled = range_m.copy()
    filled[40:50, 60:90] = 1.5
    assert np.abs(range_picture(filled, 5.0).astype(int) - grey)[100:].max() < 40
    assert amplitude_picture(np.exp(np.nan_to_num(range_m, nan=1.5))).std() > 20.0
    with pytest.raises(InputError, match="farthest_m=0"):
        range_picture(range_m, 0.0)
    assert np.ptp(range_picture(np.full((40, 40), np.nan, np.float32), 5.0)) == 0


def test_impossible_settings_are_refused():
    with pytest.raises(ConfigError, match="method='surf' is unknown"):
        SiftConfig(method="surf")
    with pytest.raises(ConfigError, match=r"orders=\(2,\)"):
        SiftConfig(orders=(2,))
    with pytest.raises(InputError, match="mask of"):
        detect(picture(), None, np.ones((3, 3), bool))
