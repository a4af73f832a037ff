"""Block matching against a direct implementation that sums every block of every disparity."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from perception.depth._stereo_trust_kernels import Rating
from perception.depth.block_matching import GRADIENT_LIMIT, match
from perception.primitives.errors import ConfigError

NEVER = 32767
RATING = Rating(np.float32(0.15), np.float32(0.12), np.float32(0.035))


def gradients(image, radius):
    """Clipped x-Sobel with repeated border, by OpenCV."""
    slope = cv2.Sobel(image, cv2.CV_16S, 1, 0, ksize=3, borderType=cv2.BORDER_REPLICATE)
    slope[:, 0], slope[:, -1] = slope[:, 1], slope[:, -2]
    cut = np.clip(slope, -GRADIENT_LIMIT, GRADIENT_LIMIT).astype(np.int64)
    return np.pad(cut, radius, mode="edge")


def volume(left, right, disparities, side=9):
    """(d, h, w) block costs, NEVER where the disparity leads out of the image."""
    height, width = left.shape
    a, b = (gradients(image, side // 2) for image in (left, right))
    costs = np.full((disparities, height, width), NEVER)
    for d in range(disparities):
        difference = np.abs(a[:, d:] - b[:, : b.shape[1] - d])
        blocks = np.lib.stride_tricks.sliding_window_view(difference, (side, side))
        costs[d, :, d:] = blocks.sum(axis=(2, 3))
    return costs


def images(seed=0, shape=(26, 70)):
    rng = np.random.default_rng(seed)
    left = cv2.GaussianBlur(rng.integers(0, 256, shape).astype(np.uint8), (0, 0), 1.0)
    shifted = np.roll(left, -5, axis=1).astype(np.int64) + rng.integers(-3, 4, shape)
    return left, np.clip(shifted, 0, 255).astype(np.uint8)


def test_disparity_and_costs_equal_those_of_direct_block_sums():
    left, right = images()
    found = match(left, right, 16, RATING, keep_costs=True)
    costs = volume(left, right, 16)
    best = costs.argmin(axis=0)  # the first of equals
    rows, columns = np.indices(left.shape)

    def at(offset):
        outside = (best + offset < 0) | (best + offset > 15)
        return np.where(outside, NEVER, costs[np.clip(best + offset, 0, 15), rows, columns])

    far = np.abs(np.arange(16)[:, None, None] - best) > 1
    rival = np.where(far, costs, NEVER).min(axis=0)
    back = np.full(left.shape, NEVER)
    for d in range(16):
        back[:, : 70 - d] = np.minimum(back[:, : 70 - d], costs[d, :, d:])
    expected = np.stack([at(-1), at(0), at(1), rival, back[rows, columns - best]], axis=1)
    np.testing.assert_array_equal(found.costs, expected)
    np.testing.assert_array_less(np.abs(found.disparity_px - best), 0.5 + 1e-6)


def test_the_result_is_the_same_whether_costs_are_kept_or_not():
    left, right = images(seed=1)
    kept, lean = (match(left, right, 16, RATING, keep_costs=keep) for keep in (True, False))
    for one in ("disparity_px", "reliability", "sigma_px"):
        np.testing.assert_array_equal(getattr(kept, one), getattr(lean, one))
    np.testing.assert_array_equal(lean.costs[0], kept.costs[-1])


def test_the_sub_pixel_part_is_the_tip_of_a_v_through_three_costs():
    left, right = images()
    found = match(left, right, 16, RATING, keep_costs=True)
    lower, here, higher = (found.costs[:, k].astype(np.float64) for k in range(3))
    inside = (lower < NEVER) & (higher < NEVER) & (np.maximum(lower, higher) > here + 1)
    arm = np.maximum(lower, higher) - here  # both arms of the V are as steep as the steeper one
    tip = 0.5 * (lower - higher) / arm
    part = found.disparity_px - np.rint(found.disparity_px - tip)
    np.testing.assert_allclose(part[inside], tip[inside], atol=1e-5)


def test_given_disparities_are_evaluated_at_their_own_values():
    left, right = images()
    costs = volume(left, right, 16)
    given = np.full(left.shape, 5.3, dtype=np.float32)
    given[3, 3] = np.nan
    judged = match(left, right, 16, RATING, given, keep_costs=True)
    np.testing.assert_array_equal(judged.costs[:, 1, 5:], costs[5, :, 5:])
    assert judged.costs[3, 1, 3] == costs[0, 3, 3]
    assert judged.disparity_px is given


def test_a_search_range_beyond_the_image_ends_at_its_width():
    left, right = images(shape=(12, 20))
    found = match(left, right, 128, RATING)
    assert found.disparity_px.shape == (12, 20)
    assert np.all(found.disparity_px <= np.arange(20) + 0.5)


def test_invalid_input_is_refused_with_a_message():
    left, right = images()
    with pytest.raises(ConfigError, match="disparities=0"):
        match(left, right, 0, RATING)
    with pytest.raises(ConfigError, match="6 px wide are too small"):
        match(left[:, :6], right[:, :6], 16, RATING)
