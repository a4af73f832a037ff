"""Invalid pictures are refused with a message; unusual valid ones are processed."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from perception.monocular.adaptation import FloorColourModel
from perception.monocular.back_projection import camera_pose, floor_points
from perception.monocular.cycle import Monocular, MonocularConfig
from perception.monocular.ground import horizon_rows
from perception.monocular.result import Picture
from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError, InputError
from perception.primitives.pose import Pose3
from planning.swarm.objective import ObjectiveConfig

CAMERA = Camera.from_view(160, 120, math.radians(90.0), math.radians(75.0))
EYE = np.array([0.0, 0.0, 0.42])
POSE = camera_pose(EYE, 0.0, math.radians(30.0), 0.0)
WOOD, WALL = (190, 150, 105), (110, 140, 180)


def pose_at(pitch_deg, roll_deg=0.0, height_m=0.42):
    angles = (0.0, math.radians(pitch_deg), math.radians(roll_deg))
    return camera_pose(np.array([0.0, 0.0, height_m]), *angles)


def picture(pose=POSE, stamp_s=0.0, wall_m=3.0, noise=0, camera=CAMERA):
    """A wooden floor and a blue wall."""
    v, u = np.mgrid[0 : camera.height, 0 : camera.width].astype(float)
    ahead = floor_points(np.stack([u, v], axis=-1), camera, pose, 100.0)[..., 0]
    image = np.where((ahead < wall_m)[..., None], WOOD, WALL).astype(float)
    image += np.random.default_rng(noise).normal(0.0, 2.0, image.shape)
    return Picture(np.clip(image, 0, 255).astype(np.uint8), camera, pose, stamp_s)


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((120, 160), np.uint8),
        np.zeros((120, 160, 4), np.uint8),
        np.zeros((120, 160, 3), np.uint16),
        np.zeros((120, 160, 3), np.float32),
        np.zeros((0, 0, 3), np.uint8),
        np.zeros((160, 120, 3), np.uint8),
        np.zeros((120, 161, 3), np.uint8),
    ],
    ids=["grey", "with alpha", "16 bit", "0 to 1", "empty", "turned", "too wide"],
)
def test_an_image_of_wrong_shape_type_or_size_is_refused_with_a_message(image):
    made = object.__new__(Picture)  # bypass the shape checks that only the tests have
    for name, value in (("rgb", image), ("camera", CAMERA), ("T_world_camera", POSE)):
        object.__setattr__(made, name, value)
    object.__setattr__(made, "stamp_s", 0.0)
    with pytest.raises(InputError, match=r"picture: .*(convert it|camera)"):
        made.__post_init__()


def test_an_image_of_few_pixels_is_refused():
    tiny = Camera.from_view(8, 8, 1.5, 1.5)
    with pytest.raises(InputError, match="at least 16"):
        Picture(np.zeros((8, 8, 3), np.uint8), tiny, POSE, 0.0)


@pytest.mark.parametrize(
    ("pose", "stamp_s", "words"),
    [
        (Pose3((math.nan, 0.0, 0.4), POSE.quat_xyzw), 0.0, "must be finite"),
        (Pose3((0.0, 0.0, math.inf), POSE.quat_xyzw), 0.0, "must be finite"),
        (Pose3((0.0, 0.0, 0.4), (math.nan, 0.0, 0.0, 1.0)), 0.0, "must be finite"),
        (Pose3((0.0, 0.0, 0.4), (0.0, 0.0, 0.0, 0.0)), 0.0, "must be finite"),
        (POSE, math.nan, "must be finite"),
        (pose_at(30.0, height_m=0.0), 0.0, "above the floor"),
        (pose_at(30.0, height_m=-0.4), 0.0, "above the floor"),
        (pose_at(30.0, roll_deg=180.0), 0.0, "upside down"),
        (pose_at(120.0), 0.0, "upside down"),
    ],
)
def test_an_invalid_camera_pose_is_refused_with_a_message(pose, stamp_s, words):
    with pytest.raises(InputError, match=words):
        Picture(np.zeros((120, 160, 3), np.uint8), CAMERA, pose, stamp_s)


def test_a_camera_that_looks_straight_down_sees_only_floor():
    result = Monocular(MonocularConfig()).cycle(None, picture(pose_at(90.0)))
    assert np.mean(result.ground > 0) > 0.99


@pytest.mark.parametrize("pitch_deg", [-89.99, -60.0, -45.0, -38.0])
def test_a_picture_above_the_horizon_shows_no_floor_and_is_not_learnt(pitch_deg):
    monocular = Monocular(MonocularConfig())
    result = monocular.cycle(None, picture(pose_at(pitch_deg)))
    assert monocular.colours.range is None
    assert math.isnan(result.nearest_m)
    for image in (result.ground, result.movable, result.edges, result.predicted):
        assert not image.any()
    assert result.obstacles == ()
    assert result.corners_blocked == (True, True)


def test_a_look_at_the_ceiling_does_not_change_the_colour_model():
    monocular = Monocular(MonocularConfig())
    before = monocular.cycle(None, picture())
    known = monocular.colours.range
    raised = monocular.cycle(before.current, picture(pose_at(-50.0), 0.2))
    assert not raised.ground.any()
    assert monocular.colours.range == known
    after = monocular.cycle(raised.current, picture(stamp_s=0.4, noise=1))
    assert np.mean((after.ground > 0) == (before.ground > 0)) > 0.99


def test_the_horizon_of_a_vertical_camera_is_infinite():
    up = Pose3.from_rotation(np.diag([1.0, -1.0, -1.0]) @ np.diag([1.0, -1.0, -1.0]), EYE)
    assert horizon_rows(CAMERA, up) == (math.inf, math.inf)
    down = Pose3.from_rotation(np.diag([1.0, -1.0, -1.0]), EYE)
    assert horizon_rows(CAMERA, down) == (-math.inf, -math.inf)


@settings(max_examples=60, deadline=None)
@given(st.floats(-90.0, 90.0), st.floats(-80.0, 80.0), st.integers(16, 70), st.integers(16, 70))
def test_only_pixels_below_the_horizon_are_floor_for_any_attitude_and_size(
    pitch, roll, width, height
):
    camera = Camera.from_view(width, height, 1.4, 1.2)
    pose = pose_at(pitch, roll)
    if pose.rotation[2, 1] > 0.0:
        return
    result = Monocular(MonocularConfig()).cycle(None, picture(pose, camera=camera))
    v, u = np.mgrid[0:height, 0:width].astype(float)
    down = camera.back_project(np.stack([u, v], axis=-1), np.ones(u.shape)) @ pose.rotation[2] < 0.0
    margin = np.pad(down, 2, mode="edge")
    near = sum(
        margin[2 + a : 2 + a + height, 2 + b : 2 + b + width]
        for a in range(-2, 3)
        for b in range(-2, 3)
    )
    assert not np.any((result.ground > 0) & (near == 0))


@pytest.mark.parametrize("level", [0, 6])
def test_a_dark_picture_shows_no_floor_and_is_not_learnt(level):
    monocular = Monocular(MonocularConfig())
    dark = Picture(np.full((120, 160, 3), level, np.uint8), CAMERA, POSE, 0.0)
    result = monocular.cycle(None, dark)
    assert not result.ground.any()
    assert monocular.colours.range is None
    lit = monocular.cycle(dark, picture(stamp_s=0.2))
    assert np.mean(lit.ground > 0) > 0.5


def test_darkness_is_not_learnt_while_walking():
    colours = FloorColourModel()
    known = colours.learn(picture().rgb, POSE)
    for k in range(30):
        ahead = Pose3((0.04 * k, 0.0, 0.0)) @ POSE
        colours.learn(np.zeros((120, 160, 3), np.uint8), ahead)
    assert colours.range == known


def test_a_pair_from_two_cameras_is_refused():
    other = Camera.from_view(160, 120, math.radians(60.0), math.radians(50.0))
    with pytest.raises(InputError, match="two cameras"):
        Monocular(MonocularConfig()).cycle(picture(), picture(stamp_s=0.2, camera=other))


@pytest.mark.parametrize(
    ("kind", "name", "value"),
    [
        (MonocularConfig, "least_floor_px", -1),
        (MonocularConfig, "fastest_mps", 0.0),
        (MonocularConfig, "farthest_m", math.nan),
        (MonocularConfig, "farthest_m", 0.0),
        (MonocularConfig, "horizon_s", math.inf),
        (MonocularConfig, "static_mps", math.nan),
        (ObjectiveConfig, "margin_m", math.nan),
        (ObjectiveConfig, "farthest_m", math.nan),
    ],
)
def test_an_invalid_setting_is_refused_with_name_and_value(kind, name, value):
    with pytest.raises(ConfigError, match=f"{name}={value}"):
        kind(**{name: value})
