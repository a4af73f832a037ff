"""Bad input: the recording is refused with advice, or the frame is skipped and counted."""

import os
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


def test_the_error_of_a_missing_folder_suggests_a_similar_name(tum):
    with pytest.raises(
        RecordingError, match=r"fr3_smal: no such file or folder \(did you mean .*fr3_small\?\)"
    ):
        open_recording(tum.parent / "fr3_smal")


def test_the_error_of_an_empty_folder_lists_the_formats(tmp_path):
    with pytest.raises(
        RecordingError, match=r"no frames found \(it contains nothing\); expected a run folder"
    ):
        open_recording(tmp_path)


def test_the_error_of_an_unknown_folder_lists_its_content(tmp_path):
    (tmp_path / "notes.txt").write_text("hello")
    with pytest.raises(RecordingError, match=r"no frames found \(it contains notes.txt\)"):
        open_recording(tmp_path)


def test_a_file_in_place_of_a_folder_is_refused(tum):
    with pytest.raises(RecordingError, match=r"a file of kind '.txt' is not read; give its folder"):
        open_recording(tum / "groundtruth.txt")


def test_the_error_of_a_parent_folder_names_its_recordings(seven_scenes):
    with pytest.raises(
        RecordingError,
        match="contains no frames itself, but these folders in it can be read: seq-01",
    ):
        open_recording(seven_scenes.parent)


def test_the_error_of_a_run_without_recording_names_the_option(tmp_path):
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


