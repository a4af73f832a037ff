"""Folders of every layout: pixels, stamps, poses, intrinsics and scale against the written values."""

import math
import shutil

import cv2
import numpy as np
import pytest

from perception.primitives.camera import Camera
from perception.primitives.errors import RecordingError
from surefoot.recordings.folder import AHEAD
from surefoot.recordings.open import open_recording
from surefoot.recordings.recording import Recording

UP_45 = (0.0, math.sqrt(0.5), math.sqrt(0.5))


def units(index):
    """The frames of conftest: a ramp with one hole."""
    image = (1000 + 10 * index + np.arange(16 * 12)).reshape(12, 16).astype(np.float64)
    image[0, 0] = np.nan
    return image


def checked(recording, kind, per_metre, stamps, positions):
    frames = list(recording.frames())
    assert recording.info.kind == kind
    assert recording.info.frames == len(frames) == len(stamps)
    assert recording.skipped == []
    for i, (frame, stamp_s) in enumerate(zip(frames, stamps, strict=True)):
        assert frame.stamp_s == pytest.approx(stamp_s, abs=1e-12)
        np.testing.assert_allclose(frame.depth.depth, units(i) / per_metre, rtol=1e-7)
        assert frame.depth.T_body_camera is None
        assert tuple(frame.colour.rgb[3, 3]) == (200, 20, 10)
        if positions is None:
            assert frame.T_world_camera is None
        else:
            np.testing.assert_allclose(frame.T_world_camera.position, positions[i], atol=1e-12)
    assert recording.info.poses_given == (positions is not None)
    return frames


def test_a_thinned_tum_folder_is_read(tum):
    stamps = [10.0, 10.5, 11.0, 11.5]
    recording = open_recording(tum)
    frames = checked(recording, "tum", 5000, stamps, [(s, 2.0, 3.0) for s in stamps])
    assert frames[0].T_world_camera.quat_xyzw == (0.0, 0.0, 0.6, 0.8)
    assert frames[0].depth.camera.fx == 14.0
    assert recording.info.gravity_up_world == (0.0, 0.0, 1.0)


def test_a_path_may_be_a_string(tum):
    assert len(list(open_recording(str(tum)).frames())) == len(list(open_recording(tum).frames()))


def test_a_complete_tum_folder_is_associated_by_time(tum_listed):
    stamps = [0.5, 1.5, 2.5, 3.5]
    recording = open_recording(tum_listed)
    frames = list(recording.frames())
    assert [frame.stamp_s for frame in frames] == stamps
    assert [f.T_world_camera and f.T_world_camera.translation[0] for f in frames] == [
        0.5,
        1.5,
        2.5,
        None,  # the poses end at 2.99 s
    ]
    assert all(frame.colour is not None for frame in frames)
    assert "1 of 4 depth images have no pose within 0.02 s" in recording.remarks


def test_the_comment_of_a_list_tells_the_camera_of_a_renamed_folder(tum_listed, tmp_path):
    (tum_listed / "recording.toml").unlink()
    folder = tum_listed.rename(tmp_path / "mine")
    text = (folder / "depth.txt").read_text()
    (folder / "depth.txt").write_text("# file: 'rgbd_dataset_freiburg2_desk.bag'\n" + text)
    assert any(
        "camera freiburg2" in one and "desk.bag" in one for one in open_recording(folder).remarks
    )


def test_lists_and_poses_of_another_camera_go_with_its_scale(tum_listed, tmp_path):
    """As ORB-SLAM's users record a RealSense: lists as of the benchmark, millimetres."""
    with (tum_listed / "recording.toml").open("a") as toml:
        toml.write("[depth]\nscale_per_metre = 1000\nnone = [0]\n")
    folder = tum_listed.rename(tmp_path / "mine")
    recording = open_recording(folder)
    frames = list(recording.frames())
    assert [frame.stamp_s for frame in frames] == [0.5, 1.5, 2.5, 3.5]
    for i, frame in enumerate(frames):
        np.testing.assert_allclose(frame.depth.depth, units(i) / 1000.0, rtol=1e-7)
        assert frame.colour is not None
    assert [f.T_world_camera and f.T_world_camera.translation[0] for f in frames] == [
        *(0.5, 1.5, 2.5),
        None,
    ]
    assert recording.info.gravity_up_world == (0.0, 0.0, 1.0)


@pytest.fixture
def eth3d(tum_listed, tmp_path):
    """As TUM, with the intrinsics in a file of their own."""
    (tum_listed / "recording.toml").unlink()
    (tum_listed / "calibration.txt").write_text("14.5 14.25 7.25 5.75\n")
    return shutil.move(tum_listed, tmp_path / "cables_1")


