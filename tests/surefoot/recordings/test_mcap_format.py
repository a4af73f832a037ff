"""Our recordings: without loss, readable by other tools, and complete up to a truncation."""

import dataclasses
import io
import itertools
import json
import math
import os
import shutil
import tracemalloc
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from google.protobuf.timestamp_pb2 import Timestamp
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_protobuf.decoder import DecoderFactory

from perception.primitives.errors import InputError, OutputError, RecordingError
from perception.primitives.frame import FeetReading, Frame, StepOdometry
from perception.primitives.kinematics import Joint, KinematicTree
from perception.primitives.landmark import Landmark
from perception.primitives.own_body import JointReading, OwnBody, OwnPart
from perception.primitives.pose import Pose2, Pose3
from surefoot.mcap_file import MAGIC, nanoseconds
from surefoot.recordings.codec import decode, encode
from surefoot.recordings.mcap_format import McapRecording, RecordingWriter
from surefoot.recordings.mcap_messages import (
    frame_messages,
)
from surefoot.recordings.open import open_recording
from surefoot.recordings.own_body_json import own_body_from_json, own_body_to_json
from surefoot.recordings.recording import RecordingInfo
from surefoot.results.moments import moments_of

INFO = RecordingInfo(
    name="walk",
    kind="simulation",
    landmarks=(Landmark(7, (1.25, -2.5, 0.1), 0.12),),
    start=Pose2(0.1, 0.2, 0.3),
    start_covariance=np.diag([1e-4, 2e-4, 3e-4]),
    scene="home",
    gravity_up_world=(0.0, 0.0, 1.0),
    floor_height_world_m=0.0,
)
PARTS = ("tof", "depth", "stereo", "colour", "odometry", "imu", "T_world_camera")


def write(path, frames):
    with RecordingWriter(path, INFO) as writer:
        for frame in frames:
            writer.write(encode(frame))
    return path


@pytest.fixture(scope="module")
def walk(tmp_path_factory, make_frame):
    """A file of six frames, and the frames as they are decoded."""
    frames = [make_frame(i) for i in range(6)]
    path = write(tmp_path_factory.mktemp("walk") / "recording.mcap", frames)
    return path, [decode(encode(frame)) for frame in frames]


def test_a_recording_is_read_back_without_loss(walk, same):
    path, frames = walk
    recording = McapRecording(path)
    played = list(recording.frames())
    assert len(played) == recording.info.frames == len(frames)
    assert all(map(same, played, frames))
    assert recording.skipped == []
    assert recording.remarks == []


def test_a_recording_has_the_name_that_its_folder_or_file_was_given(walk, tmp_path):
    kitchen = tmp_path / "kitchen"
    kitchen.mkdir()
    for name in ("recording.mcap", "monday.mcap"):
        shutil.copy(walk[0], kitchen / name)
    assert open_recording(kitchen).info.name == "kitchen"
    assert open_recording(kitchen / "recording.mcap").info.name == "kitchen"
    assert open_recording(kitchen / "monday.mcap").info.name == "monday"


def test_a_recording_plays_twice_with_the_same_frames(walk, same):
    recording = McapRecording(walk[0])
    assert all(map(same, recording.frames(), recording.frames()))


def test_a_copy_of_a_recording_differs_only_slightly_in_its_colours(walk, same, tmp_path):
    played = list(McapRecording(walk[0]).frames())
    copied = list(McapRecording(write(tmp_path / "copy.mcap", played)).frames())
    for copy, frame in zip(copied, played, strict=True):
        assert same(replace(copy, colour=None), replace(frame, colour=None))
        if frame.colour is not None:
            assert np.abs(copy.colour.rgb.astype(int) - frame.colour.rgb).mean() < 1.0


@pytest.mark.parametrize(
    "absent", [*itertools.combinations(PARTS, 1), *itertools.combinations(PARTS, 6), PARTS]
)
def test_missing_parts_of_a_frame_stay_none(make_frame, same, tmp_path, absent):
    frame = make_frame(1, **dict.fromkeys(absent))
    (played,) = McapRecording(write(tmp_path / "r.mcap", [frame])).frames()
    assert same(played, decode(encode(frame)))
    assert all(getattr(played, part) is None for part in absent)


