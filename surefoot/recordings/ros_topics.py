"""The topics of a ROS bag that make a recording, and their decoded messages.

Source: rosbags (reading and decoding of messages).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from perception.primitives.errors import RecordingError

from .recording import SkipLog
from .ros_messages import is_depth_encoding, is_rectified

_IMAGE, _COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
_INFO = "sensor_msgs/msg/CameraInfo"


@dataclass(frozen=True)
class Topics:
    """Topics of the recording.

    Args:
        depth, depth_info: Depth image and its camera.
        colour, colour_info: Colour image and its camera; None without colour.
        compressed_depth, compressed_colour: Whether they are compressed.
    """

    depth: str
    depth_info: str
    colour: str | None
    colour_info: str | None
    compressed_depth: bool
    compressed_colour: bool


def find_topics(path: Path, reader: Any) -> Topics:
    """The largest depth stream with a camera, best with "depth" in its name, and the colour stream that matches it best.

    Rectified depth images of a camera are preferred if there are at least half as many as raw ones.

    Raises:
        RecordingError: There are no depth images, or none with a camera; the message lists the topics.
    """
    infos = {c.topic for c in reader.connections if c.msgtype == _INFO and c.msgcount}
    depths, colours = [], []
    for connection in reader.connections:
        if connection.msgtype not in (_IMAGE, _COMPRESSED) or not connection.msgcount:
            continue
        info = _info_of(connection.topic, infos)
        kind = _kind(reader, connection)
        unsure = kind == "mono16" or "depth" not in connection.topic.lower()
        entry = (info is not None, connection.msgcount, connection.topic, info, connection.msgtype)
        if kind in ("depth", "mono16"):
            depths.append((*entry, unsure, kind))
        elif kind == "colour":
            colours.append(entry)
    depths = [d for d in depths if d[6] == "depth"] or depths  # mono16 may be infrared
    rectified = [d for d in depths if d[0] and is_rectified(d[2])]
    usable = sorted(
        (d for d in depths if d[0] and not any(_replaces(r, d) for r in rectified)),
        key=lambda d: (d[5], -d[1], d[4] == _COMPRESSED, d[2]),
    )
    if not usable:
        listed = ", ".join(sorted(f"{c.topic} ({c.msgtype})" for c in reader.connections)) or "none"
        lacks = "no camera_info for its depth images" if depths else "no depth image"
        raise RecordingError(f"{path}: {lacks}; its topics are: {listed}")
    depth, depth_info, depth_type = usable[0][2:5]
    ranked = sorted(
        (c for c in colours if c[0]),
        key=lambda c: (-_shared(depth, c[2]), c[4] == _COMPRESSED, c[2]),
    )
    colour = ranked[0] if ranked else None
    return Topics(
        depth,
        str(depth_info),
        None if colour is None else colour[2],
        None if colour is None else colour[3],
        depth_type == _COMPRESSED,
        colour is not None and colour[4] == _COMPRESSED,
    )


def _replaces(rectified: tuple[Any, ...], other: tuple[Any, ...]) -> bool:
    """Whether a rectified stream replaces a raw one of the same camera: it has at least half as many images."""
    same = rectified[3] == other[3] and not is_rectified(other[2])
    return same and 2 * rectified[1] >= other[1]


def _kind(reader: Any, connection: Any) -> str | None:
    """Kind of an image stream by its first readable message: "depth", "mono16", "colour" or None."""
    for _, message in decoded(reader, [connection], SkipLog()):
        if connection.msgtype == _COMPRESSED:
            return "depth" if "compressedDepth" in message.format else "colour"
        if is_depth_encoding(message.encoding):
            return "mono16" if message.encoding == "mono16" else "depth"
        return "colour" if message.encoding.startswith(("rgb", "bgr", "mono8")) else None
    return None


def _info_of(topic: str, infos: set[str]) -> str | None:
    """The `camera_info` in the nearest namespace, such as /a/depth/camera_info for /a/depth/image_raw."""
    space = topic
    while "/" in space:
        space = space.rsplit("/", 1)[0]
        if f"{space}/camera_info" in infos:
            return f"{space}/camera_info"
    return None


def _shared(a: str, b: str) -> int:
    """Number of leading parts that two topic names share."""
    return next(
        (n for n, (x, y) in enumerate(zip(a.split("/"), b.split("/"), strict=False)) if x != y), 99
    )


def decoded(reader: Any, connections: list[Any], skips: SkipLog) -> Iterator[tuple[Any, Any]]:
    """Decoded messages of some topics; skips damaged ones, and ends at a damaged end of the bag."""
    if not connections:
        return
    stream, topics = reader.messages(connections=connections), {one.topic for one in connections}
    while True:
        try:
            connection, _, raw = next(stream)
        except StopIteration:
            return
        except Exception as error:  # the package raises many types for a damaged file
            skips.skip("the rest of the bag", f"cannot be read: {words(error)}")
            return
        if connection.topic not in topics:
            skips.skip(f"a message of {connection.topic}", "is listed under another topic")
            continue
        try:
            message = reader.deserialize(raw, connection.msgtype)
        except Exception as error:
            skips.skip(f"a message of {connection.topic}", f"is damaged: {words(error)}")
            continue
        yield connection, message


def words(error: Exception) -> str:
    """The first line of an error, or its type."""
    return str(error).splitlines()[0] if str(error) else type(error).__name__
