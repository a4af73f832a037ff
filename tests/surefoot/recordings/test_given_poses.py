"""Poses that cannot be those of the camera are remarked on; right ones are not."""

from __future__ import annotations

import pickle
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from perception.primitives.camera import Camera
from perception.primitives.frame import DepthView, Frame
from perception.primitives.pose import Pose3
from surefoot.recordings.given_poses import GivenPoses
from surefoot.recordings.pose_readings import PoseReadings
from surefoot.recordings.recording import RecordingInfo
from surefoot.recordings.without_poses import WithoutPoses, open_input

CAMERA = Camera.from_view(160, 120, 1.2, 0.9)
ROOM = np.array([2.0, 1.2, 3.0])  # half of its sides, m
TURNED = Pose3(quat_xyzw=(-0.6, 0.3, -0.2, 0.71))


class Walk:
    """A camera in an empty room, and what is said about its poses."""

    def __init__(self, poses, given, up=None):
        self.info = RecordingInfo("walk", "plain", poses_given=True, gravity_up_world=up)
        self.skipped, self.remarks = [], ["its own"]
        self._all = list(zip(poses, given, strict=True))
        self.camera = CAMERA

    def frames(self):
        for i, (pose, given) in enumerate(self._all):
            yield Frame(0.2 * i, depth=DepthView(seen(pose), self.camera), T_world_camera=given)


def seen(pose):
    """Depth of the walls."""
    rays = CAMERA.rays @ pose.rotation.T
    with np.errstate(divide="ignore"):
        walls = (np.sign(rays) * ROOM - pose.position) / rays
    return np.where(np.isfinite(walls), walls, np.inf).min(axis=-1).astype(np.float32)


def walk(count=20):
    return [pose(0.1 * i, (0.5 * np.sin(0.2 * i), 0.02 * i, 0.05 * i)) for i in range(count)]


def pose(yaw, position):
    tilt = Rotation.from_euler("x", -0.2)
    return Pose3.from_rotation(
        (Rotation.from_euler("y", yaw) * tilt).as_matrix(), np.array(position)
    )


def remarks(poses, given, up=None):
    recording = GivenPoses(Walk(poses, given, up))
    assert len(list(recording.frames())) == len(poses)
    assert recording.remarks[0] == "its own"
    return recording.remarks[1:]


def wxyz(one):
    """Of a world whose axes are not those of the camera."""
    one = TURNED @ one
    x, y, z, w = Rotation.from_matrix(one.rotation).as_quat().tolist()
    return Pose3(tuple(one.position), (w, x, y, z))


def millimetres(one):
    return Pose3.from_rotation(one.rotation, 1000.0 * one.position)


@pytest.mark.parametrize("world", [Pose3(), Pose3((9e3, -3.0, 4.0), (0.5, -0.5, 0.5, -0.5))])
def test_right_poses_pass_in_any_world(world):
    assert remarks(walk(), [world @ one for one in walk()]) == []


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (wxyz, "the depth contradicts the given poses"),
        (lambda one: one.inverse(), "the depth contradicts the given poses"),
        (lambda one: Pose3((1.0, 2.0, 3.0)), "all given poses are the same, but the depth"),
        (millimetres, "m/s .*are they in metres?"),
    ],
)
def test_wrong_poses_are_remarked_on(wrong, words):
    (remark,) = remarks(walk(), [wrong(one) for one in walk()])
    assert re.search(words, remark)


def stroll(stamp_s):
    """Handheld, with turns and steps that change."""
    turn = 0.5 * stamp_s + 0.3 * np.sin(1.7 * stamp_s)
    there = (np.sin(0.5 * stamp_s), 0.1 * np.sin(2.0 * stamp_s), 0.8 * np.sin(0.9 * stamp_s))
    return pose(turn, there)


def flipped(axis):
    flip = np.diag([-1.0 if i == axis else 1.0 for i in range(3)])
    return lambda one: Pose3.from_rotation(flip @ one.rotation @ flip, flip @ one.position)


def scaled(factor):
    return lambda one: Pose3.from_rotation(one.rotation, factor * one.position)


def with_axes(rotation):
    return lambda one: Pose3.from_rotation(one.rotation @ np.array(rotation), one.position)