@given(
    st.floats(0, 2**33),
    st.lists(st.floats(-1e11, 1e11), min_size=4, max_size=4),
)
def test_stamps_and_odometry_are_stored_without_loss(tmp_path_factory, same, stamp_s, values):
    frame = Frame(stamp_s, odometry=StepOdometry(Pose2(*values[:3]), values[3]))
    path = tmp_path_factory.getbasetemp() / "exact.mcap"
    (played,) = McapRecording(write(path, [frame])).frames()
    assert same(played, frame)


OWN = OwnBody(
    KinematicTree(
        (
            Joint("hip", 0, Pose3((0.1, -0.2, 0.3)), (0.6, 0.8, 0.0), -1.25, 2.5),
            Joint(
                "knee", 1, Pose3((0.0, 0.0, 0.0), (0.0, 0.6, 0.0, 0.8)), (0.0, 1.0, 0.0), 0.0, 2.0
            ),
        )
    ),
    (OwnPart("shank 3", 2, np.random.default_rng(0).standard_normal((5, 3)), 0.01, 0.0123),),
)


FEET = FeetReading(Pose2(0.1, 1 / 3, -0.2), Pose2(-0.1, -0.3, 0.7), 0.07, -2 / 3, (True, False))


def test_the_feet_are_stored_without_loss_and_on_several_levels_no_frame_is_used_without(tmp_path):
    path = tmp_path / "feet.mcap"
    with RecordingWriter(path, replace(INFO, levels=True)) as writer:
        writer.write(encode(Frame(1.0, feet=FEET)))
        writer.write(encode(Frame(2.0)))
        writer.write(encode(Frame(3.0, feet=FEET)))
    recording = McapRecording(path)
    assert recording.info.levels
    assert [frame.feet for frame in recording.frames()] == [FEET, FEET]
    (skipped,) = recording.skipped
    assert "no feet" in skipped.reason
    with pytest.raises(InputError, match="feet"):
        encode(Frame(1.0, feet=replace(FEET, left_m=math.inf)))


def test_joint_angles_and_the_robots_own_body_are_stored_without_loss(tmp_path):
    joints = JointReading(Pose3((0.1, 1 / 3, -0.7), (0.0, 0.6, 0.0, 0.8)), (0.1, -1 / 3))
    path = tmp_path / "own.mcap"
    with RecordingWriter(path, replace(INFO, own_body=OWN)) as writer:
        writer.write(encode(Frame(1.0, joints=joints)))
        writer.write(encode(Frame(2.0, joints=replace(joints, angles=(0.1,)))))
        writer.write(encode(Frame(3.0)))
    recording = McapRecording(path)
    first, last = recording.frames()
    assert (first.joints, last.joints) == (joints, None)
    assert [one.reason for one in recording.skipped] == ["1 joint angles; the robot has 2"]
    own = recording.info.own_body
    assert own.tree == OWN.tree
    (part,), (wrote,) = own.parts, OWN.parts
    np.testing.assert_array_equal(part.corners, wrote.corners)
    assert vars(part) | {"corners": 0} == vars(wrote) | {"corners": 0}


@pytest.mark.parametrize(
    "damage",
    [
        {"link": 3},
        {"corners": []},
        {"corners": [[0.0, 1.0]]},
        {"margin_m": float("nan")},
        {"angle_sigma_rad": None},
    ],
)
def test_a_damaged_body_in_a_recording_is_refused(damage):
    values = own_body_to_json(OWN)
    values["parts"][0] |= damage
    with pytest.raises((ValueError, TypeError)):
        own_body_from_json(values)


def test_the_information_about_the_recording_is_read_back(walk):
    info = McapRecording(walk[0]).info
    assert info.kind == "mcap"
    for name in ("name", "landmarks", "start", "scene", "gravity_up_world", "floor_height_world_m"):
        assert getattr(info, name) == getattr(INFO, name)
    np.testing.assert_array_equal(info.start_covariance, INFO.start_covariance)


