"""What may be hidden behind an obstacle, on drawings of known boxes without noise."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from mapping.panorama import hidden_corners
from mapping.panorama.hidden_corners import with_hidden_corners
from mapping.panorama.obstacles import SEEN_M, PanoramaObstacle, gaps_between
from mapping.panorama.rendering import Drawing
from mapping.panorama.sphere import Sphere
from perception.primitives.plane import Plane

FLOOR = Plane(np.array([0.0, 0.0, 1.0]), 0.0)
CAMERA_M, WALL_M, PX_RAD = 0.55, 4.0, math.radians(0.25)
SPHERE = Sphere.window(-1.1, 1.1, -0.5, 0.1, 1.0 / PX_RAD)


def drawing_of(corners, height_m, known=True):
    """A camera above the origin sees a box with these corners (counter-clockwise), the floor, and a round wall.

    Returns:
        The drawing and the labels of the box; with `known` False the floor returns no range.
    """
    rays = SPHERE.rays
    flat = np.hypot(rays[..., 0], rays[..., 1])
    way, drop = rays[..., :2] / flat[..., None], rays[..., 2] / flat
    near, far = np.zeros(flat.shape), np.full(flat.shape, np.inf)
    for one, other in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        normal = np.array([other[1] - one[1], one[0] - other[0]])  # outward
        towards, ahead = way @ normal, float(normal @ one)
        with np.errstate(divide="ignore"):
            crossing = ahead / towards
        near = np.where(towards < 0.0, np.maximum(near, crossing), near)
        far = np.where(towards > 0.0, np.minimum(far, crossing), far)
    enters = near < far
    face = enters & (CAMERA_M + near * drop <= height_m) & (CAMERA_M + near * drop >= 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        top_at, floor_at = (height_m - CAMERA_M) / drop, -CAMERA_M / drop
    top = enters & ~face & (drop < 0.0) & (top_at >= near) & (top_at <= far)
    behind = np.where((drop < 0.0) & (floor_at < WALL_M), floor_at if known else np.nan, WALL_M)
    reach = np.where(face, near, np.where(top, top_at, behind))
    range_m = (reach / flat).astype(np.float32)
    centre = np.array([0.0, 0.0, CAMERA_M])
    sigma = np.full(range_m.shape, 0.004, np.float32)
    view = np.zeros(range_m.shape, np.int64)
    drawing = Drawing(SPHERE, centre, range_m, sigma, view.astype(float), view)
    return drawing, np.where(face, 1, 0).astype(np.int32)  # level sets often lose a top face


def rectangle(x, y, depth, width, yaw):
    half = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * np.array([depth, width]) / 2
    turn = np.array([[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]])
    return half @ turn + [x, y]


def seen_of(corners, height_m, labels):
    """The listed obstacle, by its true silhouettes."""
    azimuth = np.arctan2(corners[:, 1], corners[:, 0])
    left, right = corners[np.argmax(azimuth)], corners[np.argmin(azimuth)]
    return PanoramaObstacle(
        left_rad=float(azimuth.max()),
        right_rad=float(azimuth.min()),
        distance_m=float(corners[:, 0].min()),
        width_m=max(float(left[1] - right[1]), 0.0),
        height_m=height_m,
        left_edge_m=(float(left[0]), float(left[1])),
        right_edge_m=(float(right[0]), float(right[1])),
        label=1,
        pixels=int((labels == 1).sum()),
    )


def found_of(corners, height_m, known=True):
    drawing, labels = drawing_of(corners, height_m, known)
    (found,) = with_hidden_corners([seen_of(corners, height_m, labels)], drawing, labels, FLOOR)
    return found


@settings(deadline=None, max_examples=12)
@given(
    st.floats(0.9, 1.8),
    st.floats(0.3, 0.8),
    st.floats(0.15, 0.6),
    st.floats(0.15, 0.6),
    st.floats(0.0, math.pi),
    st.floats(0.1, 0.5),
    st.booleans(),
)
def test_the_hidden_corner_lies_between_the_seen_edge_and_the_farthest_place(
    x, y, depth, width, yaw, height, known
):
    corners = rectangle(x, y, depth, width, yaw)
    assume(corners[:, 1].min() > 0.0)  # all of it lies left of straight ahead
    found = found_of(corners, height, known)
    true = corners[:, 1].max()
    assert found.left_edge_m[1] <= true + 0.02  # no further than a pixel at a grazing angle
    assert found.left_edge_m[1] + found.hidden_left_m >= true - 0.005
    assert found.hidden_right_m == 0.0  # turned to straight ahead: always seen


def test_a_low_box_shows_its_corner_over_its_top_and_a_high_one_hides_it():
    corners = rectangle(1.2, 0.7, 0.3, 0.2, math.atan2(0.7, 1.2))  # shows one face only
    low, high = found_of(corners, 0.15), found_of(corners, 0.60)
    true = corners[:, 1].max()
    assert low.hidden_left_m < 0.05
    assert low.left_edge_m[1] == pytest.approx(true, abs=0.05)
    assert high.left_edge_m[1] < true - 0.1
    assert high.hidden_left_m > 0.2


def test_a_box_higher_than_the_camera_is_as_deep_as_furniture_or_as_the_wall_behind():
    corners = rectangle(1.2, 0.7, 0.3, 0.2, math.atan2(0.7, 1.2))
    found = found_of(corners, 0.60)
    front = min(np.hypot(*corners.T))
    deepest = (front + hidden_corners.DEEPEST_M) * math.sin(found.left_rad)
    assert found.left_edge_m[1] + found.hidden_left_m == pytest.approx(deepest, abs=0.02)


def test_mirrored_boxes_hide_mirrored_corners():
    corners = rectangle(1.2, 0.7, 0.3, 0.25, 0.3)
    mirrored = (corners * [1.0, -1.0])[::-1]
    one, other = found_of(corners, 0.4), found_of(mirrored, 0.4)
    assert one.hidden_left_m == pytest.approx(other.hidden_right_m, abs=0.02)
    assert one.hidden_right_m == other.hidden_left_m == 0.0


def test_an_edge_behind_a_nearer_obstacle_may_extend_to_its_far_side():
    corners = rectangle(1.8, 0.6, 0.2, 0.4, 0.0)
    drawing, labels = drawing_of(corners, 0.3)
    behind = seen_of(corners, 0.3, labels)
    occluded = replace(behind, cut_right=True)
    y = math.tan(behind.right_rad)  # the nearer one ends where the other begins
    nearer = PanoramaObstacle.across(y, y - 0.2, 1.0, 0.3)
    labels = np.where((labels == 0) & (np.indices(labels.shape)[0] < 3), 2, labels).astype(np.int32)
    nearer = replace(nearer, label=2)
    found = with_hidden_corners([occluded, nearer], drawing, labels, FLOOR)[0]
    x = behind.right_edge_m[0]
    assert found.hidden_right_m == pytest.approx(0.2 * x, abs=0.01)


@given(st.floats(0.0, 0.3), st.floats(0.1, 0.5))
def test_a_hidden_corner_only_narrows_a_gap(hidden, free):
    """Mean and standard deviation of a density that falls linearly from 0 to `hidden`."""
    plain = PanoramaObstacle.across(0.9, 0.5, 1.0, 0.3)
    right = PanoramaObstacle.across(0.5 - free, -0.4, 1.0, 0.3)
    doubt = replace(right, hidden_left_m=hidden)
    ends = 1.4, -1.4
    sure = gaps_between((plain, right), ends, 2.5)[1]
    assert (sure.corners_seen, sure.hidden_m) == (2, 0.0)
    (gap,) = [
        one for one in gaps_between((plain, doubt), ends, 2.5) if (one.left, one.right) == (0, 1)
    ]
    samples = hidden * (1.0 - np.sqrt(1.0 - (np.arange(20_000) + 0.5) / 20_000))
    assert gap.width_m == pytest.approx(sure.width_m - samples.mean(), abs=1e-4)
    assert gap.sigma_width_m == pytest.approx(samples.std(), abs=1e-4)
    assert gap.corners_seen == (2 if hidden <= SEEN_M else 1)
