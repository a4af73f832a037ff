"""Scans as ScanNet's exporter writes them: a floor with known colours, seen by two cameras from known places."""

import shutil

import cv2
import numpy as np
import pytest

from perception.primitives.camera import Camera
from perception.primitives.errors import RecordingError
from perception.primitives.pose import Pose3
from surefoot.recordings.find import below
from surefoot.recordings.open import open_recording

DEPTH = Camera(32, 24, 28.5, 28.5, 15.5, 11.5)
COLOUR = Camera(64, 48, 58.0, 58.5, 32.0, 23.0)
NUMBERS = (
    0,
    20,
    40,
    100,
)  # every 20th frame, as exported; sorted as text, 100 would come before 20
LOST = 40


def pose(number):
    """1.5 m above the floor z = 0, looking ahead along x and down by 0.7 rad, moving along x and turning."""
    down, yaw = 0.7, 0.01 * number
    ahead = np.array([np.cos(down) * np.cos(yaw), np.cos(down) * np.sin(yaw), -np.sin(down)])
    right = np.array([np.sin(yaw), -np.cos(yaw), 0.0])
    R = np.column_stack([right, np.cross(ahead, right), ahead])
    return Pose3.from_rotation(R, np.array([0.01 * number, 0.2, 1.5]))


def floor_seen(camera, T):
    """Depth of the floor z = 0 in each pixel, m, and its points in the world."""
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    x, y = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
    rays = np.stack([x, y, np.ones_like(x)], axis=-1) @ T.rotation.T
    depth = -T.position[2] / rays[..., 2]
    return depth, T.position + depth[..., None] * rays


def painted(points):
    """Colour of the floor: red grows along x, green along y."""
    red, green = 60.0 * points[..., 0], 128.0 + 60.0 * points[..., 1]
    return np.clip(np.stack([red, green, np.full_like(red, 90.0)], axis=-1), 0, 255)


def matrix_of(T):
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = T.rotation, T.position
    return matrix


def intrinsics(camera):
    k = np.eye(4)
    k[0, 0], k[1, 1], k[0, 2], k[1, 2] = camera.fx, camera.fy, camera.cx, camera.cy
    return k


@pytest.fixture
def scan(tmp_path):
    path = tmp_path / "scene0707_00"
    for folder in ("depth", "color", "pose", "intrinsic"):
        (path / folder).mkdir(parents=True)
    for number in NUMBERS:
        T = pose(number)
        millimetres = np.round(1000.0 * floor_seen(DEPTH, T)[0]).astype(np.uint16)
        cv2.imwrite(str(path / f"depth/{number}.png"), millimetres)
        rgb = painted(floor_seen(COLOUR, T)[1]).astype(np.uint8)
        cv2.imwrite(
            str(path / f"color/{number}.jpg"), rgb[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 100]
        )
        matrix = np.full((4, 4), -np.inf) if number == LOST else matrix_of(T)
        np.savetxt(path / f"pose/{number}.txt", matrix, fmt="%f")
    np.savetxt(path / "intrinsic/intrinsic_depth.txt", intrinsics(DEPTH), fmt="%f")
    np.savetxt(path / "intrinsic/intrinsic_color.txt", intrinsics(COLOUR), fmt="%f")
    for kind in ("depth", "color"):
        np.savetxt(path / f"intrinsic/extrinsic_{kind}.txt", np.eye(4), fmt="%f")
    return path


def world_of(frame, T):
    """The points of a depth image in the world, by a pose."""
    camera, depth = frame.depth.camera, frame.depth.depth.astype(np.float64)
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    x, y = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
    return T.position + depth[..., None] * (np.stack([x, y, np.ones_like(x)], -1) @ T.rotation.T)


def test_depth_with_its_pose_is_the_floor_and_the_numbers_are_times(scan):
    recording = open_recording(scan)
    frames = list(recording.frames())
    assert (recording.info.kind, recording.info.name) == ("scannet", "scene0707_00")
    assert (recording.info.poses_given, recording.info.gravity_up_world) == (True, (0.0, 0.0, 1.0))
    assert [frame.stamp_s for frame in frames] == pytest.approx([n / 30.0 for n in NUMBERS])
    for number, frame in zip(NUMBERS, frames, strict=True):
        if number != LOST:
            np.testing.assert_allclose(frame.T_world_camera.position, pose(number).position)
            assert np.abs(world_of(frame, frame.T_world_camera)[..., 2]).max() < 1.5e-3


def test_colour_has_the_intrinsics_of_its_own_camera(scan):
    for number, frame in zip(NUMBERS, open_recording(scan).frames(), strict=True):
        T, camera = pose(number), frame.colour.camera
        points = world_of(frame, T)
        inside = (points - T.position) @ T.rotation
        u = np.rint(camera.fx * inside[..., 0] / inside[..., 2] + camera.cx).astype(int)
        v = np.rint(camera.fy * inside[..., 1] / inside[..., 2] + camera.cy).astype(int)
        seen = (u >= 0) & (u < camera.width) & (v >= 0) & (v < camera.height)
        found = frame.colour.rgb[v[seen], u[seen]].astype(float)
        assert np.count_nonzero(seen) > 0.9 * seen.size
        assert np.median(np.abs(found - painted(points)[seen]).max(axis=-1)) < 4.0


