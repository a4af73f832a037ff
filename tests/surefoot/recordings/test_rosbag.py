"""ROS bags written with the rosbags package are read back."""

from __future__ import annotations

import contextlib
import importlib.util
import os
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from perception.primitives.errors import RecordingError
from surefoot.recordings.open import open_recording
from surefoot.recordings.recording import SkipLog
from surefoot.recordings.ros_topics import decoded


def _beside(name: str) -> Any:
    spec = importlib.util.spec_from_file_location(name, Path(__file__).with_name(f"{name}.py"))
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


bags = _beside("bags")
Bag, write_bag, depth_mm, colour = bags.Bag, bags.write_bag, bags.depth_mm, bags.colour


def metres(frame: int) -> np.ndarray:
    mm = depth_mm(frame).astype(np.float64)
    return np.where(mm > 0, mm / 1000.0, np.nan)


@pytest.mark.parametrize("kind", bags.KINDS)
def test_depth_colour_and_poses_are_read(tmp_path, kind):
    recording = open_recording(write_bag(tmp_path / "walk", kind))
    frames = list(recording.frames())
    assert recording.info.kind == "rosbag"
    assert recording.info.poses_given
    assert recording.info.frames == len(frames) == 5
    assert recording.skipped == []
    for i, frame in enumerate(frames):
        assert frame.stamp_s == pytest.approx(10.0 + 0.1 * i, abs=1e-6)
        np.testing.assert_allclose(frame.depth.depth, metres(i), atol=1e-6)
        np.testing.assert_array_equal(frame.colour.rgb, colour(i))
        assert frame.depth.camera.fx == 30.0
        np.testing.assert_allclose(frame.T_world_camera.position, [0.1 * i, 0.0, 0.5], atol=1e-6)


def test_one_of_two_parents_of_a_frame_gives_all_poses(tmp_path):
    """A second estimate, published first and every other time, has an origin of its own."""
    bag = Bag(tmp_path / "walk", "ros2")
    bag.write("/cam/camera_info", bag.info(1.0, "camera"), 1.0)
    for i in range(6):
        stamp = 1.0 + 0.1 * i
        parent, x = ("odom", 5.0) if i % 2 == 0 else ("map", 0.0)
        for at in (stamp - 0.04, stamp + 0.04):
            bag.write("/tf", bag.transform(at, parent, "camera", (x, 0.0, 0.0)), stamp)
        bag.write("/cam/depth", bag.image(stamp, "camera", depth_mm(i), "16UC1"), stamp)
    recording = open_recording(bag.close())
    poses = [one.T_world_camera for one in recording.frames() if one.T_world_camera is not None]
    assert {round(pose.position[0], 6) for pose in poses} == {0.0}
    assert "camera has 2 parents in tf (odom, map); that in map is used" in recording.remarks


def test_a_single_file_of_a_ros_2_bag_is_read(tmp_path):
    folder = write_bag(tmp_path / "walk", "mcap")
    (single,) = folder.glob("*.mcap")
    assert len(list(open_recording(single).frames())) == 5


def test_colours_of_another_camera_are_registered_to_the_depth(tmp_path):
    recording = open_recording(write_bag(tmp_path / "walk", "ros2", colour_frame="colour_camera"))
    frame = next(iter(recording.frames()))
    v, u = 12, 20
    z = metres(0)[v, u]
    x = (u - 15.5) / 30.0 * z - bags.BASELINE_M
    seen_at = round(30.0 * x / z + 15.5)
    np.testing.assert_array_equal(frame.colour.rgb[v, u], colour(0)[v, seen_at])
    assert (frame.colour.rgb[0, 0] == 0).all()


@pytest.mark.parametrize("words", ["16UC1; compressedDepth png", "32FC1; compressedDepth png"])
def test_compressed_depth_is_read_in_both_scales(tmp_path, words):
    bag = Bag(tmp_path / "walk", "ros2")
    truth = metres(0)
    data = (
        bags.compressed_metres(np.nan_to_num(truth))
        if words.startswith("32")
        else bags.compressed_depth(depth_mm(0))
    )
    bag.write("/cam/camera_info", bag.info(1.0, "camera"), 1.0)
    bag.write("/cam/depth/compressedDepth", bag.compressed(1.0, "camera", data, words), 1.0)
    (frame,) = open_recording(bag.close()).frames()
    step = 1.6**2 / 100.0 if words.startswith("32") else 1e-6  # of A / depth in whole units
    np.testing.assert_allclose(frame.depth.depth, truth, atol=step)
    assert not open_recording(tmp_path / "walk").info.poses_given


