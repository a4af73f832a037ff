"""Conventions of other people's data: stereo calibrations, mirrored and turned axes, encoded depth, numbering."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from perception.primitives.errors import RecordingError
from surefoot.recordings.open import open_recording

WIDTH, HEIGHT = 160, 120
DESCRIPTION = """\
rate_hz = 10.0
[camera]
width = 16
height = 12
fx = 14.0
fy = {fy}
cx = 7.5
cy = 5.5
[depth]
scale_per_metre = 1000
none = [0]
"""


def write(path: Path, image: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), image)


def depth_folder(path: Path, images: list[np.ndarray], first: int = 0, fy: float = 14.0) -> Path:
    for i, image in enumerate(images):
        write(path / f"depth/{first + i}.png", image)
    (path / "recording.toml").write_text(DESCRIPTION.format(fy=fy))
    return path


def ramp(low: int = 1000) -> np.ndarray:
    return (low + 7 * np.arange(16 * 12)).reshape(12, 16).astype(np.uint16)


# Stereo pairs


def pairs(path: Path, left: str, right: str) -> Path:
    noise = np.random.default_rng(0).integers(0, 256, (2, HEIGHT, WIDTH), dtype=np.uint8)
    for k, image in enumerate(noise):
        write(path / left.format(k), image)
        write(path / right.format(k), image[:, ::-1])
    return path


def ros_yaml(fx: float, baseline_m: float) -> str:
    return (
        f"image_width: {WIDTH}\nimage_height: {HEIGHT}\ncamera_name: head\n"
        "camera_matrix:\n  rows: 3\n  cols: 3\n  data: [101, 0, 80, 0, 101, 60, 0, 0, 1]\n"
        "projection_matrix:\n  rows: 3\n  cols: 4\n"
        f"  data: [{fx}, 0, 79.5, {-fx * baseline_m}, 0, {fx}, 59.5, 0, 0, 0, 1, 0]\n"
    )


def test_times_in_the_names_of_pairs_stay_on_their_clock(tmp_path):
    path = pairs(tmp_path / "walk", "left/17000000{}5.25.png", "right/17000000{}5.25.png")
    (path / "left.yaml").write_text(ros_yaml(100.0, 0.0))
    (path / "right.yaml").write_text(ros_yaml(100.0, 0.12))
    stamps = [frame.stamp_s for frame in open_recording(path).frames()]
    assert stamps == [1700000005.25, 1700000015.25]


def kitti(values: dict[str, float]) -> str:
    """`calib.txt` with the fourth number of each matrix."""
    return "".join(
        f"{n}: 100.0 0 79.5 {x} 0 100.0 59.5 0.2 0 0 1 0.003\n" for n, x in values.items()
    )


@pytest.mark.parametrize(("left", "baseline_m"), [(0, 0.54), (2, 0.53)])
def test_a_sequence_of_kitti_is_read_with_its_calibration_and_times(tmp_path, left, baseline_m):
    path = pairs(tmp_path / "00", f"image_{left}/{{:06d}}.png", f"image_{left + 1}/{{:06d}}.png")
    (path / "calib.txt").write_text(kitti({"P0": 0.0, "P1": -54.0, "P2": 6.0, "P3": -47.0}))
    (path / "times.txt").write_text("0.000000e+00\n1.036224e-01\n")
    frames = list(open_recording(path).frames())
    assert [frame.stamp_s for frame in frames] == [0.0, 0.1036224]
    view = frames[0].stereo
    assert view.baseline_m == pytest.approx(baseline_m)
    assert (view.camera.fx, view.camera.cy, view.camera.width) == (100.0, 59.5, WIDTH)


def test_pairs_without_a_calibration_are_refused_with_what_is_missing(tmp_path):
    path = pairs(tmp_path / "00", "image_0/{:06d}.png", "image_1/{:06d}.png")
    with pytest.raises(RecordingError, match=r"without a calibration.*left\.yaml.*calib\.txt"):
        open_recording(path)
    (path / "calib.txt").write_text(kitti({"P0": 0.0}))
    with pytest.raises(RecordingError, match=r"calib\.txt: has no list P1; 12 numbers"):
        open_recording(path)


def test_a_calibration_of_kitti_is_for_its_own_folders_only(tmp_path):
    path = pairs(tmp_path / "00", "left/{:06d}.png", "right/{:06d}.png")
    (path / "image_0").mkdir()
    (path / "image_0" / "000000.png").write_bytes((path / "left" / "000000.png").read_bytes())
    (path / "calib.txt").write_text(kitti({"P0": 0.0, "P1": -54.0}))
    with pytest.raises(RecordingError, match="without a calibration"):
        open_recording(path)


def test_times_must_be_as_many_as_images(tmp_path):
    path = pairs(tmp_path / "00", "image_0/{:06d}.png", "image_1/{:06d}.png")
    (path / "calib.txt").write_text(kitti({"P0": 0.0, "P1": -54.0}))
    (path / "times.txt").write_text("0.0\n")
    with pytest.raises(RecordingError, match=r"times\.txt: 1 times for 2 left images"):
        open_recording(path)


@pytest.mark.parametrize(
    ("left", "right"),
    [
        ("left/{:03d}.png", "right/{:03d}.png"),
        ("image_0/{:03d}.png", "image_1/{:03d}.png"),
        ("left_{:03d}.png", "right_{:03d}.png"),
    ],
)
def test_a_rectified_pair_is_read_with_the_calibration_of_ros(tmp_path, left, right):
    path = pairs(tmp_path / "walk", left, right)
    (path / "left.yaml").write_text(ros_yaml(100.0, 0.0))
    (path / "right.yaml").write_text(ros_yaml(100.0, 0.12))
    recording = open_recording(path)
    assert recording.info.kind == "stereo"
    frames = list(recording.frames())
    assert len(frames) == 2
    view = frames[0].stereo
    assert view is not None
    assert view.baseline_m == pytest.approx(0.12)
    assert (view.camera.fx, view.camera.cx, view.camera.cy) == (100.0, 79.5, 59.5)
    np.testing.assert_array_equal(view.right, view.left[:, ::-1])


@pytest.mark.parametrize("suffix", ["yml", "xml"])
def test_a_rectified_pair_is_read_with_the_calibration_of_opencv(tmp_path, suffix):
    path = pairs(tmp_path / "walk", "left/{}.png", "right/{}.png")
    P1 = np.array([[100.0, 0, 79.5, 0], [0, 100.0, 59.5, 0], [0, 0, 1, 0]])
    P2 = P1.copy()
    P2[0, 3] = -100.0 * 0.08
    storage = cv2.FileStorage(str(path / f"extrinsics.{suffix}"), cv2.FILE_STORAGE_WRITE)
    for name, matrix in (("R1", np.eye(3)), ("P1", P1), ("P2", P2)):
        storage.write(name, matrix)
    storage.release()
    view = next(open_recording(path).frames()).stereo
    assert view is not None
    assert view.baseline_m == pytest.approx(0.08)
    assert (view.camera.width, view.camera.fy) == (WIDTH, 100.0)


def test_a_pair_whose_sides_are_exchanged_is_refused(tmp_path):
    path = pairs(tmp_path / "walk", "left/{}.png", "right/{}.png")
    (path / "left.yaml").write_text(ros_yaml(100.0, 0.0))
    (path / "right.yaml").write_text(ros_yaml(100.0, -0.12))
    with pytest.raises(RecordingError, match=r"baseline of -0.12 m; .* may be exchanged"):
        open_recording(path)


def test_the_pair_of_a_real_robot_is_read(recordings):
    view = next(open_recording(recordings / "rtabmap_3it").frames()).stereo
    assert view is not None
    assert view.baseline_m == pytest.approx(0.11969, abs=1e-5)
    assert view.camera.fx == pytest.approx(487.609, abs=1e-3)


# Axes


def poses_file(path: Path, rotation: Rotation, position: list[float]) -> None:
    row = [0.0, *position, *rotation.as_quat().tolist()]
    (path / "poses.txt").write_text(" ".join(map(str, row)) + "\n")


# T_world_optical = T_world_given R_given_optical: what the optical axis is in the camera's own axes
OPTICAL = {
    "optical": {"right": [1, 0, 0], "ahead": [0, 0, 1]},
    "y-up": {"right": [1, 0, 0], "ahead": [0, 0, -1]},
    "body": {"right": [0, -1, 0], "ahead": [1, 0, 0]},
}


@pytest.mark.parametrize("axes", OPTICAL)
def test_poses_of_cameras_with_other_axes_are_turned(tmp_path, axes):
    path = depth_folder(tmp_path / "walk", [ramp()])
    turn = Rotation.from_euler("xyz", [0.3, -0.2, 1.1])
    poses_file(path, turn, [1.0, 2.0, 3.0])
    with (path / "recording.toml").open("a") as file:
        file.write(f'[poses]\nfile = "poses.txt"\naxes = "{axes}"\n')
    pose = next(open_recording(path).frames()).T_world_camera
    assert pose is not None
    np.testing.assert_allclose(pose.position, [1.0, 2.0, 3.0])
    for column, own in ((0, OPTICAL[axes]["right"]), (2, OPTICAL[axes]["ahead"])):
        np.testing.assert_allclose(pose.rotation[:, column], turn.apply(own), atol=1e-12)


def test_a_negative_fy_mirrors_the_poses_so_that_points_keep_their_places(tmp_path):
    """ICL-NUIM: x = (u - cx) / fx, y = (v - cy) / fy with fy < 0, in a world with y up."""
    path = depth_folder(tmp_path / "walk", [ramp()], fy=-14.0)
    turn = Rotation.from_euler("xyz", [0.2, 0.4, -0.1])
    poses_file(path, turn, [1.0, 2.0, 3.0])
    with (path / "recording.toml").open("a") as file:
        file.write('[poses]\nfile = "poses.txt"\n[world]\nup = [0, 1, 0]\n')
    recording = open_recording(path)
    frame = next(recording.frames())
    assert frame.depth is not None
    assert frame.T_world_camera is not None
    assert frame.depth.camera.fy == 14.0
    assert recording.info.gravity_up_world == (0.0, -1.0, 0.0)
    u, v, z = 3.0, 9.0, 2.0
    printed = turn.apply([z * (u - 7.5) / 14.0, z * (v - 5.5) / -14.0, z]) + np.array([1, 2, 3])
    ours = frame.T_world_camera.apply(np.array([[z * (u - 7.5) / 14, z * (v - 5.5) / 14, z]]))[0]
    np.testing.assert_allclose(ours * [1.0, -1.0, 1.0], printed)


# Encoded depth


def rotated(depth_mm: np.ndarray) -> np.ndarray:
    return np.asarray((depth_mm << 3) | (depth_mm >> 13), np.uint16)


def state(path: Path, encoding: str) -> None:
    text = (path / "recording.toml").read_text()
    (path / "recording.toml").write_text(
        text.replace("none = [0]", f'none = [0]\nencoding = "{encoding}"')
    )


def test_the_rotated_depth_of_sun_rgbd_is_named_and_then_read(tmp_path):
    depth_mm = ramp(900)
    depth_mm[0, 0] = 9000  # needs its upper bits
    path = depth_folder(tmp_path / "shop", [rotated(depth_mm)])
    with pytest.raises(RecordingError, match=r'multiples of 8 .* encoding = "rotated"'):
        list(open_recording(path).frames())
    state(path, "rotated")
    view = next(open_recording(path).frames()).depth
    assert view is not None
    np.testing.assert_allclose(view.depth, depth_mm / 1000.0, rtol=1e-6)


def test_true_depth_in_multiples_of_8_is_read_on_request(tmp_path):
    path = depth_folder(
        tmp_path / "shop", [(8 * (100 + np.arange(192))).reshape(12, 16).astype(np.uint16)]
    )
    state(path, "depth")
    view = next(open_recording(path).frames()).depth
    assert view is not None
    assert view.depth[0, 0] == pytest.approx(0.8)


def test_raw_kinect_disparity_is_named_and_then_read(tmp_path):
    # the calibration that Burrus prints: 0.5 m at about 434, 2 m at about 922
    raw = np.linspace(434, 922, 192).astype(np.uint16).reshape(12, 16)
    raw[0, 5] = 2047
    path = depth_folder(tmp_path / "desk", [raw])
    with pytest.raises(RecordingError, match=r'raw Kinect disparity .* encoding = "kinect-disp'):
        list(open_recording(path).frames())
    state(path, "kinect-disparity")
    view = next(open_recording(path).frames()).depth
    assert view is not None
    assert view.depth[0, 0] == pytest.approx(0.5, abs=0.01)
    assert view.depth[-1, -1] == pytest.approx(2.0, abs=0.01)
    assert np.isnan(view.depth[0, 5])


def test_ordinary_depth_in_millimetres_needs_no_statement(tmp_path):
    near = ramp(500)
    near[0, :4] = 2047  # a depth like any other
    assert len(list(open_recording(depth_folder(tmp_path / "a", [near, ramp()])).frames())) == 2


# Numbering


@pytest.mark.parametrize("first", [0, 1, 17])
def test_frames_may_be_numbered_from_anywhere(tmp_path, first):
    path = depth_folder(tmp_path / "walk", [ramp(), ramp(1100), ramp(1200)], first)
    medians = [float(np.median(f.depth.depth)) for f in open_recording(path).frames() if f.depth]
    assert medians == sorted(medians)
    assert len(medians) == 3


def tum_folder(path: Path, numbers: list[int], lines: list[float]) -> Path:
    for n in numbers:
        write(path / f"depth/{n:04d}.png", ramp())
    rows = [f"{stamp:g} {stamp:g} 0 0 0 0 0 1" for stamp in lines]
    (path / "groundtruth.txt").write_text("\n".join(rows))
    camera = DESCRIPTION.format(fy=14.0)
    (path / "recording.toml").write_text(camera[camera.index("[camera]") : camera.index("[depth]")])
    return path


@pytest.mark.parametrize(
    ("numbers", "lines", "expected"),
    [
        ([30, 31, 33], [0.1, 0.2, 0.3], [0.1, 0.2, 0.3]),  # as many lines as images: in order
        ([0, 2], [0.1, 0.2, 0.3], [0.1, 0.3]),  # the number counts the lines from 0
        ([1, 3], [0.1, 0.2, 0.3], [0.1, 0.3]),  # from 1
        ([31, 33], [30, 31, 32, 33], [31, 33]),  # the number is the stamp
    ],
)
def test_poses_of_numbered_images_are_found(tmp_path, numbers, lines, expected):
    recording = open_recording(tum_folder(tmp_path / "fr3_x", numbers, lines))
    poses = [frame.T_world_camera for frame in recording.frames()]
    assert [pose.translation[0] for pose in poses if pose is not None] == expected


# Intrinsics


K = {"fx": 14.0, "fy": 15.0, "ppx": 7.5, "ppy": 5.5, "width": 16, "height": 12}
MATRIX = [14.0, 0, 0, 0, 15.0, 0, 7.5, 5.5, 1]
ROWS = [[14.0, 0, 7.5], [0, 15.0, 5.5], [0, 0, 1]]


@pytest.mark.parametrize(
    ("content", "lens"),
    [
        ({"width": 16, "height": 12, "intrinsic_matrix": MATRIX}, [0.0] * 5),
        ({"width": 16, "height": 12, "intrinsic_matrix": ROWS}, [0.0] * 5),
        ({"intrinsic": {"width": 16, "height": 12, "intrinsic_matrix": MATRIX}}, [0.0] * 5),
        (K | {"model": "distortion.none", "coeffs": [0.0] * 5}, [0.0] * 5),
        (K | {"model": "distortion.inverse_brown_conrady", "coeffs": [0.1] * 5}, [0.0] * 5),
        (K | {"model": "distortion.brown_conrady", "coeffs": [0.1, 0, 0, 0, 0]}, [0.1, 0, 0, 0, 0]),
        ({"depth": K, "depth_scale": 0.001}, [0.0] * 5),
        (K | {"depth_scale": 1000.0}, [0.0] * 5),
    ],
)
def test_intrinsics_are_read_as_open3d_and_realsense_write_them(tmp_path, content, lens):
    write(tmp_path / "cam/depth/0.png", ramp())
    (tmp_path / "cam/intrinsics.json").write_text(json.dumps(content))
    view = next(open_recording(tmp_path / "cam").frames()).depth
    assert view is not None
    camera = view.camera
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (14.0, 15.0, 7.5, 5.5)
    assert list(camera.distortion) == lens
    assert view.depth[0, 0] == pytest.approx(1.0)
