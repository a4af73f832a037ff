"""Lens, exposure and gain of the simulated cameras against optics and kinematics."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from perception.depth.rectification import rectification, rectified
from perception.primitives.errors import ConfigError
from perception.primitives.frame import Frame, StereoView
from perception.primitives.pose import Pose2, Pose3, head_rotation
from planning.commands import WalkCommand
from sim.body.head import HeadConfig
from sim.body.kinematic import SlipConfig, SwayConfig
from sim.rendering.motion import Motion, motion_between
from sim.robot import SimulatedRobot
from sim.robot_config import RobotConfig
from sim.scene import FloorArea, MovingObject, Scene, StaticObject
from sim.sensors.cameras import ImageConfig, colour_picture, stereo_pair
from sim.shapes import Box, Cylinder
from sim.world import World
from surefoot.config.schema import Config
from surefoot.recordings.codec import decode, encode
from surefoot.recordings.recording import RecordingInfo
from surefoot.run.pipeline import Pipeline

LENS = (-0.28, 0.07, 0.001, -0.0008, 0.0)  # typical of calibrated cameras with this field of view
PLAIN = ImageConfig(640, 480, 60.0, (0.035, 0.02, 0.035), noise_grey=0.0)
BENT = replace(PLAIN, lens=LENS)
AHEAD = Pose3.from_rotation(head_rotation(0.0, 0.0), np.array([0.0, 0.0, 0.4]))
EXACT = RobotConfig(
    tof=False,
    slip=SlipConfig(0.0, 0.0, 0.0, 0.0, 0.0),
    sway=SwayConfig(0.0, 0.0, 0.0, 0.0),
    head=HeadConfig(encoder_deg=0.0, offset_deg=0.0),
)
EXTENT = (-0.3, -1.2, 2.2, 1.2)


def scene_with(*static_objects, moving_objects=(), extent=EXTENT):
    floor = (FloorArea("plain/grey", extent),)
    return Scene("test", 0, extent, floor, static_objects, moving_objects, (), Pose2(), ())


def tags():
    """Tags across the field of view, 1.2 m ahead."""
    plates = []
    for k, (y, z) in enumerate((y, z) for y in (-0.5, 0.0, 0.5) for z in (0.05, 0.4, 0.75)):
        box = Box((1.2, y, z), (0.006, 0.28, 0.28), math.pi, "plaster/white", f"tag/{k}")
        plates.append(StaticObject(f"tag {k}", (box,)))
    return scene_with(*plates)


def corners(grey):
    """Corners of every tag in an image, by id, px."""
    detector = cv2.aruco.ArucoDetector(
        cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50), _fine()
    )
    found, names, _ = detector.detectMarkers(grey)
    return {
        int(np.ravel(k)[0]): places.reshape(-1, 2) for places, k in zip(found, names, strict=True)
    }


def _fine():
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    return parameters


def test_rectification_undoes_the_lens():
    rng = np.random.default_rng(0)
    with World(tags()) as world:
        ideal = stereo_pair(world, PLAIN, 0.04, AHEAD, rng)
        raw = stereo_pair(world, BENT, 0.04, AHEAD, rng)
    rig = rectification(BENT.camera, BENT.camera, Pose3((0.04, 0.0, 0.0)))
    straight = rig.apply(*raw)
    for bent, seen, true in zip(raw, (straight.left, straight.right), ideal, strict=True):
        wanted, got, unbent = corners(true), corners(seen), corners(bent)
        shared = sorted(wanted.keys() & got.keys())
        assert len(shared) >= 6
        ones = np.ones(4)
        for name in shared:
            rays = rig.T_left_rectified.apply(straight.camera.back_project(got[name], ones))
            assert np.abs(PLAIN.camera.project(rays) - wanted[name]).max() < 0.3
        moved = [np.abs(unbent[n] - wanted[n]).max() for n in wanted.keys() & unbent.keys()]
        assert max(moved) > 5.0  # the lens distorts


def test_pixels_of_a_distorted_image_lie_on_the_rays_of_its_camera():
    rng = np.random.default_rng(0)
    wide = replace(PLAIN, width=480, across_deg=80.0)
    with World(tags()) as world:
        true, seen = (
            cv2.cvtColor(colour_picture(world, config, AHEAD, rng), cv2.COLOR_RGB2GRAY)
            for config in (wide, replace(wide, lens=LENS))
        )
    wanted, got = corners(true), corners(seen)
    assert len(wanted.keys() & got.keys()) >= 6
    lens = replace(wide, lens=LENS).camera
    for name in wanted.keys() & got.keys():
        places = wide.camera.project(lens.back_project(got[name], np.ones(4)))
        assert np.abs(places - wanted[name]).max() < 0.3


def test_a_recording_keeps_the_lens_for_rectification():
    config = RobotConfig(
        tof=False, colour=False, stereo_camera=replace(BENT, width=320, height=240)
    )
    with World(tags(), "tiny") as world, SimulatedRobot(world, config) as robot:
        frame = robot.read()
        while frame.stereo is None:
            frame = robot.read()
    assert frame.stereo.camera.distortion == LENS
    assert decode(encode(frame)).stereo.camera.distortion == LENS
    stereo = rectified(decode(encode(frame)).stereo)
    assert rectified(stereo) is stereo
    assert not stereo.camera.is_distorted
    assert stereo.baseline_m == pytest.approx(0.04)
    np.testing.assert_allclose(stereo.T_body_camera.matrix, frame.stereo.T_body_camera.matrix)


def test_the_pipeline_rectifies_a_distorted_pair():
    plain = replace(BENT, lens=PLAIN.lens, noise_grey=2.0)
    wall = StaticObject("wall", (Box((1.2, 0.0, 0.4), (0.006, 2.4, 2.4), math.pi, "leaves/leaf"),))
    with World(scene_with(wall)) as world:
        pairs = [
            stereo_pair(world, config, 0.04, AHEAD, np.random.default_rng(0))
            for config in (plain, replace(plain, lens=LENS))
        ]
    pipeline = Pipeline(Config(), RecordingInfo("test", "simulation"))
    for pair, camera in zip(pairs, (PLAIN.camera, BENT.camera), strict=True):
        frame = Frame(0.0, stereo=StereoView(*pair, 0.04, camera))
        ((sensor, depth),) = pipeline.depth_sources.images(frame)
        assert (sensor, depth.camera.is_distorted) == ("stereo", False)
        patch = depth.z[20:120, 20:120]  # upper left corner, where the distortion is greatest
        assert np.isfinite(patch).mean() > 0.5
        assert np.nanmedian(patch) == pytest.approx(1.2 - 0.003, abs=0.005)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"lens": (-1.5, 0.0, 0.0, 0.0, 0.0)}, "folds the image"),
        ({"gain": 0.0}, "gain=0.0 must be at least"),
        ({"exposure_s": -0.01}, "exposure_s=-0.01 must not be negative"),
        ({"exposure_parts": 0}, "exposure_parts=0 must be at least 1"),
    ],
)
def test_invalid_cameras_are_refused(changed, said):
    with pytest.raises(ConfigError, match=said):
        replace(PLAIN, **changed)


def edge():
    """White from y = 0 to the left, black to the right, 2 m ahead, without texture."""
    halves = [
        StaticObject(name, (Box((2.1, y, 1.0), (0.2, 2.0, 2.0), 0.0, f"plain/{name}"),))
        for name, y in (("white", 1.0), ("navy", -1.0))
    ]
    return scene_with(*halves)


def smear_px(row):
    """Width of the ramp between both sides: for uniform blur its full width."""
    low, high = float(row[-20:].mean()), float(row[:20].mean())
    share = (row.astype(float) - low) / (high - low)
    places = np.interp([-0.75, -0.25], -share, np.arange(len(row)))
    return float(np.diff(places)[0] * 2.0)


@pytest.mark.parametrize("turning", [0.0, 0.6])
def test_motion_blur_of_an_edge_agrees_with_the_camera_motion(turning):
    exposure_s, speed = 0.04, 0.25
    config = replace(PLAIN, exposure_s=exposure_s, exposure_parts=9)
    motion = Motion(np.array([0.0, speed, 0.0]), np.array([0.0, 0.0, turning]))
    with World(edge(), "tiny") as world:
        row = colour_picture(world, config, AHEAD, np.random.default_rng(0), motion)[200, :, 1]
    focal = config.camera.fx
    expected = focal * exposure_s * (speed / 2.0 + turning)
    assert smear_px(row) == pytest.approx(expected, rel=0.15)
    middle = np.interp(-0.5, -((row - row[-1]) / (float(row[0]) - row[-1])), np.arange(len(row)))
    assert middle == pytest.approx(
        config.camera.cx, abs=0.7
    )  # the stamp is the middle of the exposure


def test_an_exposure_at_rest_equals_an_instantaneous_image():
    with World(tags(), "tiny") as world:
        rng = np.random.default_rng(0)
        still, long = (
            colour_picture(world, replace(PLAIN, exposure_s=s), AHEAD, rng) for s in (0.0, 0.02)
        )
    np.testing.assert_array_equal(still, long)


def test_moving_objects_are_blurred_too():
    body = Cylinder((0.0, 0.0, 0.5), 0.2, 1.0, "plain/navy")
    moving_object = MovingObject("fast", (2.0, -1.0), math.pi / 2, 0.5, 4.0, (body,))
    wall = StaticObject("wall", (Box((4.0, 0.0, 1.0), (0.2, 8.0, 4.0), 0.0, "plain/white"),))
    scene = scene_with(wall, moving_objects=(moving_object,), extent=(-0.3, -1.2, 4.0, 1.2))
    with World(scene, "tiny") as world:
        (x, y, _, vy) = world.moving_states()[0]
        aim = Pose3.from_rotation(head_rotation(math.atan2(y, x), 0.0), AHEAD.position)
        rng = np.random.default_rng(0)
        sharp, smeared = (
            colour_picture(world, replace(PLAIN, exposure_s=s), aim, rng)[:, :, 1].astype(int)
            for s in (0.0, 0.1)
        )
    changed = (np.abs(sharp - smeared)[240] > 5).sum()
    swept = PLAIN.camera.fx * 0.1 * abs(vy) / math.hypot(x, y)
    assert changed >= 1.2 * swept  # both edges
    assert changed <= 3.0 * swept


def test_gain_scales_brightness_and_noise_and_saturates():
    dark = scene_with(
        StaticObject("wall", (Box((2.1, 0.0, 1.0), (0.2, 3.0, 3.0), 0.0, "plain/slate"),))
    )
    with World(dark, "tiny") as world:
        pictures = {
            (gain, noise): colour_picture(
                world, replace(PLAIN, gain=gain, noise_grey=noise), AHEAD, np.random.default_rng(1)
            )[100:140, 100:140].astype(float)
            for gain, noise in ((1.0, 0.0), (2.0, 0.0), (2.0, 3.0), (1.0, 3.0), (9.0, 0.0))
        }
    clean = pictures[1.0, 0.0]
    np.testing.assert_allclose(pictures[2.0, 0.0], 2.0 * clean, atol=1.0)
    assert (pictures[9.0, 0.0] == 255.0).all()
    assert (pictures[2.0, 3.0] - 2.0 * clean).std() == pytest.approx(6.0, rel=0.1)
    assert (pictures[1.0, 3.0] - clean).std() == pytest.approx(3.0, rel=0.1)


def test_a_motion_leads_from_one_pose_to_the_other():
    before = Pose3.from_rotation(head_rotation(0.3, 0.2), np.array([1.0, 2.0, 0.4]))
    after = Pose3.from_rotation(head_rotation(0.4, 0.1), np.array([1.1, 1.9, 0.5]))
    moved = motion_between(before, after, 0.02).pose_after(before, 0.02)
    np.testing.assert_allclose(moved.matrix, after.matrix, atol=1e-12)


def walked(exposure_s, command, steps=3):
    """Frames of a noiseless robot with that exposure time."""
    small = replace(PLAIN, width=160, height=120, exposure_s=exposure_s)
    config = replace(EXACT, colour=True, colour_camera=small, stereo=True, stereo_camera=small)
    with World(tags(), "tiny") as world, SimulatedRobot(world, config) as robot:
        frames = []
        while len(frames) < 2 * steps:
            frames.append(robot.read())
            if frames[-1].footstep_due:
                robot.walk(command)
    return frames


def test_images_of_a_walking_robot_are_blurred_and_those_of_a_standing_one_are_not():
    for command, smeared in ((WalkCommand(0.04), True), (WalkCommand(), False)):
        sharp, long = (walked(s, command) for s in (0.0, 0.04))
        assert [f.stamp_s for f in sharp] == [f.stamp_s for f in long]
        for one, other in zip(sharp, long, strict=True):
            np.testing.assert_allclose(
                one.odometry.motion.vector, other.odometry.motion.vector, atol=1e-12
            )
            assert one.odometry.steps == pytest.approx(other.odometry.steps)
        assert np.array_equal(sharp[-1].colour.rgb, long[-1].colour.rgb) is not smeared
        assert np.array_equal(sharp[-1].stereo.right, long[-1].stereo.right) is not smeared
