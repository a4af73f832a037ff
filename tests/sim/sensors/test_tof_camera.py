"""The time-of-flight camera against planes of known range."""

from dataclasses import replace

import numpy as np
import pytest

from perception.primitives.errors import ConfigError
from perception.primitives.pose import Pose2, Pose3, head_rotation
from sim.rendering.motion import STATIONARY, Motion
from sim.rendering.rays import RayCaster
from sim.scene import FloorArea, Scene, StaticObject
from sim.scenes import catalogue
from sim.sensors.tof_camera import AMBIENT, REFERENCE_M, TofCamera, TofConfig
from sim.shapes import Box

EXACT = TofConfig(
    sub_rays=1,
    noise_m=0.0,
    floor_noise_m=0.0,
    stray_share=0.0,
    wiggling_m=0.0,
    pattern_m=0.0,
    bits=20,
)


def wall_at(distance: float, albedo: float = 0.8, step: bool = False) -> RayCaster:
    """A wall ahead of the origin that fills the field of view."""
    boxes = [Box((distance + 0.5, 0.0, 0.0), (1.0, 20.0, 20.0))]
    if step:
        boxes.append(Box((distance - 0.75, -5.003, 0.0), (0.5, 10.0, 20.0)))
    static_objects = tuple(StaticObject("wall", (box,), albedo) for box in boxes)
    extent = (-90.0, -90.0, -80.0, -80.0)
    scene = Scene(
        "test", 0, extent, (FloorArea("planks/oak", extent),), static_objects, (), (), Pose2(), ()
    )
    caster = RayCaster(scene)
    caster.place([])
    return caster


AHEAD = Pose3.from_rotation(head_rotation(0.0, 0.0), np.zeros(3))


def true_range(camera, distance):
    return distance * np.linalg.norm(camera.rays, axis=-1)


def test_intrinsics_are_those_of_an_sr4000():
    camera = TofConfig().camera
    assert (camera.width, camera.height) == (176, 144)
    assert camera.fx == pytest.approx(217.8, abs=0.05)
    assert camera.fy == pytest.approx(228.4, abs=0.05)


def test_without_noise_the_range_of_a_wall_is_exact():
    camera = TofCamera(EXACT, np.random.default_rng(0))
    measured, amplitude = camera.measure(wall_at(2.0), AHEAD)
    expected = true_range(camera.camera, 2.0)
    np.testing.assert_allclose(measured, expected, atol=1e-5)
    cosine = 2.0 / expected
    np.testing.assert_allclose(amplitude, 0.8 * cosine * (2.0 / expected) ** 2, rtol=1e-4)


def test_ranges_of_the_floor_agree_with_the_camera_height():
    scene = Scene(
        "test",
        0,
        (-9.0, -9.0, 9.0, 9.0),
        (FloorArea("planks/oak", (-9.0, -9.0, 9.0, 9.0)),),
        (),
        (),
        (),
        Pose2(),
        (),
    )
    caster = RayCaster(scene)
    caster.place([])
    camera = TofCamera(EXACT, np.random.default_rng(0))
    pose = Pose3.from_rotation(head_rotation(0.3, 0.8), np.array([0.2, 0.1, 0.383]))
    measured, _ = camera.measure(caster, pose)
    unit = camera.camera.rays / np.linalg.norm(camera.camera.rays, axis=-1, keepdims=True)
    down = -(unit @ pose.rotation[2])
    np.testing.assert_allclose(measured, 0.383 / down, atol=2e-5)


def test_beyond_five_metres_ranges_wrap_around():
    config = replace(EXACT, dark=0.0)
    camera = TofCamera(config, np.random.default_rng(0))
    measured, _ = camera.measure(wall_at(6.0), AHEAD)
    expected = true_range(camera.camera, 6.0) - config.wrap_m
    assert config.wrap_m == pytest.approx(4.9965, abs=1e-3)
    np.testing.assert_allclose(measured, expected, atol=1e-4)


def test_edges_give_flying_pixels():
    camera = TofCamera(replace(EXACT, sub_rays=3), np.random.default_rng(0))
    measured, _ = camera.measure(wall_at(2.5, step=True), AHEAD)
    middle = measured[
        72, 60:116
    ]  # the near side at 1.5 m, the far one at 2.5 m, up to 1 % more at oblique rays
    between = (middle > 1.55) & (middle < 2.45)
    assert 1 <= between.sum() <= 2


def test_dark_surfaces_have_no_range():
    camera = TofCamera(EXACT, np.random.default_rng(0))
    measured, amplitude = camera.measure(wall_at(3.0, albedo=0.05), AHEAD)
    assert np.array_equal(np.isnan(measured), amplitude < EXACT.dark)
    assert np.isnan(measured).any()


@pytest.mark.parametrize("distance", [0.8, 1.3, 1.75, 2.4])
def test_temporal_noise_follows_its_model(distance):
    camera = TofCamera(TofConfig(), np.random.default_rng(0))
    caster = wall_at(distance, albedo=0.5)
    shots = np.stack([camera.measure(caster, AHEAD)[0] for _ in range(16)])
    amplitude = camera.measure(caster, AHEAD)[1]
    model = TofConfig()
    shot_noise = model.noise_m * np.sqrt((amplitude + AMBIENT) / 1.1) / amplitude
    expected = np.hypot(shot_noise, model.floor_noise_m)
    ratio = shots.var(axis=0, ddof=1) / expected**2
    assert ratio.mean() == pytest.approx(1.0, abs=0.05)
    if distance == 1.3:  # published tests of the SR-4000
        assert float(np.median(expected)) == pytest.approx(0.004, abs=0.001)