def test_the_description_in_the_error_works_when_copied(plain):
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
    "truncated": (_truncate, "depth image is truncated"),
    "text": (lambda p: p.write_text("not an image"), "depth image cannot be decoded"),
    "scrambled": (
        lambda p: p.write_bytes(p.read_bytes()[:30] + b"\0" * 40 + p.read_bytes()[70:]),
        "depth image cannot be decoded",
    ),
    "8 bit": (
        lambda p: _write(p, np.full((12, 16), 100, np.uint8)),
        "depth image has 1 channel of uint8; one channel of uint16, float32 or float64 was expected "
        "(an 8-bit picture has no depth)",
    ),
    "coloured": (
        lambda p: _write(p, np.full((12, 16, 3), 100, np.uint16)),
        "depth image has 3 channels of uint16; one channel of uint16, float32 or float64 was expected "
        "(save depth as PNG of 16 bits, "
        "in millimetres, 0 without depth; or as TIFF or .npy of float32, in metres, with scale_per_metre = 1)",
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


NO_FILES = {
    "pipe": (os.mkfifo, "depth image is not a file"),
    "folder": (lambda p: p.mkdir(), "depth image is not a file"),
    "device": (lambda p: p.symlink_to("/dev/zero"), "depth image is not a file"),
    "link to nothing": (lambda p: p.symlink_to("nowhere.png"), "depth image is missing"),
    "link to itself": (lambda p: p.symlink_to(p.name), "depth image cannot be read"),
}


@pytest.mark.parametrize("kind", NO_FILES)
def test_what_stands_for_a_depth_image_and_is_no_file_is_counted(plain, kind):
    make, reason = NO_FILES[kind]
    (plain / "depth/1.png").unlink()
    make(plain / "depth/1.png")
    recording = open_recording(plain)
    assert [frame.stamp_s for frame in recording.frames()] == [0.0, 0.2]
    assert [one.name for one in recording.skipped] == ["1.png"]
    assert recording.skipped[0].reason.startswith(reason)


@pytest.mark.parametrize("damage", DAMAGE)
def test_a_bad_depth_image_skips_its_frame(plain, damage):
    spoil, reason = DAMAGE[damage]
    recording = open_recording(plain)
    spoil(plain / "depth/1.png")
    assert [frame.stamp_s for frame in recording.frames()] == [0.0, 0.2]
    assert recording.skipped == [("1.png", reason)]


@pytest.mark.parametrize("damage", ["empty", "truncated", "text"])
def test_a_bad_colour_image_costs_the_colour_of_its_frame_alone(plain, damage):
    spoil, reason = DAMAGE[damage]
    spoil(plain / "color/2.png")
    recording = open_recording(plain)
    frames = list(recording.frames())
    assert [frame.colour is not None for frame in frames] == [True, True, False]
    assert all(frame.depth is not None for frame in frames)
    assert recording.skipped == []
    fault = f"1 colour images cannot be used, their depth is (first: 2.png, {reason})"
    assert recording.remarks[-1] == fault.replace("depth image", "colour image")


def test_a_colour_image_of_another_size_costs_the_colour_of_its_frame_alone(plain):
    _write(plain / "color/0.png", np.zeros((24, 32, 3), np.uint8))
    recording = open_recording(plain)
    assert [frame.colour is not None for frame in recording.frames()] == [False, True, True]
    assert "colour image is 32x24 px; 16x12 px was expected" in recording.remarks[-1]


def test_a_truncated_jpeg_costs_the_colour_of_its_frame_alone(plain):
    noise = np.random.default_rng(0).integers(0, 256, (12, 16, 3), dtype=np.uint8)
    (plain / "color/0.png").unlink()
    _write(plain / "color/0.jpg", noise)
    _truncate(plain / "color/0.jpg")
    recording = open_recording(plain)
    assert [frame.colour is not None for frame in recording.frames()] == [False, True, True]
    assert "(first: 0.jpg, colour image is truncated)" in recording.remarks[-1]


def test_a_recording_without_a_usable_frame_is_refused_with_the_first_reason(plain):
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


def test_a_frame_without_its_colour_image_keeps_its_depth(redwood):
    (redwood / "color/00001.png").unlink()
    recording = open_recording(redwood)
    assert [frame.colour is not None for frame in recording.frames()] == [True, False, True]
    assert recording.remarks == ["1 of 3 images have no colour image (first 00001.png)"]


def test_colour_images_that_match_no_depth_image_are_left_out_with_a_remark(redwood):
    (redwood / "color/00001.png").unlink()
    for name in ("00000.png", "00002.png"):
        (redwood / "color" / name).rename(redwood / "color" / f"9{name}")
    recording = open_recording(redwood)
    assert [frame.colour for frame in recording.frames()] == [None] * 3
    assert recording.remarks[0].startswith("3 images but 2 colour images, and their names do not")


def test_poses_and_times_are_found_by_the_number_of_an_image_if_images_are_missing(redwood):
    (redwood / "depth/00001.png").unlink()
    frames = list(open_recording(redwood).frames())
    assert [f.T_world_camera.translation[0] for f in frames if f.T_world_camera] == [0.0, 2.0]
    assert [f.stamp_s for f in frames] == pytest.approx([0.0, 2.0 / 30.0])


@pytest.mark.parametrize(
    ("names", "stamps"),
    [
        (("0000001-000000000000", "0000002-000000033369", "0000004-000000100107"), (0, 0.033369, 0.100107)),
        (("1341841278.8427", "1341841278.8761", "1341841278.9428"), (0, 0.0334, 0.1001)),
        (("1700000000123", "1700000000156", "1700000000223"), (0, 1 / 30, 2 / 30)),  # unit not told
        (("7-3", "8-2", "9-1"), (0, 1 / 30, 2 / 30)),
    ],
)  # fmt: skip
def test_times_follow_from_the_names_of_images_or_from_their_order(redwood, names, stamps):
    for i, name in enumerate(names):
        (redwood / f"depth/{i:05d}.png").rename(redwood / f"depth/{name}.png")
    found = [frame.stamp_s for frame in open_recording(redwood).frames()]
    assert [one - found[0] for one in found] == pytest.approx(stamps, abs=1e-6)


@pytest.mark.parametrize(
    ("scale", "word"), [(10, "farther"), (1, r"farther than \d{4}"), (100_000, "nearer")]
)
def test_an_implausible_depth_is_asked_about(plain, scale, word):
    text = (plain / "recording.toml").read_text()
    assert "scale_per_metre = 1000" in text
    text = text.replace("scale_per_metre = 1000", f"scale_per_metre = {scale}")
    (plain / "recording.toml").write_text(text)
    with pytest.raises(
        RecordingError, match=rf"half of the first depth image is {word} .* at {scale:g}"
    ):
        play(plain)
    (plain / "recording.toml").write_text("scale_checked = true\n" + text)
    assert len(play(plain)) == 3


def test_a_thinned_tum_folder_may_number_its_images_from_any_number(tum):
    stamps = [frame.stamp_s for frame in open_recording(tum).frames()]
    for kind in ("depth", "rgb"):
        for file in sorted((tum / kind).iterdir(), reverse=True):
            file.rename(file.with_name(f"{int(file.stem) + 1:04d}{file.suffix}"))
    assert [frame.stamp_s for frame in open_recording(tum).frames()] == stamps


def test_a_redwood_log_with_too_few_poses_is_refused(redwood):
    log = redwood / "trajectory.log"
    log.write_text("\n".join(log.read_text().splitlines()[:10]))
    with pytest.raises(
        RecordingError, match=r"trajectory.log: 2 poses for 3 images, none for 00002.png"
    ):
        open_recording(redwood)


def test_a_truncated_redwood_log_is_refused(redwood):
    log = redwood / "trajectory.log"
    log.write_text("\n".join(log.read_text().splitlines()[:13]))
    with pytest.raises(RecordingError, match=r"13 lines are not a multiple of 5 .* truncated"):
        open_recording(redwood)


def test_a_thinned_tum_folder_with_too_few_poses_is_refused(tum):
    lines = (tum / "groundtruth.txt").read_text().splitlines()
    (tum / "groundtruth.txt").write_text("\n".join(lines[:4]))
    with pytest.raises(
        RecordingError, match=r"groundtruth.txt: 3 poses for 4 images, none for 0003.png"
    ):
        open_recording(tum)


def test_a_replica_frame_without_a_pose_is_refused(replica):
    np.savetxt(replica / "traj.txt", np.eye(4).reshape(1, 16))
    with pytest.raises(
        RecordingError, match=r"traj.txt: 1 poses for 2 images, none for depth000001"
    ):
        open_recording(replica)


# Poses


@pytest.mark.parametrize(
    ("row", "reason"),
    [
        ("nan 2.0 3.0 0.0 0.0 0.6 0.8", "pose has a value that is not finite"),
        ("1.0 2.0 3.0 0.0 0.0 inf 0.8", "pose has a value that is not finite"),
        (
            "1.0 2.0 3.0 0.0 0.0 0.0 0.0",
            "pose is invalid: its quaternion has length 0.00, not 1",
        ),
        (
            "1.0 2.0 3.0 0.0 0.0 0.6 1.8",
            "pose is invalid: its quaternion has length 1.90, not 1",
        ),
    ],
)
def test_an_invalid_tum_pose_skips_its_frame(tum, row, reason):
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
        (_with((0, 3), np.nan), "pose has a value that is not finite"),
        (_with((0, 0), 2.0), "pose is invalid: R R^T differs from 1 by 3.00"),
        (_with((0, 0), -1.0), "pose is invalid: its determinant is -1 (a reflection)"),
        (_with((3, 0), 0.5), "pose is invalid: its last row is not 0 0 0 1"),
        (np.eye(3), "pose file has no 4x4 matrix"),
    ],
)
def test_an_invalid_pose_matrix_skips_its_frame(seven_scenes, pose, reason):
    np.savetxt(seven_scenes / "frame-000004.pose.txt", pose)
    recording = open_recording(seven_scenes)
    assert len(list(recording.frames())) == 2
    assert recording.skipped == [("frame-000004", reason)]


