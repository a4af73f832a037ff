"""Bad input: the recording is refused in words that help, or the frame is skipped and counted."""

import shutil

import cv2
import numpy as np
import pytest

from perception.primitives.errors import RecordingError
from surefoot.recordings.open import open_recording


def play(path, description=None):
    return list(open_recording(path, description).frames())


def edit(path, old, new):
    text = path.read_text()
    assert old in text, f"{old!r} is not in {path}"
    path.write_text(text.replace(old, new))


# The place


def test_a_missing_folder_names_its_nearest_neighbour(tum):
    with pytest.raises(
        RecordingError, match=r"fr3_smal: no such file or folder \(did you mean .*fr3_small\?\)"
    ):
        open_recording(tum.parent / "fr3_smal")


def test_an_empty_folder_says_what_was_expected(tmp_path):
    with pytest.raises(
        RecordingError, match=r"no frames found \(it holds nothing\); expected a run folder"
    ):
        open_recording(tmp_path)


def test_a_folder_of_other_things_says_what_it_holds(tmp_path):
    (tmp_path / "notes.txt").write_text("hello")
    with pytest.raises(RecordingError, match=r"no frames found \(it holds notes.txt\)"):
        open_recording(tmp_path)


def test_a_file_where_a_folder_is_wanted(tum):
    with pytest.raises(
        RecordingError, match=r"a file of kind '.txt' is not read; give the folder it lies in"
    ):
        open_recording(tum / "groundtruth.txt")


def test_a_folder_above_the_recordings_names_them(seven_scenes):
    with pytest.raises(
        RecordingError, match="holds no frames itself, but seq-01 in it can be read"
    ):
        open_recording(seven_scenes.parent)


def test_a_run_that_was_not_recorded_says_how_to(tmp_path):
    for name in ("config.toml", "metrics.json"):
        (tmp_path / name).write_text("")
    with pytest.raises(
        RecordingError, match=r"this run was not recorded .*run `surefoot simulate --record`"
    ):
        open_recording(tmp_path)


def test_a_folder_named_like_a_file_is_opened_as_a_folder(tmp_path):
    (tmp_path / "walk.mcap").mkdir()
    with pytest.raises(RecordingError, match=r"walk.mcap: no frames found"):
        open_recording(tmp_path / "walk.mcap")


def test_images_without_a_description_show_one_that_works_once_copied(plain):
    (plain / "recording.toml").unlink()
    with pytest.raises(
        RecordingError, match=r"3 images \(first 0.png\) but no recording.toml"
    ) as caught:
        open_recording(plain)
    shown = str(caught.value)
    example = shown[shown.index("rate_hz") :]
    example = example[: example.index("[poses]")]
    for key, value in {"width": 16, "height": 12, "cx": 7.5, "cy": 5.5}.items():
        example = "\n".join(
            f"{key} = {value}" if line.startswith(f"{key} =") else line
            for line in example.splitlines()
        )
    (plain / "recording.toml").write_text(example)
    assert len(play(plain)) == 3


def test_a_description_for_a_single_file_is_refused(pcd, plain):
    with pytest.raises(RecordingError, match="a single file needs no description"):
        open_recording(pcd("ascii"), plain / "recording.toml")


# Images: the frame is skipped


def _write(path, image):
    assert cv2.imwrite(str(path), image)


def _truncate(path):
    path.write_bytes(path.read_bytes()[:-10])


