"""The depth sources: one place from which every user of depth takes it."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest

from perception.depth import sources, stereo, structured_light, time_of_flight
from perception.depth.sources import DepthSources, registered_picture
from perception.primitives.camera import Camera
from perception.primitives.frame import ColourView, DepthView, Frame, RangeView, StereoView
from perception.primitives.pose import Pose3

CAMERA = Camera(64, 48, 60.0, 60.0, 31.5, 23.5)


@pytest.fixture
def frame():
    """A wall at 1.5 m in front of all three sensors, and a colour picture of the depth camera's pixels."""
    rng = np.random.default_rng(0)
    texture = rng.integers(0, 255, (48, 72), dtype=np.uint8)
    pair = StereoView(texture[:, 4:68].copy(), texture[:, 8:72].copy(), 0.1, CAMERA)
    flat = np.full((48, 64), 1.5, np.float32)
    return Frame(
        1.0,
        tof=RangeView(flat, None, CAMERA),
        depth=DepthView(flat, CAMERA),
        stereo=pair,
        colour=ColourView(np.zeros((48, 64, 3), np.uint8), CAMERA),
    )


def test_each_sensor_of_the_frame_gives_the_depth_of_its_own_function(frame):
    given = DepthSources()
    images = dict(given.images(frame))
    assert list(images) == ["tof", "depth", "stereo"]
    expected = {
        "tof": time_of_flight.depth(frame.tof, given.tof),
        "depth": structured_light.depth(frame.depth, given.structured_light),
        "stereo": stereo.depth(frame.stereo, given.stereo),
    }
    for name, depth in images.items():
        np.testing.assert_array_equal(depth.z, expected[name].z)
        np.testing.assert_array_equal(depth.sigma, expected[name].sigma)


def test_a_frame_without_depth_gives_no_image():
    frame = Frame(1.0)
    assert list(DepthSources().images(frame)) == []
    assert DepthSources().for_odometry(frame) is None


def test_depth_is_computed_once_for_all_users_of_a_frame(frame, monkeypatch):
    calls = []
    original = stereo.depth
    monkeypatch.setattr(sources.stereo, "depth", lambda *given: calls.append(1) or original(*given))
    given = DepthSources()
    for _ in range(2):
        list(given.images(frame))
    assert len(calls) == 1
    list(given.images(replace(frame, stamp_s=2.0)))
    assert len(calls) == 2


def test_odometry_takes_the_depth_camera_first_then_stereo_then_time_of_flight(frame):
    given = DepthSources()
    assert given.for_odometry(frame).sensor == "depth"
    assert given.for_odometry(replace(frame, depth=None)).sensor == "stereo"
    assert given.for_odometry(replace(frame, depth=None, stereo=None)).sensor == "tof"


def test_only_a_picture_of_the_same_camera_belongs_to_a_depth_image(frame):
    assert registered_picture(frame, "depth") is frame.colour.rgb
    np.testing.assert_array_equal(registered_picture(frame, "stereo")[:, :, 1], frame.stereo.left)
    assert registered_picture(frame, "tof") is None
    mounted = Pose3.from_rotation(np.eye(3), np.array([0.0, 0.0, 0.1]))
    elsewhere = replace(frame, colour=replace(frame.colour, T_body_camera=mounted))
    assert registered_picture(elsewhere, "depth") is None


def test_a_checkpoint_does_not_hold_the_images_of_a_frame(frame):
    given = DepthSources()
    list(given.images(frame))
    copy = pickle.loads(pickle.dumps(given))
    assert copy == given
    assert len(pickle.dumps(given)) < 2000