def test_a_word_in_a_trajectory_is_refused_with_its_line(tum):
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
    with pytest.raises(RecordingError, match=r"groundtruth.txt: has no lines of data"):
        open_recording(tum)


def test_a_binary_trajectory_is_refused(tum):
    (tum / "groundtruth.txt").write_bytes(b"\xff\xfe\x00\x80")
    with pytest.raises(RecordingError, match=r"groundtruth.txt: is not text in UTF-8"):
        open_recording(tum)


# Stamps


@pytest.mark.parametrize(
    ("stamp", "reason"),
    [
        ("10.0000", "the stamp equals that of the frame before"),
        ("9.0000", "the stamp is earlier than that of the frame before"),
        ("nan", "the stamp is not a number"),
        ("-1.0000", "the stamp is negative; 0 or more was expected"),
        ("1.7e18", "the stamp is beyond the year 2499; s were expected, not ms or ns"),
        ("1e300", "the stamp is beyond the year 2499; s were expected, not ms or ns"),
        ("31500010.5", "the stamp is later than those of the frames after"),
    ],
)
def test_a_stamp_out_of_order_skips_its_frame(tum, stamp, reason):
    edit(tum / "groundtruth.txt", "10.5000 10.5000", f"{stamp} 10.5000")
    recording = open_recording(tum)
    assert [frame.stamp_s for frame in recording.frames()] == [10.0, 11.0, 11.5]
    assert recording.skipped == [("0001.png", reason)]