def test_eth3d_has_its_intrinsics_and_the_scale_of_tum(eth3d):
    recording = open_recording(eth3d)
    frames = list(recording.frames())
    assert [frame.stamp_s for frame in frames] == [0.5, 1.5, 2.5, 3.5]
    for i, frame in enumerate(frames):
        assert frame.depth.camera == Camera(16, 12, 14.5, 14.25, 7.25, 5.75)
        np.testing.assert_allclose(frame.depth.depth, units(i) / 5000.0, rtol=1e-7)
        assert frame.colour is not None
    for frame in frames[:3]:  # the poses end at 2.99 s
        np.testing.assert_allclose(frame.T_world_camera.position, (frame.stamp_s, 2.0, 3.0))
    assert recording.info.gravity_up_world is None
    assert (
        "calibration.txt of ETH3D: its intrinsics, and 5000 units of depth per metre"
        in recording.remarks
    )


def test_a_calibration_is_used_where_the_benchmark_has_no_camera_with_its_lens(eth3d, tmp_path):
    for file in (eth3d / "depth").iterdir():
        cv2.imwrite(str(file), np.full((480, 640), 9000, np.uint16))
    (eth3d / "calibration.txt").write_text("517.3 516.5 318.6 255.3\n")
    assert next(open_recording(eth3d).frames()).depth.camera.distortion == (0.0,) * 5
    recording = open_recording(shutil.move(eth3d, tmp_path / "rgbd_dataset_freiburg1_desk"))
    assert next(recording.frames()).depth.camera.distortion[0] == 0.2624
    assert recording.info.gravity_up_world == (0.0, 0.0, 1.0)


def test_eth3d_takes_its_size_from_the_first_image_that_can_be_read(eth3d):
    (eth3d / "depth/0.5000.png").write_bytes(b"none")
    recording = open_recording(eth3d)
    assert len(list(recording.frames())) == 3
    assert recording.skipped[0].name == "0.5000.png"


def test_a_scale_that_is_stated_goes_before_that_of_eth3d(eth3d):
    (eth3d / "recording.toml").write_text("[depth]\nscale_per_metre = 1000\nnone = [0]\n")
    frame = next(open_recording(eth3d).frames())
    assert frame.depth.camera.fx == 14.5
    np.testing.assert_allclose(frame.depth.depth, units(0) / 1000.0, rtol=1e-7)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("14 14 7", "calibration.txt, line 1: 3 numbers, expected 4: fx fy cx cy"),
        ("14 14 7 5 0.1", "calibration.txt, line 1: 5 numbers, expected 4: fx fy cx cy"),
        ("# f\n14 14 x 5", "calibration.txt, line 2: 'x' is not a number; expected fx fy cx cy"),
        ("", "calibration.txt: has no lines of data"),
        ("0.8 0.8 7 5", "calibration.txt: camera: fx=0.8 px for an image 16 px wide"),
    ],
)
def test_a_calibration_that_is_none_is_refused_by_file_and_line(eth3d, text, message):
    (eth3d / "calibration.txt").write_text(text)
    with pytest.raises(RecordingError, match=message):
        open_recording(eth3d)


def test_a_tum_folder_of_an_unknown_camera_needs_its_scale(tum_listed, tmp_path):
    folder = tum_listed.rename(tmp_path / "mine")
    with pytest.raises(RecordingError, match=r"intrinsics and depth scale\n(.*\n)*scale_per_metre"):
        open_recording(folder)


def test_a_tum_folder_without_lists_uses_the_stamps_of_the_file_names(tum_listed):
    listed = [(f.stamp_s, f.T_world_camera) for f in open_recording(tum_listed).frames()]
    for name in ("depth.txt", "rgb.txt"):
        (tum_listed / name).unlink()
    assert [(f.stamp_s, f.T_world_camera) for f in open_recording(tum_listed).frames()] == listed


def test_a_tum_colour_image_too_far_in_time_is_left_out_and_remarked(tum_listed):
    text = (tum_listed / "rgb.txt").read_text().replace("1.512 ", "1.5201 ")
    (tum_listed / "rgb.txt").write_text(text)
    recording = open_recording(tum_listed)
    assert [f.colour is None for f in recording.frames()] == [False, True, False, False]
    assert "1 of 4 depth images have no colour image within 0.02 s" in recording.remarks