DAMAGE = {
    "gone": (lambda p: p.unlink(), "depth image is missing"),
    "empty": (lambda p: p.write_bytes(b""), "depth image is an empty file"),
    "truncated": (_truncate, "depth image is cut short"),
    "text": (lambda p: p.write_text("not an image"), "depth image is not readable as a picture"),
    "scrambled": (
        lambda p: p.write_bytes(p.read_bytes()[:30] + b"\0" * 40 + p.read_bytes()[70:]),
        "depth image is not readable as a picture",
    ),
    "8 bit": (
        lambda p: _write(p, np.full((12, 16), 100, np.uint8)),
        "depth image has 1 channel of uint8; one channel of uint16 was expected "
        "(a picture for looking at holds no depth)",
    ),
    "coloured": (
        lambda p: _write(p, np.full((12, 16, 3), 100, np.uint16)),
        "depth image has 3 channels of uint16; one channel of uint16 was expected "
        "(a picture for looking at holds no depth)",
    ),
    "of another size": (
        lambda p: _write(p, np.full((6, 8), 1000, np.uint16)),
        "depth image is 8x6 px; 16x12 px was expected from the intrinsics",
    ),
    "without depth": (
        lambda p: _write(p, np.full((12, 16), 65535, np.uint16)),
        "depth image has no valid pixel: every value is 0 or 65535",
    ),
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_a_bad_depth_image_skips_its_frame(plain, damage):
    spoil, reason = DAMAGE[damage]
    recording = open_recording(plain)
    spoil(plain / "depth/1.png")
    assert [frame.stamp_s for frame in recording.frames()] == [0.0, 0.2]
    assert recording.skipped == [("1.png", reason)]


@pytest.mark.parametrize("damage", ["empty", "truncated", "text"])
def test_a_bad_colour_image_skips_its_frame(plain, damage):
    spoil, reason = DAMAGE[damage]
    spoil(plain / "color/2.png")
    recording = open_recording(plain)
    assert [frame.stamp_s for frame in recording.frames()] == [0.0, 0.1]
    assert recording.skipped == [("2.png", reason.replace("depth", "colour"))]


def test_a_colour_image_of_another_size_skips_its_frame(plain):
    _write(plain / "color/0.png", np.zeros((24, 32, 3), np.uint8))
    recording = open_recording(plain)
    assert len(list(recording.frames())) == 2
    assert recording.skipped[0].reason.startswith("colour image is 32x24 px; 16x12 px was expected")


def test_a_truncated_jpeg_is_no_colour_image(plain):
    noise = np.random.default_rng(0).integers(0, 256, (12, 16, 3), dtype=np.uint8)
    (plain / "color/0.png").unlink()
    _write(plain / "color/0.jpg", noise)
    _truncate(plain / "color/0.jpg")
    recording = open_recording(plain)
    assert len(list(recording.frames())) == 2
    assert recording.skipped == [("0.png", "colour image is cut short")]


def test_a_recording_with_no_good_frame_is_refused_with_the_first_reason(plain):
    for path in (plain / "depth").iterdir():
        _write(path, np.zeros((12, 16), np.uint16))
    with pytest.raises(
        RecordingError,
        match=r"mine: no frame can be used \(3 skipped; 0.png: depth image has no valid pixel",
    ):
        play(plain)


def test_an_empty_depth_folder_is_refused(redwood):
    shutil.rmtree(redwood / "depth")
    (redwood / "depth").mkdir()
    (redwood / "trajectory.log").unlink()
    shutil.rmtree(redwood / "color")
    with pytest.raises(RecordingError, match="room: no depth image found; at least one frame"):
        open_recording(redwood)


# Pairs and counts


def test_a_lost_colour_image_is_named(redwood):
    (redwood / "color/00001.jpg").unlink(missing_ok=True)
    (redwood / "color/00001.png").unlink()
    with pytest.raises(
        RecordingError, match=r"3 depth images but 2 colour images \(00001.png has no partner\)"
    ):
        open_recording(redwood)


def test_a_lost_depth_image_is_told(redwood):
    (redwood / "depth/00002.png").unlink()
    with pytest.raises(RecordingError, match=r"2 depth images but 3 colour images \(some colour"):
        open_recording(redwood)


def test_too_few_poses_in_a_redwood_log(redwood):
    log = redwood / "trajectory.log"
    log.write_text("\n".join(log.read_text().splitlines()[:10]))
    with pytest.raises(RecordingError, match=r"3 depth images but 2 poses in trajectory.log"):
        open_recording(redwood)


def test_a_redwood_log_cut_inside_a_pose(redwood):
    log = redwood / "trajectory.log"
    log.write_text("\n".join(log.read_text().splitlines()[:13]))
    with pytest.raises(RecordingError, match=r"13 lines are no whole poses of 5 .* cut short"):
        open_recording(redwood)


def test_too_few_poses_for_a_thinned_tum_folder(tum):
    lines = (tum / "groundtruth.txt").read_text().splitlines()
    (tum / "groundtruth.txt").write_text("\n".join(lines[:4]))
    with pytest.raises(
        RecordingError, match=r"4 depth images but 3 poses in groundtruth.txt \(none for 0003.png\)"
    ):
        open_recording(tum)


def test_a_replica_frame_without_a_pose(replica):
    np.savetxt(replica / "traj.txt", np.eye(4).reshape(1, 16))
    with pytest.raises(RecordingError, match=r"depth000001.png has no pose; traj.txt has 1 lines"):
        open_recording(replica)


# Poses


@pytest.mark.parametrize(
    ("row", "reason"),
    [
        ("nan 2.0 3.0 0.0 0.0 0.6 0.8", "pose holds a value that is not finite"),
        ("1.0 2.0 3.0 0.0 0.0 inf 0.8", "pose holds a value that is not finite"),
        (
            "1.0 2.0 3.0 0.0 0.0 0.0 0.0",
            "pose is no rotation: its quaternion has length 0.00, not 1",
        ),
        (
            "1.0 2.0 3.0 0.0 0.0 0.6 1.8",
            "pose is no rotation: its quaternion has length 1.90, not 1",
        ),
    ],
)
def test_a_tum_pose_that_is_none_skips_its_frame(tum, row, reason):
    edit(tum / "groundtruth.txt", "10.5000 2.0 3.0 0.0 0.0 0.6 0.8", row)
    recording = open_recording(tum)
    assert [frame.stamp_s for frame in recording.frames()] == [10.0, 11.0, 11.5]
    assert recording.skipped == [("0001.png", reason)]


def _with(index, value):
    pose = np.eye(4)
    pose[index] = value
    return pose


@pytest.mark.parametrize(
    ("pose", "reason"),
    [
        (_with((0, 3), np.nan), "pose holds a value that is not finite"),
        (_with((0, 0), 2.0), "pose is no rotation: R R^T differs from 1 by 3.00"),
        (_with((0, 0), -1.0), "pose is no rotation: it mirrors (determinant -1)"),
        (_with((3, 0), 0.5), "pose is no rigid motion: its last row is not 0 0 0 1"),
        (np.eye(3), "pose file does not hold a 4x4 matrix"),
    ],
)
def test_a_matrix_that_is_no_pose_skips_its_frame(seven_scenes, pose, reason):
    np.savetxt(seven_scenes / "frame-000004.pose.txt", pose)
    recording = open_recording(seven_scenes)
    assert len(list(recording.frames())) == 2
    assert recording.skipped == [("frame-000004", reason)]


def test_a_word_in_a_trajectory_is_named_with_its_line(tum):
    edit(tum / "groundtruth.txt", "10.5000 2.0", "10.5000 two")
    with pytest.raises(RecordingError, match=r"groundtruth.txt, line 3: 'two' is not a number"):
        open_recording(tum)


def test_a_short_line_in_a_trajectory_is_named(tum):
    edit(tum / "groundtruth.txt", "10.5000 2.0 3.0 0.0", "10.5000 2.0 3.0")
    with pytest.raises(
        RecordingError, match=r"groundtruth.txt, line 3: 7 numbers, expected 8: timestamp tx ty tz"
    ):
        open_recording(tum)


@pytest.mark.parametrize("content", [b"", b"# only a comment\n"])
def test_an_empty_trajectory_is_refused(tum, content):
    (tum / "groundtruth.txt").write_bytes(content)
    with pytest.raises(RecordingError, match=r"groundtruth.txt: holds no line of data"):
        open_recording(tum)


def test_a_trajectory_that_is_no_text_is_refused(tum):
    (tum / "groundtruth.txt").write_bytes(b"\xff\xfe\x00\x80")
    with pytest.raises(RecordingError, match=r"groundtruth.txt: is not text; lines of numbers"):
        open_recording(tum)


# Stamps


@pytest.mark.parametrize(
    ("stamp", "reason"),
    [
        ("10.0000", "its stamp repeats the one of the frame before"),
        ("9.0000", "its stamp lies before the one of the frame before"),
        ("nan", "its stamp is not a number"),
    ],
)
def test_a_stamp_that_does_not_follow_skips_its_frame(tum, stamp, reason):
    edit(tum / "groundtruth.txt", "10.5000 10.5000", f"{stamp} 10.5000")
    recording = open_recording(tum)
    assert [frame.stamp_s for frame in recording.frames()] == [10.0, 11.0, 11.5]
    assert recording.skipped == [("0001.png", reason)]


def test_a_list_that_is_no_list_is_refused(tum_listed):
    edit(tum_listed / "depth.txt", "1.5 depth/1.5000.png", "depth/1.5000.png")
    with pytest.raises(
        RecordingError, match=r"depth.txt, line 3: .*; expected: timestamp filename"
    ):
        open_recording(tum_listed)


def test_a_listed_image_that_is_not_there_skips_its_frame(tum_listed):
    (tum_listed / "depth/1.5000.png").unlink()
    recording = open_recording(tum_listed)
    assert len(list(recording.frames())) == 3
    assert recording.skipped == [("1.5000.png", "depth image is missing")]


# Intrinsics


def test_a_tum_camera_that_nobody_knows(tum, tmp_path):
    (tum / "recording.toml").unlink()
    shutil.move(tum, tmp_path / "mine")
    with pytest.raises(
        RecordingError, match=r"does not say which TUM camera this is .*\n\[camera\]\nwidth = 640"
    ):
        open_recording(tmp_path / "mine")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("fx = 14.0", "fx = 0.0", "recording.toml: camera: fx=0.0 px must be positive and finite"),
        ("fy = 14.0", "fy = -480.0", "camera: fy=-480.0 px must be positive"),
        ("cx = 7.5", "cx = 7500", "camera: cx=7500.0 px lies far outside the image of 16 px"),
        ("width = 16", "width = 0", "camera: image 0x12 px must be at least 1x1"),
        ("width = 16", "width = 16.5", r"camera.width = 16.5 must be whole"),
        ("fx = 14.0", "fx = inf", "camera.fx = inf must be a finite number"),
        ("fx = 14.0", 'fx = "14"', "camera.fx = '14' must be a finite number"),
        ("fx = 14.0\n", "", "camera.fx is missing; a number in px"),
        ("cy = 5.5", "cy = 5.5\ndistortion = [0.1]", r"camera.distortion = \[0.1\] must be a list of 5"),
        ("fx = 14.0", "focal = 14.0", "unknown key camera.focal; known keys: width, height, fx"),
        ("rate_hz", "rate_hertz", r"unknown key rate_hertz; did you mean rate_hz\?"),
        ("[camera]", "[camra]", r"unknown key camra; did you mean camera\?"),
        ("scale_per_metre", "scale_per_meter", r"unknown key depth.scale_per_meter; did you mean scale_per_metre\?"),
        ("scale_per_metre = 1000", "scale_per_metre = 0", r"\[depth\] depth scale 0.0 units per metre must be positive"),
        ("scale_per_metre = 1000\n", "", "depth.scale_per_metre is missing; 1000 for millimetres"),
        ("none = [0, 65535]\n", "", r"depth.none is missing; the values that mean no depth, such as \[0\]"),
        ("none = [0, 65535]", "none = [-1]", "no-depth mark -1 must lie between 0 and 65535"),
        ("none = [0, 65535]", 'none = ["0"]', "depth.none holds '0'; numbers were expected"),
        ("none = [0, 65535]", "none = 0", "depth.none = 0 must be a list of numbers"),
        ("rate_hz = 10.0", "rate_hz = -1", "rate_hz = -1.0 must be positive"),
        ("rate_hz = 10.0\n", "", "rate_hz or stamps is missing; add rate_hz = 30.0"),
        ("rate_hz = 10.0", "rate_hz = 10.0 fps", "recording.toml: is no valid TOML: .*line 1"),
        ("rate_hz = 10.0", 'stamps = "times.txt"', "times.txt: cannot be read: No such file"),
        ("rate_hz = 10.0", "rate_hz = 10.0\ncolour = 3", r"colour = 3 must be a table \[colour\]"),
        ("[depth]", '[depth]\nfolder = "raw"', "raw: no image matches .*; check .depth. folder and pattern"),
        ("[depth]", '[colour]\nfolder = "raw"\n[depth]', r"raw: no image matches .*; check \[colour\]"),
        ("[depth]", '[poses]\nfile = "p.txt"\n[depth]', "p.txt: cannot be read: No such file"),
        ("[depth]", "[poses]\n[depth]", r"\[poses\] needs file = a text file of TUM lines"),
        ("[depth]", '[poses]\nfile = "p"\nconvention = "c2w"\n[depth]', "convention = 'c2w'; expected one of camera-to-world"),
        ("[depth]", "[world]\nup = [0, 0, 0]\n[depth]", r"world.up = \[0.0, 0.0, 0.0\] is no direction"),
    ],
)  # fmt: skip
def test_a_description_that_cannot_be_is_refused_by_key_and_value(plain, old, new, message):
    edit(plain / "recording.toml", old, new)
    with pytest.raises(RecordingError, match=message):
        open_recording(plain)