@pytest.mark.parametrize(
    ("stamps", "words"),
    [
        ("1.7e18 1.7e18 1.7e18", r"no frame can be used \(3 skipped; 0.png: .*, not ms or ns"),
        ("0.3 0.2 0.1", r"1 of 3 frames can be used, .*\(2 skipped; 0.png: .*correct the stamps"),
        ("0.3 0.3 0.3", r"1 of 3 frames can be used, .*the stamp equals that of the frame before"),
        ("-2 -1 0.1", r"1 of 3 frames can be used, .*the stamp is negative"),
    ],
)
def test_a_recording_that_its_stamps_cost_most_frames_is_refused(plain, stamps, words):
    edit(plain / "recording.toml", "rate_hz = 10.0", 'stamps = "stamps.txt"')
    (plain / "stamps.txt").write_text(stamps.replace(" ", "\n"))
    with pytest.raises(RecordingError, match=words):
        play(plain)


@pytest.mark.parametrize(
    ("stamps", "words"),
    [
        (
            "0.1 0.2 1700000000.3",
            r"stamps jump from 0.2 to 1700000000 s, after 2 frames; .*was set",
        ),
        ("0 33e6 66e6", r"frames are 3.3e\+07 s apart .*were expected.*may be in ns"),
        ("0 33e3 66e3", r"frames are 3.3e\+04 s apart .*were expected.*may be in us"),
        ("0 5e-5 1e-4", r"frames are 5e-05 s apart .*a unit 1000 times as long"),
        ("0 1e-9 2e-9", r"frames are 1e-09 s apart .*may be numbers of frames"),
    ],
)
def test_intervals_that_no_recording_has_are_refused(plain, stamps, words):
    edit(plain / "recording.toml", "rate_hz = 10.0", 'stamps = "stamps.txt"')
    (plain / "stamps.txt").write_text(stamps.replace(" ", "\n"))
    with pytest.raises(RecordingError, match=words):
        play(plain)


def test_a_rate_that_no_camera_has_is_refused(plain):
    edit(plain / "recording.toml", "rate_hz = 10.0", "rate_hz = 1e300")
    with pytest.raises(RecordingError, match="frames are 1e-300 s apart"):
        play(plain)


def test_a_stamp_too_early_does_not_cost_the_frame_before(plain):
    edit(plain / "recording.toml", "rate_hz = 10.0", 'stamps = "stamps.txt"')
    (plain / "stamps.txt").write_text("5.0\n0.0\n5.1")
    assert [frame.stamp_s for frame in play(plain)] == [5.0, 5.1]


def test_an_invalid_list_is_refused(tum_listed):
    edit(tum_listed / "depth.txt", "1.5 depth/1.5000.png", "depth/1.5000.png")
    with pytest.raises(
        RecordingError, match=r"depth.txt, line 3: .*; expected: timestamp filename"
    ):
        open_recording(tum_listed)


def test_a_missing_listed_image_skips_its_frame(tum_listed):
    (tum_listed / "depth/1.5000.png").unlink()
    recording = open_recording(tum_listed)
    assert len(list(recording.frames())) == 3
    assert recording.skipped == [("1.5000.png", "depth image is missing")]


@pytest.mark.parametrize("described", [True, False])
@pytest.mark.parametrize("suffix", [".exr", ".pfm"])
def test_kinds_of_depth_images_that_are_not_read_are_named(plain, suffix, described):
    for image in [*(plain / "depth").iterdir(), *(plain / "color").iterdir()]:
        image.rename(image.with_suffix(suffix))
    if not described:
        (plain / "recording.toml").unlink()
    words = (
        rf"0\{suffix}: depth images of kind \{suffix} are not read; save depth as PNG of 16 bits"
    )
    with pytest.raises(RecordingError, match=words):
        open_recording(plain)