def test_other_packages_read_it_as_foxglove_messages(walk):
    path, frames = walk
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        messages = [
            (schema.name, channel.topic, message.log_time, decoded)
            for schema, channel, message, decoded in reader.iter_decoded_messages(
                topics=["/tof/range", "/tof/calibration", "/colour/image", "/stereo/left", "/tf"]
            )
        ]
    first = {topic: decoded for _, topic, _, decoded in reversed(messages)}
    kinds = {topic: name for name, topic, _, _ in messages}
    assert kinds == {
        "/tof/range": "foxglove.RawImage",
        "/tof/calibration": "foxglove.CameraCalibration",
        "/colour/image": "foxglove.CompressedImage",
        "/stereo/left": "foxglove.CompressedImage",
        "/tf": "foxglove.FrameTransforms",
    }
    assert {time for _, _, time, _ in messages} == {round(f.stamp_s * 1e9) for f in frames}
    tof = frames[0].tof
    image = first["/tof/range"]
    assert (image.encoding, image.width, image.step) == ("16UC1", 32, 64)
    units = np.frombuffer(image.data, "<u2").reshape(24, 32).astype(float)
    np.testing.assert_allclose(
        np.where(units > 0, units * 5 / 2**14, np.nan), tof.range_m, rtol=1e-6
    )
    np.testing.assert_array_equal(
        np.reshape(first["/tof/calibration"].K, (3, 3)), tof.camera.matrix
    )
    png = np.frombuffer(first["/stereo/left"].data, np.uint8)
    np.testing.assert_array_equal(cv2.imdecode(png, -1), frames[0].stereo.left)
    assert first["/colour/image"].format == "jpeg"
    parents = {(t.parent_frame_id, t.child_frame_id) for t in first["/tf"].transforms}
    assert parents == {
        ("body", "tof_camera"),
        ("body", "stereo_camera"),
        ("body", "colour_camera"),
        ("world", "depth_camera"),
    }


def test_json_topics_carry_their_schemas_and_the_units(walk):
    with walk[0].open("rb") as file:
        messages = {c.topic: (s, m) for s, c, m in make_reader(file).iter_messages()}
    for topic in ("/frame", "/odometry", "/imu", "/recording"):
        schema, message = messages[topic]
        values = json.loads(message.data)
        assert schema.encoding == "jsonschema"
        assert set(json.loads(schema.data)["properties"]) <= set(values)
    units = json.loads(messages["/frame"][1].data)["units"]
    assert units["/tof/range"] == 2**14 / 5
    assert units["/depth/image"] == 5000.0


def test_a_truncated_file_gives_every_complete_frame(walk, same, tmp_path):
    """The file is truncated at, before and after the end of each chunk, and at random places."""
    path, frames = walk
    content = path.read_bytes()
    ends = _sizes_after_each_frame(frames, tmp_path)
    between = np.random.default_rng(0).integers(ends[0], len(content), 60).tolist()
    cut = tmp_path / "cut.mcap"
    around = {end + d for end in ends for d in (-1, 0, 1)} - {ends[0] - 1}
    for size in sorted({*between, *around}):
        cut.write_bytes(content[:size])
        whole = sum(end <= size for end in ends[1:])
        recording = McapRecording(cut)
        assert recording.remarks == ["recording ended early: every complete frame is played back"]
        try:
            played = list(recording.frames())
        except RecordingError:
            assert whole == 0
            continue
        assert whole <= len(played) <= whole + 1  # one more where only its index was cut
        assert all(map(same, played, frames))
        assert recording.skipped == []


def test_an_index_beyond_the_end_of_the_file_is_not_followed(walk, same, tmp_path):
    path, frames = walk
    content = bytearray(path.read_bytes())
    footer = len(content) - len(MAGIC) - 20  # summary_start, summary_offset_start, checksum
    content[footer : footer + 8] = (2**63 + 1).to_bytes(8, "little")
    damaged = tmp_path / "index.mcap"
    damaged.write_bytes(content)
    recording = McapRecording(damaged)
    assert recording.remarks == ["recording ended early: every complete frame is played back"]
    assert all(map(same, list(recording.frames()), frames))