@pytest.mark.parametrize(
    ("name", "fx"),
    [
        ("rgbd_dataset_freiburg1_xyz", 517.3),
        ("freiburg2_desk", 520.9),
        ("tum_fr3_cabinet", 535.4),
    ],
)
def test_the_folder_name_selects_the_tum_camera(tum, tmp_path, name, fx):
    (tum / "recording.toml").unlink()
    shutil.move(tum, tmp_path / name)
    recording = open_recording(tmp_path / name)
    assert any("intrinsics of camera freiburg" in r for r in recording.remarks)
    with pytest.raises(RecordingError, match="is 16x12 px; 640x480 px was expected"):
        next(recording.frames())
    big = np.full((480, 640), 5000, np.uint16)
    cv2.imwrite(str(tmp_path / name / "depth/0000.png"), big)
    cv2.imwrite(str(tmp_path / name / "rgb/0000.png"), np.zeros((480, 640, 3), np.uint8))
    assert next(recording.frames()).depth.camera.fx == fx


def test_stray_scanner(stray_scanner):
    """Two of three frames have a pose; the camera is turned by 90 deg, as a phone that is held upright."""
    recording = open_recording(stray_scanner)
    frames = list(recording.frames())
    assert (recording.info.kind, recording.info.gravity_up_world) == (
        "stray_scanner",
        (0.0, 1.0, 0.0),
    )
    assert [frame.stamp_s for frame in frames] == [65575.5, 65575.6]
    assert recording.skipped == []
    assert any("1 of 3 depth images have no line" in one for one in recording.remarks)
    camera = frames[0].depth.camera
    assert (camera.fx, camera.fy) == pytest.approx((14.0, 14.0))
    assert (camera.cx, camera.cy) == pytest.approx((7.5, 5.5))
    for i, frame in enumerate(frames):
        expected = units(i) / 1000.0
        expected[:, :3] = np.nan  # confidence 0
        np.testing.assert_allclose(frame.depth.depth, expected, rtol=1e-7)
        np.testing.assert_allclose(frame.T_world_camera.position, (0.1 * i, 1.4, 0.0))
        # its x axis points down, its optical axis level to -z of ARKit
        axes = frame.T_world_camera.rotation
        np.testing.assert_allclose(axes[:, 0], (0.0, -1.0, 0.0), atol=1e-7)
        np.testing.assert_allclose(axes[:, 2], (0.0, 0.0, -1.0), atol=1e-7)


def test_a_frame_of_stray_scanner_without_any_confidence_is_skipped(stray_scanner):
    cv2.imwrite(str(stray_scanner / "confidence/000000.png"), np.zeros((12, 16), np.uint8))
    recording = open_recording(stray_scanner)
    assert len(list(recording.frames())) == 1
    assert "confidence" in recording.skipped[0].reason


def test_seven_scenes(seven_scenes):
    recording = open_recording(seven_scenes)
    stamps = [0.0, 4 / 30, 8 / 30]
    frames = checked(recording, "seven_scenes", 1000, stamps, [(i, 2.0, 3.0) for i in range(3)])
    assert (frames[0].depth.camera.fx, frames[0].depth.camera.cy) == (14.0, 5.5)
    assert recording.info.gravity_up_world == pytest.approx((0.0, -0.6, -0.8))
    assert recording.info.name == "kitchen-seq-01"
    assert recording.remarks == []


def test_the_last_value_of_16_bits_is_no_depth_though_only_0_is_said_to_be_none(redwood):
    image = np.full((12, 16), 65535, np.uint16)
    image[:3] = 1000
    cv2.imwrite(str(redwood / "depth/00000.png"), image)
    depth = next(open_recording(redwood).frames()).depth.depth
    assert np.isnan(depth[3:]).all()
    assert np.nanmax(depth) < 2.0


def test_seven_scenes_treats_65535_as_no_depth(seven_scenes):
    image = np.full((12, 16), 65535, np.uint16)
    image[5, 5] = 2000
    cv2.imwrite(str(seven_scenes / "frame-000000.depth.png"), image)
    depth = next(open_recording(seven_scenes).frames()).depth.depth
    assert np.isfinite(depth).sum() == 1
    assert depth[5, 5] == 2.0


def test_seven_scenes_without_intrinsics_remarks_which_are_used(seven_scenes):
    for name in ("camera-intrinsics.txt", "gravity-direction.txt"):
        (seven_scenes.parent / name).unlink()
    for depth in seven_scenes.glob("*.depth.png"):
        cv2.imwrite(str(depth), np.full((480, 640), 1000, np.uint16))
    recording = open_recording(seven_scenes)
    assert recording.info.gravity_up_world is None
    assert "585 585 320 240 of the data set's page" in recording.remarks[0]