def test_a_description_without_a_camera_is_refused(plain):
    toml = plain / "recording.toml"
    toml.write_text("rate_hz = 10\n" + toml.read_text()[toml.read_text().index("[depth]") :])
    with pytest.raises(RecordingError, match=r"table \[camera\] is missing; for example"):
        open_recording(plain)


def test_a_description_that_is_not_there(plain, tmp_path):
    with pytest.raises(RecordingError, match=r"nowhere.toml: cannot be read: No such file"):
        open_recording(plain, tmp_path / "nowhere.toml")


def test_a_description_cannot_say_what_the_layout_settles(redwood):
    (redwood / "recording.toml").write_text("rate_hz = 5\n")
    with pytest.raises(RecordingError, match=r"rate_hz is settled by the layout \(redwood\)"):
        open_recording(redwood)


def test_counts_of_stamps_and_poses_are_compared_with_the_images(plain):
    edit(plain / "recording.toml", "rate_hz = 10.0", 'stamps = "times.txt"')
    (plain / "times.txt").write_text("1.0\n2.0\n")
    with pytest.raises(RecordingError, match=r"times.txt: 2 stamps for 3 depth images; one each"):
        open_recording(plain)


def test_names_that_are_no_stamps_are_refused(plain):
    edit(plain / "recording.toml", "rate_hz = 10.0", 'stamps = "name"')
    shutil.move(plain / "depth/1.png", plain / "depth/x1.png")
    with pytest.raises(RecordingError, match=r"stamps = .name., but 'x1' is no time in s"):
        open_recording(plain)