STROLL = 0.2 * np.arange(40)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (wxyz, "quaternions in the order w, x, y, z; write them as x, y, z, w"),
        (lambda one: one.inverse(), 'their inverses; write convention = "world-to-camera"'),
        (scaled(0.5), r"about 2 times the positions; give positions in m"),
        (scaled(3.28), r"about 0\.35 times the positions"),
        (with_axes(np.diag([1.0, -1.0, -1.0])), 'axes of the kind y-up; write axes = "y-up"'),
        (with_axes([[0, -1, 0], [0, 0, -1], [1, 0, 0]]), 'axes of the kind body; write axes = "b'),
        (flipped(0), "right-handed axes, with x the other way; convert the poses"),
        (flipped(1), "right-handed axes, with y the other way; convert the poses"),
        (flipped(2), "right-handed axes, with z the other way; convert the poses"),
    ],
)
def test_the_reading_by_which_the_depth_fits_is_named(wrong, words):
    poses = [stroll(t) for t in STROLL]
    assert remarks(poses, poses) == []
    (remark,) = remarks(poses, [wrong(one) for one in poses])
    assert re.search(words, remark)


@pytest.mark.parametrize(
    ("late_s", "words"),
    [
        (0.2, r"stamps of the poses about 0\.2 s earlier; correct the offset of the clocks"),
        (0.5, r"stamps of the poses about 0\.5 s earlier"),
        (-0.35, r"stamps of the poses about 0\.35 s later"),
    ],
)
def test_poses_later_than_their_images_are_remarked_on_with_the_offset(late_s, words):
    """A pose whose stamp is late is given to an image that was taken after it."""
    (remark,) = remarks([stroll(t) for t in STROLL], [stroll(t - late_s) for t in STROLL])
    assert re.search(words, remark)


@pytest.mark.parametrize(
    ("zoom", "words"), [(2.0, "about 0.5 times the focal"), (0.5, "about 2 times the focal")]
)
def test_a_wrong_focal_length_is_remarked_on_with_the_factor(zoom, words):
    poses = [stroll(t) for t in STROLL]
    walked = Walk(poses, poses)
    walked.camera = replace(CAMERA, fx=zoom * CAMERA.fx, fy=zoom * CAMERA.fy)
    recording = GivenPoses(walked)
    list(recording.frames())
    (remark,) = recording.remarks[1:]
    assert words in remark


@pytest.mark.parametrize("ignore", [False, True])
@pytest.mark.parametrize(
    ("fx", "cx", "odd"),
    [(1.0, 0.0, False), (1.7, 0.0, False), (2.0, 0.0, True), (1.0, 0.2, False), (1.0, 0.5, True)],
)
def test_intrinsics_of_another_size_are_remarked_on(ignore, fx, cx, odd):
    poses = walk(3)
    walked = Walk(poses, poses)
    walked.camera = replace(CAMERA, fx=fx * CAMERA.fy, cx=CAMERA.cx + cx * CAMERA.width)
    recording = (WithoutPoses if ignore else GivenPoses)(walked)
    list(recording.frames())
    found = [one for one in recording.remarks if "unusual for images of 160x120 px" in one]
    assert ["scale them by the ratio of the sizes" in one for one in found] == [True] * odd


@pytest.mark.parametrize(("sigma_m", "sigma_deg"), [(0.01, 0.5), (0.03, 1.5), (0.1, 5.0)])
def test_errors_of_poses_are_not_explained_by_another_reading(sigma_m, sigma_deg):
    for seed in range(3):
        rng = np.random.default_rng(seed)
        poses = [stroll(t) for t in STROLL]
        given = [
            one
            @ Pose3.from_rotation(
                Rotation.from_rotvec(rng.normal(0.0, np.radians(sigma_deg), 3)).as_matrix(),
                rng.normal(0.0, sigma_m, 3),
            )
            for one in poses
        ]
        assert all("a camera at rest" in one for one in remarks(poses, given))


@pytest.mark.parametrize(
    "world",
    [
        Pose3(),  # y down, as of a first camera
        Pose3(quat_xyzw=(1.0, 0.0, 0.0, 0.0)),  # y up, z back, as of OpenGL
        Pose3(quat_xyzw=(0.5**0.5, 0.0, 0.0, 0.5**0.5)),  # z down
    ],
)
def test_a_world_whose_stated_vertical_is_not_that_of_the_floor_is_remarked_on(world):
    given = [world @ one for one in walk()]
    (remark,) = remarks(walk(), given, (0.0, 0.0, 1.0))
    up = [float(x) for x in re.search(r"write up = \[(.*?)\]", remark)[1].split(",")]
    assert world.rotation.T @ up == pytest.approx([0.0, -1.0, 0.0], abs=0.05)
    x, y, z = up
    assert remarks(walk(), given, (x, y, z)) == []


