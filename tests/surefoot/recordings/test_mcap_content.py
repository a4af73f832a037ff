"""Recordings that are whole as files but wrong inside: the frame is skipped and counted, and the others are returned."""

from __future__ import annotations

import copy
import math
import random
from contextlib import suppress

import lz4.frame
import numpy as np
import pytest
import zstandard
from google.protobuf.message import Message
from mcap.writer import CompressionType, Writer

from perception.primitives.errors import RecordingError
from surefoot import mcap_file
from surefoot.mcap_file import MAGIC, TopicWriter, messages
from surefoot.recordings.codec import encode
from surefoot.recordings.mcap_format import McapRecording
from surefoot.recordings.mcap_messages import (
    JSON_TOPICS,
    frame_messages,
    info_to_json,
)
from surefoot.recordings.recording import RecordingInfo

INFO = RecordingInfo(name="walk", kind="simulation")
WRONG = (None, "", "x", [], {}, [[]], True, -1, 0, 1e300, 10**17, [1.0], {"a": 1})
"""Values to put in the place of another; JSON has no NaN, protobuf has."""
NUMBERS = (math.nan, math.inf, -1.0, 0.0, 1e300)


def write(path, groups):
    topics = TopicWriter(path, JSON_TOPICS, "recording")
    topics.metadata("recording", info_to_json(INFO))
    for number, group in enumerate(groups, start=1):
        for topic, message in group:
            topics.add(topic, message, number, number)
    topics.close()
    return McapRecording(path)


def places(value, path=()):
    """Paths to everything inside a JSON value."""
    inside = (
        value.items()
        if isinstance(value, dict)
        else enumerate(value)
        if isinstance(value, list)
        else ()
    )
    for key, one in inside:
        yield (*path, key)
        yield from places(one, (*path, key))


def put(value, path, new):
    for key in path[:-1]:
        value = value[key]
    value[path[-1]] = new


def spoil_message(message, rng):
    """Change one field, somewhere inside."""
    field = rng.choice(message.DESCRIPTOR.fields)
    value = getattr(message, field.name)
    if field.is_repeated:
        if not len(value) or rng.random() < 0.3:
            message.ClearField(field.name)
        elif field.message_type:
            spoil_message(rng.choice(value), rng)
        else:
            value[rng.randrange(len(value))] = rng.choice(NUMBERS)
    elif field.message_type:
        spoil_message(value, rng)
    elif field.cpp_type in (field.CPPTYPE_DOUBLE, field.CPPTYPE_FLOAT):
        setattr(message, field.name, rng.choice(NUMBERS))
    elif isinstance(value, str):
        setattr(message, field.name, rng.choice(("", "x", "16UC1", "jpeg")))
    elif isinstance(value, bytes):
        setattr(message, field.name, rng.choice((b"", b"x", value[:-1], value + b"x", value[::-1])))
    else:
        setattr(message, field.name, rng.choice((0, 1, 7, 2**31 - 1)))


def spoiled(group, rng):
    """A copy of a frame's messages with one thing wrong."""
    group = copy.deepcopy(group)
    message = rng.choice(group)[1]
    if isinstance(message, Message):
        spoil_message(message, rng)
    else:
        put(message, rng.choice(list(places(message))), rng.choice(WRONG))
    return group


def test_a_frame_of_wrong_content_never_ends_the_reading(make_frame, tmp_path):
    rng = random.Random(1)
    good = [list(frame_messages(encode(make_frame(k)))) for k in range(3)]
    skipped = 0
    for k in range(300):
        recording = write(tmp_path / "r.mcap", [good[0], spoiled(good[1], rng), good[2]])
        stamps = []
        for frame in recording.frames():
            stamps.append(frame.stamp_s)
            shapes = [(v.camera.height, v.camera.width) for v in (frame.tof, frame.depth) if v]
            images = [
                v
                for v in (frame.tof and frame.tof.range_m, frame.depth and frame.depth.depth)
                if v is not None
            ]
            assert [image.shape for image in images] == shapes, k
            assert frame.odometry is None or math.isfinite(frame.odometry.motion.x)
            assert frame.imu is None or np.isfinite(frame.imu.specific_force).all()
        assert stamps[0] == good[0][-1][1]["stamp_s"]
        assert len(stamps) + len(recording.skipped) == 3, k
        skipped += len(recording.skipped)
    assert skipped > 60


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("topic", ["/tof/range", "/tof/amplitude", "/depth/image"])
@pytest.mark.parametrize("units", [0.0, -1.0])
def test_a_frame_whose_units_are_no_number_is_skipped(make_frame, tmp_path, topic, units):
    good = [list(frame_messages(encode(make_frame(k)))) for k in range(2)]
    bad = dict(copy.deepcopy(good[1]))
    bad["/frame"]["units"][topic] = units
    recording = write(tmp_path / "r.mcap", [good[0], list(bad.items())])
    assert len(list(recording.frames())) == 1
    assert len(recording.skipped) == 1


@pytest.mark.parametrize("value", WRONG)
def test_wrong_information_is_one_error(tmp_path, value):
    known = info_to_json(INFO)
    for key in known:
        topics = TopicWriter(tmp_path / "r.mcap", JSON_TOPICS, "recording")
        topics.metadata("recording", known | {key: value})
        topics.close()
        with suppress(RecordingError):
            McapRecording(tmp_path / "r.mcap")


def chunked(path, compression):
    """A file with one large, even message in one chunk, and a small one in another."""
    with path.open("wb") as file:
        writer = Writer(file, compression=compression, chunk_size=1)
        writer.start()
        schema = writer.register_schema("s", "", b"")
        channel = writer.register_channel("/t", "", schema)
        for size in (10_000_000, 10):
            writer.add_message(channel, 0, bytes(size), 0, size)
        writer.finish()
    return path


@pytest.mark.parametrize(
    "compression", [CompressionType.ZSTD, CompressionType.LZ4, CompressionType.NONE]
)
def test_a_chunk_that_unpacks_to_too_much_is_skipped(tmp_path, compression, monkeypatch):
    path = chunked(tmp_path / "r.mcap", compression)
    assert [len(message.data) for _, message in messages(path)] == [10_000_000, 10]
    monkeypatch.setattr(mcap_file, "MOST_CHUNK_BYTES", 1_000_000)
    damaged = []
    found = [len(m.data) for _, m in messages(path, lambda *words: damaged.append(words))]
    assert found == [10]
    assert damaged[0][0] == "chunk 1"


@pytest.mark.parametrize("pack", [zstandard.compress, lz4.frame.compress])
def test_a_chunk_that_lies_about_its_size_is_skipped(tmp_path, pack, monkeypatch):
    path = tmp_path / "r.mcap"
    name = b"zstd" if pack is zstandard.compress else b"lz4"
    packed = pack(bytes(10_000_000))
    record = (
        bytes(16) + (100).to_bytes(8, "little") + bytes(4)
        + len(name).to_bytes(4, "little") + name
        + len(packed).to_bytes(8, "little") + packed
    )  # fmt: skip
    header = b"\x01" + (8).to_bytes(8, "little") + bytes(8)
    path.write_bytes(
        MAGIC + header + b"\x06" + len(record).to_bytes(8, "little") + record + bytes(50)
    )
    monkeypatch.setattr(mcap_file, "MOST_CHUNK_BYTES", 1_000_000)
    damaged = []
    assert not list(messages(path, lambda *words: damaged.append(words)))
    assert damaged