def test_redwood(redwood):
    recording = open_recording(redwood)
    positions = [(i, 0.5, 0.0) for i in range(3)]
    frames = checked(recording, "redwood", 1000, [0.0, 1 / 30, 2 / 30], positions)
    assert (frames[0].depth.camera.fx, frames[0].depth.camera.fy) == (14.0, 15.0)
    assert recording.info.gravity_up_world == (0.0, 1.0, 0.0)


def test_a_camera_that_rolls_gives_no_vertical_axis(redwood):
    c, s = math.cos(0.01), math.sin(0.01)
    text = (redwood / "trajectory.log").read_text()
    rolled = text.replace("1 0 0 2\n0 -1 0 0.5", f"{c} {s} 0 2\n{s} {-c} 0 0.5")
    assert rolled != text
    (redwood / "trajectory.log").write_text(rolled)
    assert open_recording(redwood).info.gravity_up_world is None


def test_redwood_without_poses_is_the_layout_of_open3d(redwood):
    (redwood / "trajectory.log").unlink()
    recording = open_recording(redwood)
    assert checked(recording, "redwood", 1000, [0.0, 1 / 30, 2 / 30], None)
    assert recording.info.gravity_up_world is None


def test_a_depth_scale_in_the_intrinsics_is_used(redwood):
    source = redwood / "camera_primesense.json"
    source.write_text(source.read_text().replace("{", '{"depth_scale": 4000.0, ', 1))
    positions = [(i, 0.5, 0.0) for i in range(3)]
    assert checked(open_recording(redwood), "redwood", 4000, [0.0, 1 / 30, 2 / 30], positions)


@pytest.mark.parametrize(
    ("depth", "other"),
    [
        ("depth_intrinsics.json", "color_intrinsics.json"),
        ("camera.json", "a_color.json"),
        ("intrinsics_depth.json", "camera.json"),
    ],
)
def test_the_name_tells_which_intrinsics_are_those_of_depth(redwood, depth, other):
    of_depth = redwood / "camera_primesense.json"
    of_colour = of_depth.read_text().replace("14.0", "19.0")
    of_depth.rename(redwood / depth)
    (redwood / other).write_text(of_colour)
    assert next(iter(open_recording(redwood).frames())).depth.camera.fx == 14.0


def test_two_files_of_intrinsics_that_differ_need_names(redwood):
    first = redwood / "camera_primesense.json"
    (redwood / "b.json").write_text(first.read_text())
    assert open_recording(redwood).info.frames == 3
    (redwood / "b.json").write_text(first.read_text().replace("14.0", "19.0"))
    with pytest.raises(RecordingError, match=r"b.json and camera_prime.*depth_intrinsics.json"):
        open_recording(redwood)


def test_replica(replica):
    assert checked(open_recording(replica), "replica", 6553.5, [0.0, 1 / 30], [(0, 0, 0)] * 2)


def test_plain(plain):
    assert checked(open_recording(plain), "plain", 1000, [0.0, 0.1, 0.2], None)


def test_plain_is_opened_by_its_description_file(plain):
    assert checked(open_recording(plain / "recording.toml"), "plain", 1000, [0.0, 0.1, 0.2], None)


def test_plain_with_a_description_in_another_folder(plain, tmp_path):
    shutil.move(plain / "recording.toml", tmp_path / "theirs.toml")
    recording = open_recording(plain, tmp_path / "theirs.toml")
    assert checked(recording, "plain", 1000, [0.0, 0.1, 0.2], None)


def test_plain_without_colour(plain):
    shutil.rmtree(plain / "color")
    assert all(frame.colour is None for frame in open_recording(plain).frames())


