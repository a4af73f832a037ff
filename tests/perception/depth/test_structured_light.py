"""Structured light: published noise and invalid depth."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from perception.depth.flying import flying
from perception.depth.structured_light import StructuredLightConfig, depth
from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError, InputError
from perception.primitives.frame import DepthView
from perception.primitives.pose import Pose3

CAMERA = Camera(4, 1, 4.0, 4.0, 1.5, 0.0)


def test_noise_matches_the_published_values():
    seen = depth(DepthView(np.array([[0.4, 1.4, 2.4, 4.4]], dtype=np.float32), CAMERA))
    np.testing.assert_allclose(seen.sigma, [[0.0012, 0.0031, 0.0088, 0.0316]], rtol=1e-5)


def sloping(size: tuple[int, int], times: float, seed: int = 0) -> tuple[np.ndarray, Camera]:
    """A plane seen at a slant with a box before it, with some times the published noise, m."""
    width, height = size
    v, u = np.mgrid[:height, :width]
    z = 1.0 / (0.3 + 0.6 * v / height + 0.1 * u / width)
    z[height // 3 : height // 2, width // 3 : width // 2] = 0.9
    sigma = 0.0012 + 0.0019 * (z - 0.4) ** 2
    noisy = z + times * sigma * np.random.default_rng(seed).standard_normal(z.shape)
    return noisy.astype(np.float32), Camera(
        width, height, float(width), float(width), width / 2, height / 2
    )


@pytest.mark.parametrize("times", [1.6, 3.0, 8.0])
@pytest.mark.parametrize("size", [(64, 48), (640, 480)])
def test_an_image_that_is_noisier_than_the_model_has_its_own_noise(times, size):
    z, camera = sloping(size, times)
    ratio = depth(DepthView(z, camera)).sigma / (0.0012 + 0.0019 * (z - 0.4) ** 2)
    assert np.median(ratio) == pytest.approx(times, rel=0.1)


@pytest.mark.parametrize("size", [(424, 240), (640, 480)])
def test_noise_that_is_alike_in_neighbouring_pixels_shows_too(size):
    exact, camera = sloping(size, 0.0)
    sigma = 0.0012 + 0.0019 * (exact - 0.4) ** 2
    alike = gaussian_filter(np.random.default_rng(0).standard_normal(exact.shape), 1.5)
    z = (exact + 3.0 * sigma * alike / alike.std()).astype(np.float32)
    ratio = depth(DepthView(z, camera)).sigma / (0.0012 + 0.0019 * (z - 0.4) ** 2)
    assert np.median(ratio) == pytest.approx(3.0, rel=0.2)


@pytest.mark.parametrize("times", [0.0, 0.5, 1.0])
def test_an_image_with_the_noise_of_the_model_or_less_keeps_that_of_the_model(times):
    z, camera = sloping((320, 240), times)
    steps = np.round(200.0 * z) / 200.0  # to half a centimetre: a tenth more noise at most places
    for image in (z, steps):
        ratio = depth(DepthView(image, camera)).sigma / (0.0012 + 0.0019 * (image - 0.4) ** 2)
        np.testing.assert_allclose(ratio, 1.0, rtol=1e-4)


@pytest.mark.parametrize("times", [0.0, 0.5, 1.0])
def test_depth_in_steps_of_a_centimetre_has_its_true_error_or_that_of_the_model(times):
    exact, _ = sloping((320, 240), 0.0)
    z, camera = sloping((320, 240), times)
    steps = np.round(z, 2)
    sigma = 0.0012 + 0.0019 * (exact - 0.4) ** 2
    true = max(1.0, 1.4826 * float(np.median(np.abs(steps - exact) / sigma)))
    ratio = np.median(depth(DepthView(steps, camera)).sigma / sigma)
    assert 0.9 * true < ratio < 1.1 * true


@pytest.mark.filterwarnings("error")
def test_rows_of_depth_that_cannot_be_change_no_noise_and_give_no_warning():
    z, camera = sloping((320, 240), 1.0)
    z[::3] = 1e-42
    seen = depth(DepthView(z, camera))
    assert not flying(seen.z, seen.sigma, camera)[1::3].any()
    model = 0.0012 + 0.0019 * (z - 0.4) ** 2
    np.testing.assert_allclose(seen.sigma, model, rtol=1e-4)


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