def test_noise_in_a_home_agrees_with_published_tests():
    scene = catalogue.load("home", 0)
    caster = RayCaster(scene)
    caster.place([moving_object.start for moving_object in scene.moving_objects])
    real = TofCamera(TofConfig(), np.random.default_rng(0))
    exact = TofCamera(replace(EXACT, dark=0.0), np.random.default_rng(0))
    spread, ranges = [], []
    for pan in (-0.8, 0.0, 0.8):
        for tilt in (0.2, 0.5):
            head = Pose3.from_rotation(head_rotation(pan, tilt), np.array([0.03, 0.0, 0.383]))
            pose = scene.start.lifted() @ head
            shots = np.stack([real.measure(caster, pose)[0] for _ in range(6)])
            spread.append(shots.std(axis=0, ddof=1))
            ranges.append(exact.measure(caster, pose)[0])
    sigma, distance = np.array(spread), np.array(ranges)
    for (low, high), expected in {
        (0.3, 1.0): 0.004,
        (1.0, 1.5): 0.006,
        (1.5, 2.0): 0.011,
        (2.0, 3.0): 0.018,
    }.items():
        inside = (distance >= low) & (distance < high) & np.isfinite(sigma)
        rms = float(np.sqrt(np.mean(sigma[inside] ** 2)))
        assert rms == pytest.approx(expected, rel=0.45)  # furniture and albedo differ


def test_the_fixed_pattern_and_stray_light_stay_within_centimetres():
    camera = TofCamera(TofConfig(), np.random.default_rng(0))
    caster = wall_at(1.5, albedo=0.6)
    mean = np.mean([camera.measure(caster, AHEAD)[0] for _ in range(12)], axis=0)
    error = mean - true_range(camera.camera, 1.5)
    assert abs(float(error.mean())) < 0.015
    assert 0.002 < float(error.std()) < 0.010


def test_ranges_are_quantised_to_14_bits():
    camera = TofCamera(TofConfig(), np.random.default_rng(0))
    measured, _ = camera.measure(wall_at(1.0), AHEAD)
    units = measured[np.isfinite(measured)].astype(np.float64) / (5.0 / 2**14)
    assert np.abs(units - np.rint(units)).max() < 1e-3


def through(caster, camera, motion, pose=AHEAD):
    return camera.measure_moving((caster, motion.pose_after(pose, s)) for s in camera.instants)


def test_integration_at_rest_equals_an_instantaneous_measurement():
    caster, config = wall_at(2.5, step=True), replace(EXACT, sub_rays=2, integration_s=0.03)
    one, other = (TofCamera(config, np.random.default_rng(0)) for _ in range(2))
    moving = through(caster, one, STATIONARY)
    for measured, expected in zip(moving, other.measure(caster, AHEAD), strict=True):
        np.testing.assert_allclose(measured, expected, atol=1e-5)


def test_phase_of_an_approach_agrees_with_the_four_ranges():
    config = replace(EXACT, integration_s=0.05)
    camera = TofCamera(config, np.random.default_rng(0))
    speed = 1.5
    moving, _ = through(wall_at(2.0), camera, Motion(np.array([speed, 0.0, 0.0]), np.zeros(3)))
    slant = np.linalg.norm(camera.camera.rays, axis=-1)
    samples = []
    for quarter in range(4):
        seconds = config.integration_s * (quarter - 1.5) / 4
        distance = (2.0 - speed * seconds) * slant
        returned = 0.8 / slant * (REFERENCE_M / distance) ** 2
        phase = 2.0 * np.pi * distance / config.wrap_m - quarter * np.pi / 2.0
        samples.append(returned * (1.0 + np.cos(phase)))
    phase = np.arctan2(samples[1] - samples[3], samples[0] - samples[2]) % (2.0 * np.pi)
    np.testing.assert_allclose(moving, phase / (2.0 * np.pi) * config.wrap_m, atol=1e-4)
    assert np.abs(moving - 2.0 * slant).max() > 1e-3  # not one of the true ranges


def test_a_rotating_camera_has_motion_artefacts_at_edges_only():
    caster, config = wall_at(2.5, step=True), replace(EXACT, integration_s=0.04)
    camera = TofCamera(config, np.random.default_rng(0))
    turning = 1.0
    moving, _ = through(caster, camera, Motion(np.zeros(3), np.array([0.0, 0.0, turning])))
    still, _ = TofCamera(EXACT, np.random.default_rng(0)).measure(caster, AHEAD)
    edge = int(np.argmax(np.abs(np.diff(still[20]))))
    wrong = np.flatnonzero(np.abs(moving[20] - still[20]) > 0.05)
    swept = camera.camera.fx * turning * config.integration_s * 3 / 4  # first to last image
    assert abs(wrong - edge).max() <= swept / 2 + 2
    assert 0.5 * swept <= len(wrong) <= swept + 2
    far = np.abs(np.arange(still.shape[1]) - edge) > swept
    assert np.abs(moving - still)[:, far].max() < 0.02


def test_a_negative_integration_is_refused():
    with pytest.raises(ConfigError, match=r"integration_s=-0\.1 must not be negative"):
        TofConfig(integration_s=-0.1)