def test_a_file_truncated_in_its_head_is_refused(walk, tmp_path):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(walk[0].read_bytes()[:60])
    with pytest.raises(RecordingError, match="not a recording of surefoot"):
        McapRecording(cut)


def _sizes_after_each_frame(frames, tmp_path):
    """Size of the file after the head and after each frame, while the writer is open."""
    path = tmp_path / "growing.mcap"
    with RecordingWriter(path, INFO) as writer:
        sizes = [path.stat().st_size]
        for frame in frames:
            writer.write(encode(frame))
            sizes.append(path.stat().st_size)
    return sizes


def test_a_recording_can_be_played_while_it_is_being_written(make_frame, same, tmp_path):
    frames = [make_frame(i) for i in range(3)]
    with RecordingWriter(tmp_path / "r.mcap", INFO) as writer:
        for count, frame in enumerate(frames, start=1):
            writer.write(encode(frame))
            assert len(list(McapRecording(tmp_path / "r.mcap").frames())) == count


def test_a_flipped_byte_never_gives_a_wrong_frame(walk, same, tmp_path):
    path, frames = walk
    content = path.read_bytes()
    rng = np.random.default_rng(1)
    stamps = [frame.stamp_s for frame in frames]
    bad = tmp_path / "bad.mcap"
    lost = 0
    for position in rng.integers(8, len(content), 150).tolist():
        flipped = bytearray(content)
        flipped[position] ^= int(rng.integers(1, 256))
        bad.write_bytes(flipped)
        try:
            recording = McapRecording(bad)
            played = list(recording.frames())
        except RecordingError:
            continue
        assert all(same(frame, frames[stamps.index(frame.stamp_s)]) for frame in played)
        lost += len(played) < len(frames)
    assert lost > 50  # most of the bytes are frames, so the flips did reach them


def test_a_flipped_byte_in_the_head_is_refused_or_has_no_effect(walk, same, tmp_path):
    path, frames = walk
    content = path.read_bytes()
    bad = tmp_path / "bad.mcap"
    refused = 0
    for position in range(_sizes_after_each_frame([], tmp_path)[0]):
        flipped = bytearray(content)
        flipped[position] ^= 0x15
        bad.write_bytes(flipped)
        try:
            played = list(McapRecording(bad).frames())
        except RecordingError:
            refused += 1
            continue
        assert all(map(same, played, frames))
    assert refused > 100


def test_a_damaged_chunk_is_counted_and_skipped(walk, tmp_path):
    path, frames = walk
    content = bytearray(path.read_bytes())
    ends = _sizes_after_each_frame(frames, tmp_path)
    content[(ends[2] + ends[3]) // 2] ^= 255  # inside the third frame's images
    bad = tmp_path / "bad.mcap"
    bad.write_bytes(content)
    recording = McapRecording(bad)
    assert [f.stamp_s for f in recording.frames()] == [
        f.stamp_s for i, f in enumerate(frames) if i != 2
    ]
    (skipped,) = recording.skipped
    assert "damaged" in skipped.reason


@pytest.mark.parametrize("lost", ["/odometry", "/imu", "/depth/image", "/colour/image", "/tf"])
def test_a_lost_message_is_not_taken_from_the_frame_before(make_frame, same, tmp_path, lost):
    frames = [make_frame(i) for i in range(3)]
    path = tmp_path / "r.mcap"
    with RecordingWriter(path, INFO) as writer:
        for number, frame in enumerate(frames, 1):
            for topic, message in frame_messages(encode(frame)):
                if (number, topic) != (2, lost):
                    writer._topics.add(topic, message, nanoseconds(frame.stamp_s), number)
    recording = McapRecording(path)
    expected = [decode(encode(frames[k])) for k in (0, 2)]
    assert all(map(same, recording.frames(), expected))
    assert [one.reason for one in recording.skipped] == [f"without its {lost}"]


def test_other_topics_in_the_file_are_ignored(make_frame, same, tmp_path):
    frames = [make_frame(i) for i in range(3)]
    path = tmp_path / "r.mcap"
    with RecordingWriter(path, INFO) as writer:
        for frame in frames:
            writer.write(encode(frame))
            pose = PoseInFrame(timestamp=Timestamp(seconds=1), frame_id="world")
            writer._topics.add("/estimate/pose", pose, nanoseconds(frame.stamp_s), 0)
    assert all(map(same, McapRecording(path).frames(), [decode(encode(f)) for f in frames]))
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        extra = list(reader.iter_decoded_messages(topics=["/estimate/pose"]))
    assert [m.decoded_message.frame_id for m in extra] == ["world"] * 3


def test_equal_stamps_are_skipped_and_a_clock_that_was_set_back_is_played(make_frame, tmp_path):
    frames = [make_frame(i, stamp_s=s) for i, s in enumerate((1.0, 1.0, 2.0, 1.5, 3.0))]
    recording = McapRecording(write(tmp_path / "r.mcap", frames))
    assert [frame.stamp_s for frame in recording.frames()] == [1.0, 2.0, 1.5, 3.0]
    assert [s.reason for s in recording.skipped] == [
        "the stamp equals that of the frame before",
    ]


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("nowhere/r.mcap", "cannot write recording .*nowhere/r.mcap: No such file or directory"),
        (".", "cannot write recording .*: Is a directory; choose another folder"),
    ],
)
def test_a_path_that_cannot_be_written_is_named(tmp_path, name, message):
    with pytest.raises(OutputError, match=message):
        RecordingWriter(tmp_path / name, INFO)


