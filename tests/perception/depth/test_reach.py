"""The pixels that are used of a depth image."""

from __future__ import annotations

import numpy as np
import pytest

from perception.depth.reach import ReachesConfig
from perception.primitives.camera import Camera
from perception.primitives.frame import Depth


def image(width: int, focal_px: float = 500.0, baseline_m: float = 0.0) -> Depth:
    """A depth image; its values do not matter here."""
    camera = Camera(width, 4, focal_px, focal_px, width / 2.0, 2.0)
    return Depth(
        np.ones((4, width), np.float32), np.ones((4, width), np.float32), camera, None, baseline_m
    )


@pytest.mark.parametrize(
    ("source", "width", "stride"),
    [("depth", 640, 2), ("depth", 160, 2), ("depth", 100, 1), ("stereo", 64, 1), ("tof", 176, 1)],
)
def test_every_pixel_of_a_narrow_image_is_used(source, width, stride):
    config = ReachesConfig()
    found = config.of(source, image(width))
    assert found.stride == stride
    assert found.farthest_m == getattr(config, source).farthest_m


@pytest.mark.parametrize(
    ("focal_px", "baseline_m"), [(554.0, 0.04), (435.0, 0.11), (707.0, 0.537), (277.0, 0.04)]
)
def test_a_longer_pair_reaches_as_far_as_its_depth_is_as_good(focal_px, baseline_m):
    """sigma_Z = Z^2 sigma_d / (f B) at the farthest depth; the pairs of seed 003, EuRoC and KITTI, and a shorter one."""
    config = ReachesConfig()
    far_m = config.of("stereo", image(640, focal_px, baseline_m)).farthest_m
    of_seed = config.stereo.farthest_m**2 / (554.0 * 0.04)
    if focal_px * baseline_m < 554.0 * 0.04:
        assert far_m == config.stereo.farthest_m
    else:
        assert far_m**2 / (focal_px * baseline_m) == pytest.approx(of_seed, rel=2e-3)
    assert (
        config.of("depth", image(640, focal_px, baseline_m)).farthest_m == config.depth.farthest_m
    )