def test_left_handed_poses_are_not_taken_for_another_vertical():
    flip = np.diag([1.0, 1.0, -1.0])
    given = [Pose3.from_rotation(flip @ p.rotation @ flip, flip @ p.position) for p in walk()]
    (remark,) = remarks(walk(), given, (0.0, -1.0, 0.0))
    assert "world" not in remark


@pytest.mark.parametrize("roll", [0.0, 90.0, 180.0])
def test_a_camera_may_be_mounted_with_any_roll_if_its_vertical_is_right(roll):
    mount = Pose3.from_rotation(
        Rotation.from_euler("z", roll, degrees=True).as_matrix(), np.zeros(3)
    )
    poses = [one @ mount for one in walk()]
    assert remarks(poses, poses, (0.0, -1.0, 0.0)) == []


@pytest.mark.parametrize("tilt", [-0.35, -0.5, 0.0])
@pytest.mark.parametrize("roll", [0.0, 180.0])
def test_a_camera_without_poses_that_hangs_upside_down_is_remarked_on(tilt, roll):
    """Level, it sees as much of the ceiling as of the floor; then nobody can tell."""
    turned = Rotation.from_euler("XZ", [tilt, np.radians(roll)]).as_matrix()
    poses = [
        Pose3.from_rotation(Rotation.from_euler("y", 0.1 * i).as_matrix() @ turned, np.zeros(3))
        for i in range(40)
    ]
    found = remarks(poses, [None] * 40)
    assert ["turn all images by 180 deg" in one for one in found] == [True] * (tilt < 0.0 < roll)


def test_a_camera_at_rest_may_have_one_pose():
    poses = [pose(0.3, (0.0, 0.0, 0.0))] * 20
    assert remarks(poses, poses) == []


def test_a_jump_is_remarked_on_with_its_speed_and_time():
    given = walk()
    given[7:] = [Pose3.from_rotation(one.rotation, one.position + 30.0) for one in given[7:]]
    (remark,) = remarks(walk(), given)
    assert remark.startswith("the given poses move the camera at 260.1 m/s (at 1.400000 s)")


def test_poses_that_jump_by_kilometres_are_remarked_on_without_a_warning():
    most = max(float(np.abs(one.position).max()) for one in walk())
    given = [Pose3.from_rotation(one.rotation, one.position * 9e3 / most) for one in walk()]
    assert "are they in metres?" in remarks(walk(), given)[0]


def test_a_recording_opened_for_a_run_is_watched(tum):
    edited = "".join(f"{10 + i / 2} {900 * i} 0 0 0 0 0 1\n" for i in range(4))
    (tum / "groundtruth.txt").write_text(edited)
    recording = open_input(tum)
    list(recording.frames())
    assert "the given poses move the camera at 1800 m/s" in recording.remarks[-1]


@pytest.mark.parametrize("ignore", [False, True])
@pytest.mark.parametrize(
    ("step", "digits", "slow"), [(33.333, 0, True), (33.333, 3, False), (1, 0, False)]
)
def test_whole_stamps_far_apart_are_remarked_on_as_ms(tum, ignore, step, digits, slow):
    lines = [f"{round(step * i, digits)} {0.01 * i} 0 0 0 0 0 1\n" for i in range(4)]
    (tum / "groundtruth.txt").write_text("".join(lines))
    recording = open_input(tum, ignore_poses=ignore)
    list(recording.frames())
    found = [one for one in recording.remarks if "frames are 33 s apart" in one]
    assert ["may be in ms" in one for one in found] == [True] * slow


@pytest.mark.parametrize("separator", [";", "; "])
def test_poses_of_a_table_with_semicolons_may_have_decimal_commas(tum, separator):
    def moved():
        return [one.T_world_camera.translation for one in open_input(tum).frames()]

    rows = [f"{10 + i / 2} {0.25 * i} 0.5 0.0 0.0 0.0 0.6 0.8" for i in range(4)]
    (tum / "groundtruth.txt").write_text("\n".join(rows))
    expected = moved()
    table = [row.replace(".", ",").replace(" ", separator) for row in rows]
    (tum / "groundtruth.txt").write_text("\n".join(table))
    assert moved() == expected


def test_poses_without_depth_are_not_kept():
    """A recording of any length is read in constant memory."""
    readings, sizes = PoseReadings(), []
    for k in range(1000):
        readings.add(0.1 * k, Pose3((0.01 * k, 0.0, 0.0)), None)
        sizes.append(len(pickle.dumps(readings)))
    assert sizes[-1] < 1.5 * sizes[100]