def test_a_full_disk_is_named():
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full here")
    with pytest.raises(
        OutputError, match=r"/dev/full: No space left on device; .* free some space"
    ):
        RecordingWriter(Path("/dev/full"), INFO)


def _foreign() -> bytes:
    out = io.BytesIO()
    writer = Writer(out)
    writer.start()
    channel = writer.register_channel("/camera/depth", "ros1", 0)
    writer.add_message(channel, 0, b"abc", 0)
    writer.finish()
    return out.getvalue()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "the file is empty; record again"),
        (b"PK\x03\x04 not mcap", "starts with .*this is not an MCAP file"),
        (b"\x89MCAP0\r\n", "not a recording of surefoot; it contains nothing"),
        (_foreign(), "not a recording of surefoot; it contains /camera/depth. Only ROS 2 bags"),
    ],
)
def test_other_files_are_refused_by_their_content(tmp_path, content, message):
    path = tmp_path / "r.mcap"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=message):
        McapRecording(path)


def test_a_recording_without_frames_is_refused(tmp_path):
    recording = McapRecording(write(tmp_path / "r.mcap", []))
    with pytest.raises(RecordingError, match=r"no complete frame in .* bytes; record again"):
        list(recording.frames())


def test_a_newer_format_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("surefoot.recordings.mcap_messages.FORMAT", 99)
    path = tmp_path / "r.mcap"
    with RecordingWriter(path, INFO):
        pass
    with pytest.raises(RecordingError, match="format 99 is newer than the 3 this version reads"):
        McapRecording(path)


def test_a_long_recording_is_played_in_the_memory_of_a_few_frames(make_frame, tmp_path):
    encoded = encode(make_frame(1))

    def peak(count):
        path = tmp_path / f"{count}.mcap"
        with RecordingWriter(path, INFO) as writer:
            for k in range(count):
                writer.write(dataclasses.replace(encoded, stamp_s=float(k)))
        recording = McapRecording(path)
        tracemalloc.start()
        assert sum(1 for _ in recording.frames()) == count
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return most

    assert peak(60) < 1.5 * peak(6)  # kept frames would make it 10 times as much


def test_a_pipe_in_the_place_of_a_recording_is_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / "recording.mcap")  # nobody writes into it
    for path in (tmp_path, tmp_path / "recording.mcap"):
        with pytest.raises(RecordingError):
            open_recording(path)
    with pytest.raises(RecordingError, match="is not a file"):
        McapRecording(tmp_path / "recording.mcap")
    with pytest.raises(RecordingError, match="is not a file"):
        list(moments_of(tmp_path / "recording.mcap"))
