"""Depth coverage of the floor, against direct counts."""

from __future__ import annotations

import math

import numpy as np
import pytest

from perception.depth.coverage import answered_share
from perception.primitives.camera import Camera
from perception.primitives.frame import Depth
from perception.primitives.plane import Plane

CAMERA = Camera.from_view(160, 120, math.radians(60.0), math.radians(46.0))
HEIGHT_M = 0.38


def floor_below(tilt_deg: float) -> Plane:
    """The floor in the frame of a camera tilted down by `tilt_deg`."""
    tilt = math.radians(tilt_deg)
    return Plane(np.array([0.0, -math.cos(tilt), -math.sin(tilt)]), HEIGHT_M)


def image(has_depth: np.ndarray) -> Depth:
    z = np.where(has_depth, np.float32(1.0), np.float32(np.nan)).astype(np.float32)
    return Depth(z, z, CAMERA)


def on_floor(floor: Plane, nearest_m: float, farthest_m: float) -> np.ndarray:
    """Pixels whose point at nearest lies above the floor and at farthest below it."""
    near, far = (floor.distance(reach * CAMERA.rays) for reach in (nearest_m, farthest_m))
    return (near >= 0.0) & (far <= 0.0)


def test_coverage_is_one_for_a_full_image_and_zero_for_an_empty_one():
    floor = floor_below(30.0)
    whole = np.ones((120, 160), bool)
    assert answered_share(image(whole), floor, 0.2, 1.5) == 1.0
    assert answered_share(image(~whole), floor, 0.2, 1.5) == 0.0


@pytest.mark.parametrize("tilt_deg", [15.0, 30.0, 50.0])
def test_only_pixels_of_floor_within_range_count(tilt_deg):
    floor = floor_below(tilt_deg)
    expected = on_floor(floor, 0.2, 1.0)
    assert answered_share(image(expected), floor, 0.2, 1.0) == 1.0
    assert answered_share(image(~expected), floor, 0.2, 1.0) == 0.0


def test_depth_on_half_of_the_floor_gives_a_coverage_of_one_half():
    left = np.zeros((120, 160), bool)
    left[:, :80] = True
    assert answered_share(image(left), floor_below(30.0), 0.2, 1.5) == pytest.approx(0.5, abs=0.01)


def test_a_camera_that_does_not_see_the_floor_has_no_coverage():
    whole = np.ones((120, 160), bool)
    assert answered_share(image(whole), floor_below(-40.0), 0.2, 1.5) is None


def test_a_distorted_camera_uses_its_own_rays():
    bent = Camera(160, 120, 140.0, 140.0, 79.5, 59.5, (-0.1, 0.01, 0.0, 0.0, 0.0))
    floor = floor_below(30.0)
    near, far = (floor.distance(reach * bent.rays) for reach in (0.2, 1.0))
    expected = (near >= 0.0) & (far <= 0.0)
    z = np.where(expected, np.float32(1.0), np.float32(np.nan)).astype(np.float32)
    assert answered_share(Depth(z, z, bent), floor, 0.2, 1.0) == 1.0