def test_poses_of_another_clock_are_told(plain):
    edit(plain / "recording.toml", "rate_hz = 10.0", 'stamps = "times.txt"')
    edit(plain / "recording.toml", "[depth]", '[poses]\nfile = "p.txt"\n[depth]')
    (plain / "times.txt").write_text("1.0\n2.0\n3.0\n")
    (plain / "p.txt").write_text("1700000000.0 0 0 0 0 0 0 1\n")
    with pytest.raises(RecordingError, match=r"no pose within 0.02 s of any frame: .* one clock"):
        open_recording(plain)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ('{"intrinsic_matrix": [1, 2], "width": 16, "height": 12}', "has 2 numbers, 9 were expected"),
        ('{"intrinsic_matrix": [1, 2]', "cannot be read as Open3D's intrinsics"),
        ('{"intrinsic_matrix": [0,0,0,0,0,0,0,0,0], "width": 16, "height": 12}', "fx=0.0 px must be positive"),
        ('{"intrinsic_matrix": [1,0,0,0,1,0,1,1,1]}', r"cannot be read as Open3D's intrinsics \('width'\)"),
    ],
)  # fmt: skip
def test_intrinsics_of_open3d_that_cannot_be(redwood, content, message):
    (redwood / "camera_primesense.json").write_text(content)
    with pytest.raises(RecordingError, match=f"camera_primesense.json: .*{message}"):
        open_recording(redwood)


