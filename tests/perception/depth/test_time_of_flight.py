"""Time of flight: range to depth, published noise, flying pixels, stray light, floor."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from perception.depth.points import from_depth
from perception.depth.time_of_flight import TofConfig, depth, range_sigma, without_stray_light
from perception.floor.choose import find
from perception.floor.prior import kinematic_prior
from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError, InputError
from perception.primitives.frame import RangeView
from perception.primitives.plane import Plane
from perception.primitives.pose import Pose3, head_rotation

SR4000 = Camera(176, 144, 217.8, 228.4, 87.5, 71.5)  # seed 004: 44 x 35 deg
LENGTH = np.linalg.norm(SR4000.rays, axis=-1)


def view(z, amplitude=None):
    return RangeView((z * LENGTH).astype(np.float32), amplitude, SR4000)


def floor_z(height, tilt_rad):
    """Depth of a floor seen from a tilted camera, and the camera."""
    T = Pose3.from_rotation(head_rotation(0.0, tilt_rad), np.array([0.0, 0.0, height]))
    falls = (SR4000.rays @ T.rotation.T)[..., 2]
    return np.where(falls < 0, -height / np.minimum(falls, -1e-9), np.nan), T


def test_a_wall_straight_ahead_has_the_same_depth_everywhere():
    seen = depth(view(np.full((144, 176), 1.7)))
    np.testing.assert_allclose(seen.z, 1.7, rtol=1e-6)


def test_lens_distortion_does_not_change_depth():
    camera = Camera(176, 144, 217.8, 228.4, 87.5, 71.5, (-0.2, 0.05, 0.001, 0.0, 0.0))
    length = np.linalg.norm(camera.rays, axis=-1)
    seen = depth(RangeView((1.7 * length).astype(np.float32), None, camera))
    np.testing.assert_allclose(seen.z, 1.7, rtol=1e-6)


def test_noise_matches_the_published_values():
    pure = TofConfig(fixed_m=0.0)
    ranges = np.array([[0.65, 1.3, 2.6]], dtype=np.float32)
    np.testing.assert_allclose(range_sigma(ranges, None, pure), [[0.001, 0.004, 0.016]], rtol=1e-5)
    white = ((2.0 / ranges) ** 2).astype(np.float32)
    assert range_sigma(ranges, white, pure)[0, 1] == pytest.approx(0.004, rel=1e-5)
    dim = range_sigma(ranges, 0.25 * white, pure)
    assert np.all(dim > 2.0 * range_sigma(ranges, white, pure))


def test_a_range_image_that_is_noisier_than_the_model_has_its_own_noise():
    """A wall straight ahead, seen by a sensor with four times the noise of the model."""
    model = range_sigma((1.5 * LENGTH).astype(np.float32), None, TofConfig())
    noise = 4.0 * model * np.random.default_rng(0).standard_normal(LENGTH.shape)
    seen = depth(view(1.5 + noise / LENGTH))
    assert np.nanstd((seen.z - 1.5) / seen.sigma) == pytest.approx(1.0, rel=0.1)


def test_sigma_is_at_least_the_fixed_error():
    near = np.full((1, 1), 0.3, dtype=np.float32)
    assert range_sigma(near, None, TofConfig())[0, 0] >= TofConfig().fixed_m


def test_weak_returns_and_invalid_ranges_give_no_depth():
    z = np.full((144, 176), 1.0)
    z[0, :4] = (np.nan, 0.0, -1.0, np.inf)
    amplitude = np.ones((144, 176), dtype=np.float32)
    amplitude[5, 5], amplitude[5, 6] = 0.01, np.nan
    seen = depth(view(z, amplitude))
    assert np.isnan(seen.z[0, :4]).all()
    assert np.isnan(seen.z[5, 5:7]).all()
    assert np.isfinite(seen.z[5, 7])
    assert np.array_equal(np.isfinite(seen.z), np.isfinite(seen.sigma))


def test_only_flying_pixels_between_a_box_and_the_wall_are_rejected():
    rng = np.random.default_rng(0)
    z = np.full((144, 176), 2.2)
    z[50:110, 60:100] = 1.0
    flying = np.zeros(z.shape, dtype=bool)
    flying[50:110, [59, 100]] = True
    flying[[49, 110], 60:100] = True
    z[flying] = rng.uniform(1.2, 2.0, flying.sum())
    seen = depth(view(z + 0.004 * rng.normal(size=z.shape)))
    gone = np.isnan(seen.z)
    assert np.mean(gone[flying]) > 0.97
    assert np.mean(gone[~flying]) < 0.001


def test_a_grazing_floor_is_not_taken_for_flying_pixels():
    z, _ = floor_z(0.38, np.radians(10.0))
    near = z < 3.0
    seen = depth(view(np.where(z < 4.5, z, np.nan)))
    assert np.mean(np.isfinite(seen.z[near])) > 0.995


def test_a_calibrated_wiggling_error_is_removed():
    true = np.linspace(0.5, 4.5, 176)[None, :].repeat(144, axis=0).astype(np.float64)
    measured = true + 0.004 * np.sin(4.0 * 2.0 * np.pi * true / 4.997)
    ranges = RangeView(measured.astype(np.float32), None, SR4000)
    left = [depth(ranges, TofConfig(wiggle_m=w)).z * LENGTH - true for w in (0.0, 0.004)]
    assert np.abs(left[0]).max() > 0.0035
    assert np.abs(left[1]).max() < 0.0002  # second order: 4 mm by 20 mm / m slope


@pytest.mark.parametrize("seed", range(6))
def test_the_floor_is_accurate_to_half_a_degree_and_five_millimetres(seed):
    rng = np.random.default_rng(seed)
    tilt = rng.uniform(0.35, 0.75)
    z, T = floor_z(0.38, tilt)
    r = z * LENGTH
    amplitude = (0.6 * (0.38 / r) * (2.0 / r) ** 2).astype(np.float32)  # 60 % white, oblique
    A = np.maximum(amplitude, 1e-3)
    r = r + 0.004 * np.sqrt((A + 0.1) / 1.1) / A * rng.normal(size=r.shape)
    r += 0.003 * rng.normal(size=r.shape) + 0.004 * np.sin(8.0 * np.pi * r / 4.997) - 0.004
    seen = depth(RangeView(np.where(z < 4.0, r, np.nan).astype(np.float32), amplitude, SR4000))
    points = from_depth(seen, 0.15, 3.0)
    found = find(points, kinematic_prior(T, np.radians(1.2), 0.01), rng)
    truth = Plane(np.array([0.0, 0.0, 1.0]), 0.0).moved(T.inverse())
    assert np.degrees(found.plane.angle_to(truth)) < 0.5
    assert abs(found.plane.offset_m - 0.38) < 0.005


def test_invalid_input_is_refused_with_a_message():
    with pytest.raises(InputError, match=r"range image is \(3, 3\)"):
        depth(RangeView(np.ones((3, 3), dtype=np.float32), None, SR4000))
    with pytest.raises(ConfigError, match=r"sigma_m=0\.0"):
        TofConfig(sigma_m=0.0)


def test_stray_light_of_a_near_object_that_fills_half_the_view_is_removed():
    # a carton 0.35 m ahead, fifty times as bright as the wall beside it at 1.8 m
    config = TofConfig(stray_share=0.02)
    true = np.full((144, 176), 1.8)
    true[:, 40:130] = 0.35
    amplitude = np.where(true < 1.0, 25.0, 0.5)
    phasor = amplitude * np.exp(2j * math.pi * true / config.wrap_m)
    blurred = [gaussian_filter(part, config.stray_px) for part in (phasor.real, phasor.imag)]
    seen = phasor + config.stray_share * (blurred[0] + 1j * blurred[1])
    range_m = (np.angle(seen) % (2.0 * math.pi)) * config.wrap_m / (2.0 * math.pi)
    wall = np.zeros(true.shape, dtype=bool)
    wall[:, 10:34] = wall[:, 136:166] = True
    assert np.abs(range_m - true)[wall].min() > 0.05
    cleaned = without_stray_light(
        range_m.astype(np.float32), np.abs(seen).astype(np.float32), config
    )
    assert np.abs(cleaned - true)[wall].max() < 0.002
    assert np.abs(np.median((cleaned - true)[wall])) < 0.0005
