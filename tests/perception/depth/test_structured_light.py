"""Structured light: published noise and invalid depth."""

from __future__ import annotations

import numpy as np
import pytest

from perception.depth.structured_light import StructuredLightConfig, depth
from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError, InputError
from perception.primitives.frame import DepthView
from perception.primitives.pose import Pose3

CAMERA = Camera(4, 1, 4.0, 4.0, 1.5, 0.0)


def test_noise_matches_the_published_values():
    seen = depth(DepthView(np.array([[0.4, 1.4, 2.4, 4.4]], dtype=np.float32), CAMERA))
    np.testing.assert_allclose(seen.sigma, [[0.0012, 0.0031, 0.0088, 0.0316]], rtol=1e-5)


def test_invalid_depth_is_nan_and_the_pose_is_kept():
    pose = Pose3((0.0, 0.0, 0.4))
    view = DepthView(np.array([[0.0, -1.0, np.nan, np.inf]], dtype=np.float32), CAMERA, pose)
    seen = depth(view)
    assert np.isnan(seen.z).all()
    assert np.isnan(seen.sigma).all()
    assert seen.T_body_camera is pose


def test_invalid_input_is_refused_with_a_message():
    with pytest.raises(InputError, match="check the intrinsics"):
        depth(DepthView(np.ones((2, 2), dtype=np.float32), CAMERA))
    with pytest.raises(ConfigError, match=r"floor_m=0\.0"):
        StructuredLightConfig(floor_m=0.0)
    with pytest.raises(ConfigError, match=r"start_m=-1\.0"):
        StructuredLightConfig(start_m=-1.0)