def test_depth_in_metres_is_read_without_loss(tmp_path):
    bag = Bag(tmp_path / "walk", "ros1")
    truth = np.random.default_rng(0).uniform(0.5, 3.0, (bags.HEIGHT, bags.WIDTH)).astype(np.float32)
    truth[3, 4], truth[5, 6], truth[7, 8] = np.nan, -1.0, 1e10  # as Blender writes no surface
    bag.write("/cam/camera_info", bag.info(1.0, "camera"), 1.0)
    bag.write("/cam/depth", bag.image(1.0, "camera", truth, "32FC1"), 1.0)
    (frame,) = open_recording(bag.close()).frames()
    truth[5, 6] = truth[7, 8] = np.nan
    np.testing.assert_array_equal(frame.depth.depth, truth)


@pytest.mark.parametrize(("scale", "word"), [(0.01, "nearer"), (20.0, "farther")])
def test_an_implausible_depth_is_asked_about(tmp_path, scale, word):
    bag = Bag(tmp_path / "walk", "ros2")
    depth = (depth_mm(0) * scale).astype(np.uint16)
    bag.write("/cam/camera_info", bag.info(1.0, "camera"), 1.0)
    bag.write("/cam/depth", bag.image(1.0, "camera", depth, "16UC1"), 1.0)
    path = bag.close()
    with pytest.raises(RecordingError, match=rf"{word}.*in topic /cam/depth;.*scale_checked"):
        list(open_recording(path).frames())
    description = tmp_path / "near.toml"
    description.write_text("scale_checked = true\n")
    assert len(list(open_recording(path, description).frames())) == 1


@pytest.mark.parametrize("encoding", ["mono16", "16UC1"])
def test_an_infrared_stream_with_more_images_is_not_taken_for_depth(tmp_path, encoding):
    bag = Bag(tmp_path / "walk", "ros2")
    for topic, count, kind in (("infra1/image", 3, encoding), ("depth/image", 2, "16UC1")):
        bag.write(f"/cam/{topic[:5]}/camera_info", bag.info(1.0, "camera"), 1.0)
        bag.write("/cam/camera_info", bag.info(1.0, "camera"), 1.0)
        for i in range(count):
            stamp = 1.0 + 0.1 * i
            bag.write(f"/cam/{topic}", bag.image(stamp, "camera", depth_mm(i), kind), stamp)
    recording = open_recording(bag.close())
    assert recording.info.frames == 2
    assert recording.remarks[0].startswith("depth of /cam/depth/image")


def test_mono16_is_depth_if_nothing_else_is(tmp_path):
    bag = Bag(tmp_path / "walk", "ros2")
    bag.write("/cam/camera_info", bag.info(1.0, "camera"), 1.0)
    bag.write("/cam/image", bag.image(1.0, "camera", depth_mm(0), "mono16"), 1.0)
    assert len(list(open_recording(bag.close()).frames())) == 1


def test_a_damaged_image_is_skipped_and_counted(tmp_path):
    bag = Bag(tmp_path / "walk", "ros2")
    bag.write("/cam/camera_info", bag.info(1.0, "camera"), 1.0)
    for i in range(3):
        message = bag.image(1.0 + i, "camera", depth_mm(i), "16UC1")
        if i == 1:
            message.data = message.data[:100]
        bag.write("/cam/depth", message, 1.0 + i)
    recording = open_recording(bag.close())
    assert [frame.stamp_s for frame in recording.frames()] == [1.0, 3.0]
    assert "100 bytes" in recording.skipped[0].reason


def test_an_image_with_a_stamp_far_too_late_costs_itself_and_no_colours(tmp_path):
    bag = Bag(tmp_path / "walk", "ros2")
    for topic in ("/cam/depth/camera_info", "/cam/color/camera_info"):
        bag.write(topic, bag.info(1.0, "camera"), 1.0)
    for i in range(6):
        stamp_s = 3.15e7 if i == 2 else 1.0 + 0.25 * i
        bag.write("/cam/depth/image", bag.image(stamp_s, "camera", depth_mm(i), "16UC1"), 1.0 + i)
        colours = bag.image(1.0 + 0.25 * i, "camera", bags.colour(i), "rgb8")
        bag.write("/cam/color/image", colours, 1.0 + i)
    recording = open_recording(bag.close())
    frames = list(recording.frames())
    assert [frame.stamp_s for frame in frames] == [1.0, 1.25, 1.75, 2.0, 2.25]
    assert all(frame.colour is not None for frame in frames)
    assert [one.reason for one in recording.skipped] == [
        "the stamp is later than those of the frames after"
    ]