def test_replica_parameters_that_cannot_be(replica):
    edit(replica / "cam_params.json", '"scale": 6553.5', '"scale": 0')
    with pytest.raises(RecordingError, match=r"cam_params.json: cannot be read \(depth scale 0.0"):
        open_recording(replica)


def test_seven_scenes_intrinsics_and_gravity_that_cannot_be(seven_scenes):
    np.savetxt(seven_scenes.parent / "gravity-direction.txt", [0.0, 0.0, 0.0])
    with pytest.raises(RecordingError, match=r"gravity-direction.txt: gravity has length 0;"):
        open_recording(seven_scenes)
    np.savetxt(seven_scenes.parent / "camera-intrinsics.txt", np.zeros((3, 3)))
    with pytest.raises(RecordingError, match=r"camera-intrinsics.txt: camera: fx=0.0 px"):
        open_recording(seven_scenes)
    np.savetxt(seven_scenes.parent / "camera-intrinsics.txt", np.eye(2))
    with pytest.raises(RecordingError, match=r"camera-intrinsics.txt: 2 rows; a 3x3 matrix"):
        open_recording(seven_scenes)


# Clouds


def _replace(old, new):
    return lambda content: content.replace(old, new)


@pytest.mark.parametrize(
    ("data", "spoil", "message"),
    [
        ("binary", lambda c: b"", "the file is empty"),
        ("binary", lambda c: b"ply\n" + b"x" * 9000, "is no PCD file: its header has no line DATA"),
        ("binary", lambda c: c[:-7], "is cut short: 2297 of 2304 bytes of points"),
        ("binary_compressed", lambda c: c[:-7], "is cut short: .* bytes of points"),
        ("binary_compressed", lambda c: c[:-7] + b"\xff" * 7, "its packed points are damaged"),
        ("binary_compressed", _replace(b"WIDTH 16", b"WIDTH 15"), "unpacks to 2304 bytes; 180 points of 12"),
        ("ascii", lambda c: c[: c.rindex(b"\n", 0, -1)], "is cut short: 191 of 192 points"),
        ("ascii", lambda c: c[:-4] + b"abc\n", "a point cannot be parsed"),
        ("binary", _replace(b"WIDTH 16\nHEIGHT 12", b"WIDTH 192\nHEIGHT 1"), "192x1 is not organised"),
        ("binary", _replace(b"WIDTH 16\nHEIGHT 12", b"WIDTH 12\nHEIGHT 16"), "no pinhole camera explains"),
        ("binary", _replace(b"WIDTH 16", b"WIDTH many"), "WIDTH many in its header is no count"),
        ("binary", _replace(b"FIELDS x y z", b"FIELDS x y w"), "has no field z; x, y and z"),
        ("binary", _replace(b"SIZE 4 4 4", b"SIZE 4 4"), "FIELDS, SIZE, TYPE and COUNT do not agree"),
        ("binary", _replace(b"DATA binary", b"DATA zip"), "DATA 'zip'; ascii, binary or"),
        ("binary", _replace(b"TYPE F F F\n", b""), "its header has no line TYPE"),
        ("binary", lambda c: c[:-2304] + b"\xff" * 2304, "0 points ahead of the camera; at least 100"),
    ],
)  # fmt: skip
def test_a_cloud_that_is_no_depth_image_is_refused(pcd, data, spoil, message):
    path = pcd(data)
    path.write_bytes(spoil(path.read_bytes()))
    with pytest.raises(RecordingError, match=message):
        open_recording(path)
