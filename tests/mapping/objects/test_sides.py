"""Sides of an outline against their closed forms: which were seen, from where, and how well they are known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mapping.objects.columns import CELL_M, Columns, stack
from mapping.objects.footprints import voxels_of
from mapping.objects.sides import EDGE_SIGMA_M, Sides, box_of, sides_of

RING = np.array([[0.0, 0.0], [0.8, 0.0], [0.8, 0.4], [0.0, 0.4]])
NOISE, POSE = 0.02**2, 0.03**2


def columns(xy, sensor, noise=NOISE, pose=POSE) -> Columns:
    """One column of one voxel at each place."""
    n = len(xy)
    unknown = np.full(n, np.nan)
    return Columns(
        unknown,
        np.tile(np.asarray(sensor, np.float64), (n, 1)),
        np.full(n, pose),
        np.full(n, noise),
        np.full((n, 3), np.nan),
        unknown,
        np.asarray(xy, np.float64),
        np.ones(n),
        np.ones(n, np.int64),
        np.zeros(n),
        np.full(n, 0.3),
        np.ones(n, np.bool_),
    )


def on_side(number: int, share: float = 1.0) -> np.ndarray:
    """Places along the beginning of a side, 1 cm apart."""
    start, end = RING[number], RING[(number + 1) % 4]
    length = float(np.linalg.norm(end - start))
    at = np.arange(0.005, share * length, 0.01) / length
    return start + at[:, None] * (end - start)


@pytest.mark.parametrize(
    ("number", "sensor"), [(0, (0.3, -2.0)), (1, (3.0, 0.1)), (2, (0.3, 2.0)), (3, (-2.0, 0.1))]
)
def test_a_side_is_seen_from_its_outer_side_only(number, sensor):
    everywhere = np.concatenate([on_side(k) for k in range(4)])
    seen = sides_of(RING, columns(everywhere, sensor)).seen
    assert seen.tolist() == [k == number for k in range(4)]
    assert sides_of(RING, columns(everywhere, (np.nan, np.nan))).seen.all()


@pytest.mark.parametrize("turn", [0.0, 0.7, 2.0])
def test_the_deviation_is_that_of_the_bias_the_pose_and_the_mean_of_the_points(turn):
    """The pose moves all points alike; their noise averages over the side, a strip of two columns each."""
    c, s = math.cos(turn), math.sin(turn)
    R = np.array([[c, -s], [s, c]])
    found = sides_of(RING @ R.T, columns(on_side(0) @ R.T, R @ [0.4, -2.0]))
    strips = round(0.8 / (2 * CELL_M))
    assert found.sigma_m[0] ** 2 == pytest.approx(EDGE_SIGMA_M**2 + POSE + NOISE / strips)
    assert found.pose_m[0] ** 2 == pytest.approx(POSE)
    assert np.isnan(found.sigma_m[1:]).all()


def test_points_that_scatter_across_the_side_make_it_less_certain():
    rng = np.random.default_rng(0)
    places = np.tile(on_side(0), (40, 1))
    places[:, 1] += 0.012 * rng.normal(size=len(places))
    found = sides_of(RING, columns(places, (0.4, -2.0), 0.0, 0.0))
    assert found.sigma_m[0] ** 2 == pytest.approx(EDGE_SIGMA_M**2 + 0.012**2 / 20, rel=0.02)


@pytest.mark.parametrize(("share", "is_seen"), [(0.4, False), (0.6, True)])
def test_a_side_must_be_seen_over_half_its_length(share, is_seen):
    assert sides_of(RING, columns(on_side(0, share), (0.4, -2.0))).seen[0] == is_seen


def test_points_off_the_side_or_beyond_its_ends_do_not_show_it():
    off = on_side(0) + np.array([0.0, 0.06])
    beyond = on_side(0) - np.array([0.82, 0.0])
    assert not sides_of(RING, columns(off, (0.4, -2.0))).seen[0]
    assert not sides_of(RING, columns(beyond, (0.4, -2.0))).seen[0]


@pytest.mark.parametrize("first", range(4))
@pytest.mark.parametrize("turn", [0.0, 0.4, -1.2, 3.0])
def test_a_box_has_size_heading_and_doubt_of_its_sides(first, turn):
    """A size is the difference of two sides and the middle their mean: variances a + b and (a + b) / 4."""
    c, s = math.cos(turn), math.sin(turn)
    R = np.array([[c, -s], [s, c]])
    sigma = np.array([0.01, 0.02, 0.03, 0.04])
    order = np.roll(np.arange(4), -first)
    sides = Sides(np.ones(4, np.bool_), sigma[order], np.zeros(4))
    box = box_of((RING @ R.T)[order], sides)
    assert box is not None
    assert (box.length_m, box.width_m) == pytest.approx((0.8, 0.4))
    np.testing.assert_allclose(box.centre, R @ [0.4, 0.2])
    assert -math.pi / 2 <= box.yaw_rad < math.pi / 2
    assert math.sin(box.yaw_rad - turn) == pytest.approx(0.0, abs=1e-12)
    along, across = math.hypot(0.02, 0.04), math.hypot(0.01, 0.03)
    assert (box.sigma_length_m, box.sigma_width_m) == pytest.approx((along, across))
    expected = R @ np.diag([along**2, across**2]) @ R.T / 4.0
    np.testing.assert_allclose(box.covariance, expected, atol=1e-12)


def test_a_box_with_an_unseen_end_has_no_length_and_other_rings_are_no_boxes():
    seen = np.array([True, False, True, True])
    box = box_of(RING, Sides(seen, np.full(4, 0.01), np.zeros(4)))
    assert math.isnan(box.sigma_length_m)
    assert box.sigma_width_m == pytest.approx(0.01 * math.sqrt(2.0))
    assert box_of(RING[:3], Sides(seen[:3], np.full(3, 0.01), np.zeros(3))) is None


@pytest.mark.parametrize("drift_m", [0.0, 0.03])
def test_a_common_error_of_the_pose_moves_a_box_and_leaves_its_size_alone(drift_m):
    """Drawn errors: one pose for both sides, drift before the second is seen, and noise of each side."""
    rng = np.random.default_rng(1)
    common, own = 0.05, 0.01
    pose = np.array([common, math.hypot(common, drift_m)])[[0, 0, 1, 1]]
    box = box_of(RING, Sides(np.ones(4, np.bool_), np.hypot(pose, own), pose))
    first = common * rng.normal(size=50_000)
    second = first + drift_m * rng.normal(size=50_000)
    right, left = first + own * rng.normal(size=50_000), second + own * rng.normal(size=50_000)
    assert box.sigma_length_m == pytest.approx((right - left).std(), rel=0.02)
    assert math.sqrt(box.covariance[0, 0]) == pytest.approx(((right + left) / 2).std(), rel=0.02)
    np.testing.assert_allclose(box.covariance[1, 1], box.covariance[0, 0])
    assert box.sigma_width_m == pytest.approx(box.sigma_length_m)


def test_a_column_is_the_mean_of_its_voxels_and_outliers_beside_a_face_are_left_out():
    heights = np.arange(0.01, 0.30, 0.02)
    face = np.array([[x, 0.01, z] for x in (0.01, 0.03, 0.05) for z in heights])
    face[:, 1] += np.tile([-0.002, 0.002, 0.0], 15)
    outlier = np.array([[0.03, 0.05, 0.1]])
    found = stack(voxels_of(np.concatenate([face, outlier]), np.full(46, 2)))
    np.testing.assert_allclose(found.xy, [[0.01, 0.01], [0.03, 0.01], [0.05, 0.01]], atol=1e-12)
    assert found.count.tolist() == [15, 15, 15]
    assert found.weight.tolist() == [30.0, 30.0, 30.0]
    np.testing.assert_allclose(found.low, 0.01)
    np.testing.assert_allclose(found.top, 0.29)
    assert found.upright.all()