@pytest.mark.parametrize("kind", bags.KINDS)
def test_a_truncated_bag_gives_its_complete_frames_or_an_error(tmp_path, kind):
    bag = write_bag(tmp_path / "walk", kind, frames=40)
    (file,) = [bag] if bag.is_file() else [f for f in bag.iterdir() if f.name != "metadata.yaml"]
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    given = []
    with pytest.raises(RecordingError) if kind != "ros2" else contextlib.suppress(RecordingError):
        given = list(open_recording(bag).frames())
    assert len(given) < 40


def test_a_message_that_the_index_lists_under_another_topic_is_skipped():
    tf, info = (
        SimpleNamespace(topic="/tf", msgtype="tf"),
        SimpleNamespace(topic="/info", msgtype="info"),
    )
    reader = SimpleNamespace(
        messages=lambda connections: iter([(tf, 0, b"1"), (info, 1, b"2"), (tf, 2, b"3")]),
        deserialize=lambda raw, kind: (kind, raw),
    )
    skips = SkipLog()
    assert [message for _, message in decoded(reader, [tf], skips)] == [("tf", b"1"), ("tf", b"3")]
    assert [one.reason for one in skips.skipped] == ["is listed under another topic"]


@pytest.mark.parametrize("folder", [False, True])
def test_a_cut_mcap_file_can_be_mended(tmp_path, folder):
    bag = write_bag(tmp_path / "walk", "mcap")
    (file,) = bag.glob("*.mcap")
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    with pytest.raises(RecordingError, match=r"is cut: `mcap recover FILE -o NEW` mends it"):
        open_recording(bag if folder else file)


def test_a_ros_file_named_as_ours_is_read_from_its_folder(tmp_path):
    bag = write_bag(tmp_path / "walk", "mcap")
    (file,) = bag.glob("*.mcap")
    file.rename(bag / "recording.mcap")
    (bag / "metadata.yaml").unlink()
    recording = open_recording(bag)
    assert recording.info.kind == "rosbag"
    assert len(list(recording.frames())) == 5


@pytest.mark.parametrize(
    ("content", "words"), [("[" * 2000, "nested too deeply"), ("a: 1\n" * 300_000, "are the most")]
)
def test_metadata_that_takes_long_to_parse_is_refused_at_once(tmp_path, content, words):
    bag = write_bag(tmp_path / "walk", "ros2")
    (bag / "metadata.yaml").write_text(content)
    with pytest.raises(RecordingError, match=words):
        open_recording(bag)


@pytest.mark.parametrize("count", ["nan", "-3", "2.5"])
def test_metadata_with_a_number_of_messages_that_is_none_is_refused(tmp_path, count):
    bag = write_bag(tmp_path / "walk", "ros2")
    metadata = bag / "metadata.yaml"
    text = metadata.read_text()
    metadata.write_text(re.sub(r"(?m)^(  - message_count:) \d+", rf"\1 {count}", text))
    with pytest.raises(RecordingError, match=rf"it counts '?{count}'? messages of /"):
        open_recording(bag)


def test_the_error_of_a_bag_without_depth_lists_its_topics(tmp_path):
    bag = Bag(tmp_path / "walk", "ros2")
    bag.write("/cam/rgb/image", bag.image(1.0, "camera", colour(0), "rgb8"), 1.0)
    with pytest.raises(RecordingError, match=r"no depth image.*/cam/rgb/image"):
        open_recording(bag.close())


def test_depth_without_its_camera_is_refused(tmp_path):
    bag = Bag(tmp_path / "walk", "ros2")
    bag.write("/cam/depth", bag.image(1.0, "camera", depth_mm(0), "16UC1"), 1.0)
    with pytest.raises(RecordingError, match="no camera_info"):
        open_recording(bag.close())


@pytest.mark.parametrize("name", ["walk.bag", "walk.mcap"])
def test_another_file_is_refused_as_a_bag(tmp_path, name):
    path: Path = tmp_path / name
    path.write_bytes(b"\x89MCAP0\r\n\x01ros2 but not really a bag" * 4)
    with pytest.raises(RecordingError, match="expected a ROS 1"):
        open_recording(path)


@pytest.mark.parametrize(
    ("kind", "name"), [("ros1", "a.bag"), ("ros2", "a/a.db3"), ("mcap", "a/a.mcap")]
)
@pytest.mark.parametrize("put", [os.mkfifo, lambda path: path.write_bytes(bytes(1000))])
def test_a_pipe_or_zeros_in_the_place_of_a_bag_are_refused_at_once(tmp_path, kind, name, put):
    write_bag(tmp_path / "a", kind, 1)
    path = tmp_path / name
    path.unlink()
    put(path)  # nobody writes into a pipe
    with pytest.raises(RecordingError, match=r"is n(ot|either) a file|begins with b'.x00"):
        open_recording(path.parent if path.parent != tmp_path else path)
