"""The pixels that are used of a depth image."""

from __future__ import annotations

import pytest

from perception.depth.reach import ReachesConfig


@pytest.mark.parametrize(
    ("source", "width", "stride"),
    [("depth", 640, 2), ("depth", 160, 2), ("depth", 100, 1), ("stereo", 64, 1), ("tof", 176, 1)],
)
def test_every_pixel_of_a_narrow_image_is_used(source, width, stride):
    config = ReachesConfig()
    assert config.of(source, width).stride == stride
    assert config.of(source, width).farthest_m == config.of(source).farthest_m