def test_plain_with_every_key_of_its_description(plain):
    text = (plain / "recording.toml").read_text().replace("rate_hz = 10.0", 'stamps = "times.txt"')
    text = (
        'name = "hall"\nscene = "a long hall"\n'
        + text
        + (
            '[colour]\nfolder = "color"\n[poses]\nfile = "poses.txt"\nconvention = "world-to-camera"\n'
            "[world]\nup = [0, 3, 3]\nfloor_height = -1.5\n"
        )
    )
    (plain / "recording.toml").write_text(text)
    (plain / "times.txt").write_text("5.0\n5.2\n5.4\n")
    poses = "".join(f"{5.21 + 0.2 * k:.2f} 1 2 {k} 0 0 1 0\n" for k in range(2))
    (plain / "poses.txt").write_text(poses)  # half a turn about z, from world to camera
    recording = open_recording(plain)
    frames = list(recording.frames())
    assert [frame.stamp_s for frame in frames] == [5.0, 5.2, 5.4]
    assert frames[0].T_world_camera is None
    np.testing.assert_allclose(frames[1].T_world_camera.position, (1, 2, 0), atol=1e-12)
    np.testing.assert_allclose(frames[2].T_world_camera.position, (1, 2, -1), atol=1e-12)
    info = recording.info
    assert (info.name, info.scene, info.floor_height_world_m) == ("hall", "a long hall", -1.5)
    assert info.gravity_up_world == pytest.approx(UP_45)
    assert "1 of 3 depth images have no pose" in recording.remarks[0]


def test_plain_with_stamps_in_the_names_pairs_colour_by_time(plain):
    for i in range(3):
        shutil.move(plain / f"depth/{i}.png", plain / f"depth/{10 + i}.0000.png")
        shutil.move(plain / f"color/{i}.png", plain / f"color/{10 + i}.0150.png")
    toml = plain / "recording.toml"
    toml.write_text(toml.read_text().replace("rate_hz = 10.0", 'stamps = "name"'))
    assert checked(open_recording(plain), "plain", 1000, [10.0, 11.0, 12.0], None)


def test_a_superscript_in_a_name_is_no_number(plain):
    (plain / "depth/0.png").rename(plain / "depth/1²0.png")
    (plain / "color/0.png").rename(plain / "color/1²0.png")
    assert len(list(open_recording(plain).frames())) == 3


def test_images_are_sorted_by_number(plain):
    for i, number in enumerate((8, 9, 10)):
        for folder in ("depth", "color"):
            shutil.move(plain / f"{folder}/{i}.png", plain / f"{folder}/x{number}.png")
    assert checked(open_recording(plain), "plain", 1000, [0.0, 0.1, 0.2], None)


def test_a_description_completes_a_known_layout(redwood, tmp_path):
    description = tmp_path / "more.toml"
    description.write_text('name = "lab"\n[world]\nup = [0, 1, 1]\nfloor_height = 0.13\n')
    info = open_recording(redwood, description).info
    assert (info.kind, info.name, info.floor_height_world_m) == ("redwood", "lab", 0.13)
    assert info.gravity_up_world == pytest.approx(UP_45)


def test_only_rendered_depth_or_a_description_makes_a_camera_calibrated(
    plain, replica, redwood, tum, tmp_path
):
    assert open_recording(replica).info.calibrated
    assert not any(open_recording(path).info.calibrated for path in (plain, redwood, tum))
    beside = tmp_path / "recording.toml"
    beside.write_text("calibrated = true\n")
    assert open_recording(redwood, beside).info.calibrated
    own = plain / "recording.toml"
    own.write_text("calibrated = true\n" + own.read_text())
    assert open_recording(plain).info.calibrated


@pytest.mark.parametrize("data", ["ascii", "binary", "binary_compressed"])
def test_an_organised_cloud_is_read_as_its_depth_image(pcd, data):
    recording = open_recording(pcd(data))
    (frame,) = recording.frames()
    camera = frame.depth.camera
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == pytest.approx(
        (14, 13, 7.5, 5.5), abs=1e-4
    )
    u = np.arange(16)
    expected = np.tile(1 / (1 - (u - 7.5) / 28), (12, 1))
    expected[0, 5] = np.nan
    np.testing.assert_allclose(frame.depth.depth, expected, rtol=1e-6)
    assert recording.info.frames == 1


def test_frames_are_read_a_few_at_a_time(plain):
    """Damage to a file further on than is read ahead is noticed."""
    last = AHEAD + 2
    for i in range(3, last + 1):
        for folder in ("depth", "color"):
            shutil.copy(plain / folder / "0.png", plain / folder / f"{i}.png")
    frames = open_recording(plain).frames()
    assert next(frames).stamp_s == 0.0
    (plain / f"depth/{last}.png").write_bytes(b"")
    assert len(list(frames)) == last - 1


def test_every_recording_plays_twice_with_the_same_frames(tum, same):
    recording = open_recording(tum)
    assert all(map(same, recording.frames(), recording.frames()))


def test_every_reader_is_a_recording(tum, seven_scenes, redwood, replica, plain, pcd):
    for path in (tum, seven_scenes, redwood, replica, plain, pcd("binary")):
        assert isinstance(open_recording(path), Recording)