def test_a_frame_where_tracking_was_lost_keeps_its_depth_and_is_named(scan):
    recording = open_recording(scan)
    frames = list(recording.frames())
    assert [frame.T_world_camera is None for frame in frames] == [n == LOST for n in NUMBERS]
    assert recording.skipped == []
    assert recording.remarks == ["1 frame without pose: it is not finite (first: 40.png)"]


def test_a_scan_without_poses_is_one_without_poses(scan):
    shutil.rmtree(scan / "pose")
    assert not open_recording(scan).info.poses_given


def test_a_scan_that_was_never_tracked_is_one_without_poses(scan):
    for file in (scan / "pose").iterdir():
        np.savetxt(file, np.full((4, 4), -np.inf), fmt="%f")
    recording = open_recording(scan)
    assert len(list(recording.frames())) == len(NUMBERS)
    assert not recording.info.poses_given


def test_a_missing_pose_costs_its_frame_the_pose_alone(scan):
    (scan / "pose/20.txt").unlink()
    recording = open_recording(scan)
    frames = list(recording.frames())
    assert [frame.T_world_camera is None for frame in frames] == [False, True, True, False]
    assert "1 of 4 images have no pose (first 20.png)" in recording.remarks


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("1 0 0\n0 1 0\n0 0 1\n", "pose file: 9 numbers; expected 7: tx ty tz qx qy qz qw; 12: "),
        ("1 0 0 0\n0 1 zero 0\n", "pose file, line 2: 'zero' is not a number; expected"),
        ("", "pose file: has no lines of data"),
        ("2 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n", "pose is invalid: R R^T differs from 1 by 3.00"),
    ],
)
def test_a_damaged_pose_skips_its_frame(scan, text, reason):
    (scan / "pose/20.txt").write_text(text)
    recording = open_recording(scan)
    assert len(list(recording.frames())) == len(NUMBERS) - 1
    assert recording.skipped[0].name == "20.png"
    assert recording.skipped[0].reason.startswith(reason)


def test_the_subset_of_25k_has_its_intrinsics_beside_the_folders(scan):
    for kind in ("depth", "color"):
        shutil.move(scan / f"intrinsic/intrinsic_{kind}.txt", scan / f"intrinsics_{kind}.txt")
    shutil.rmtree(scan / "intrinsic")
    frame = next(open_recording(scan).frames())
    assert (frame.depth.camera, frame.colour.camera) == (DEPTH, COLOUR)


def test_colour_images_that_were_made_smaller_do_not_fit_their_intrinsics(scan):
    for file in (scan / "color").iterdir():
        cv2.imwrite(str(file), cv2.resize(cv2.imread(str(file)), (32, 24)))
    recording = open_recording(scan)
    assert all(frame.colour is None for frame in recording.frames())
    assert "colour left out: focal length (58, 58.5)" in recording.remarks[0]


def test_damaged_colour_images_cost_colour_alone(scan):
    for file in (scan / "color").iterdir():
        file.write_bytes(b"none")
    recording = open_recording(scan)
    assert all(frame.colour is None for frame in recording.frames())
    assert any("4 colour images cannot be used" in remark for remark in recording.remarks)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1 0 0\n0 1 0\n0 0 1\n", "intrinsic_depth.txt: 3 rows; a 4x4 matrix was expected"),
        ("x 0 0 0\n" + 3 * "0 0 0 0\n", "intrinsic_depth.txt, line 1: 'x' is not a number"),
        ("0 0 0 0\n" * 4, "intrinsic_depth.txt: camera: fx=0.0 px must be positive"),
    ],
)
def test_intrinsics_that_are_none_are_refused_by_file_and_line(scan, text, message):
    (scan / "intrinsic/intrinsic_depth.txt").write_text(text)
    with pytest.raises(RecordingError, match=message):
        open_recording(scan)


def test_a_scan_without_depth_images_is_refused(scan):
    for file in (scan / "depth").iterdir():
        file.unlink()
    with pytest.raises(RecordingError, match="depth: no depth image can be read"):
        open_recording(scan)


def test_poses_that_belong_to_no_image_are_refused(scan):
    for number in NUMBERS[1:]:
        (scan / f"pose/{number}.txt").unlink()
    shutil.move(scan / "pose/0.txt", scan / "pose/7.txt")
    with pytest.raises(RecordingError, match="4 images but 1 poses, and their names do not match"):
        open_recording(scan)


def test_scans_and_recordings_of_phones_are_found_below_a_folder(scan, stray_scanner):
    assert sorted(below(scan.parent)) == sorted([scan, stray_scanner])
