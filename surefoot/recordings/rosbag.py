"""ROS bags: ROS 1 `.bag`, ROS 2 folders (sqlite3 or MCAP) and single ROS 2 `.mcap` files.

The reader uses one depth stream (raw or `compressedDepth`) with its `camera_info`, the colour stream of the same
camera (raw or compressed), and the transforms. If `tf` connects a fixed frame with the depth camera, the frames
have poses; if it connects depth and colour camera, the colours are registered to the depth image. Images that ROS
names rectified (`is_rectified`) have no lens distortion; raw colour images of the camera of a rectified depth image
are undistorted to match it. Messages are streamed; a depth image waits only for the next colour image.

Sources: rosbags (reading and decoding of messages); REP 103 (axes), REP 105 (names of fixed frames), REP
118 (depth images: 16UC1 in millimetres, 32FC1 in metres); image_transport_plugins (`compressedDepth`).
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float32

from perception.depth.depth_to_colour import colours_of_depth
from perception.primitives import safe_input
from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError, RecordingError
from perception.primitives.frame import ColourView, DepthView, Frame
from perception.primitives.safe_input import UnreadableError

from ..mcap_file import MAGIC
from .description import Description, complete
from .folder import check_scale
from .poses import ASSOCIATION_S
from .recording import FOLLOWING, FrameError, RecordingInfo, SkipLog, SkippedFrame
from .ros_messages import camera_of_info, colour_image, depth_image, is_rectified
from .ros_topics import decoded, find_topics, words
from .ros_transforms import Transforms

METADATA = "metadata.yaml"
MOST_METADATA_BYTES = 1 << 20  # ours: a thousand topics
MOST_NESTED = 20  # ours: brackets of metadata; they have two
FIXED = ("world", "map", "odom", "vicon", "mocap")
"""Fixed frames, the most global first (REP 105, and frames of motion capture)."""

_TF = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
_MAGIC = {".bag": b"#ROSBAG V", ".db3": b"SQLite format 3\0", ".mcap": MAGIC, ".zstd": b""}
_PROFILE_BYTES = 64  # magic bytes, then the header, which begins with the profile
_MAX_WAIT_S = 0.5  # ours: time that a depth image waits for its colour image


class RosbagRecording:
    """A ROS bag, read as a stream."""

    def __init__(self, path: Path, description: Description | None = None) -> None:
        """Find the topics; read cameras and transforms.

        Args:
            path: Bag file or folder.
            description: Optional name, scene and vertical axis of the world.

        Raises:
            RecordingError: The path is not a bag, is damaged as a whole, or has no depth images with a camera.
        """
        self._path = path
        self._skips = SkipLog()
        self._scale_checked = description is not None and description.scale_checked
        with self._reader() as reader:
            self._topics = find_topics(path, reader)
            self._camera = self._first_camera(reader, self._topics.depth_info, self._topics.depth)
            colour, colour_info = self._topics.colour, self._topics.colour_info
            self._colour_camera = (
                None
                if colour is None or colour_info is None
                else self._first_camera(reader, colour_info, colour)
            )
            self._transforms = self._read_transforms(reader)
            frames = sum(c.msgcount for c in reader.connections if c.topic == self._topics.depth)
            self._depth_frame = self._first_frame_id(reader, self._topics.depth)
        fixed = self._transforms.first_leading_to(FIXED, self._depth_frame)
        self._fixed = fixed
        self.remarks = [f"depth of {self._topics.depth}, colour of {self._topics.colour or 'none'}"]
        if fixed is not None:
            self.remarks.append(f"poses are the transforms from {fixed} to {self._depth_frame}")
        self.remarks += self._transforms.doubts()
        self.info = complete(
            RecordingInfo(
                name=path.resolve().stem,
                kind="rosbag",
                poses_given=fixed is not None,
                frames=frames,
                gravity_up_world=(0.0, 0.0, 1.0) if fixed in ("world", "map", "odom") else None,
            ),
            description,
        )

    @property
    def skipped(self) -> list[SkippedFrame]:
        """Frames skipped so far by the latest `frames()`."""
        return self._skips.skipped

    def frames(self) -> Iterator[Frame]:
        """The readable frames in the order of the bag, one in memory at a time.

        Raises:
            RecordingError: No frame can be read, or the depth of the first one is not that of a room.
        """
        skips = self._skips = SkipLog()
        waiting: list[tuple[float, Any]] = []
        colours: list[tuple[float, Any]] = []
        with self._reader() as reader:
            wanted = (self._topics.depth, self._topics.colour)
            chosen = [c for c in reader.connections if c.topic in wanted]
            for connection, message in decoded(reader, chosen, skips):
                stamp = _seconds(message.header.stamp)
                if connection.topic == self._topics.depth:
                    waiting.append((stamp, message))
                else:
                    colours.append((stamp, message))
                while len(waiting) > FOLLOWING and _settled(
                    waiting[0][0], stamp, colours, self._topics.colour
                ):
                    yield from self._first_waiting(skips, waiting, colours)
            while waiting:
                yield from self._first_waiting(skips, waiting, colours)
        skips.check_use(self._path)

    def _first_waiting(
        self, skips: SkipLog, waiting: list[tuple[float, Any]], colours: list[tuple[float, Any]]
    ) -> Iterator[Frame]:
        """The frame of the first depth image that waits, if it can be used; drops older colour images."""
        stamp, message = waiting.pop(0)
        try:
            skips.check_stamp(stamp, [one for one, _ in waiting[:FOLLOWING]])
            while colours and colours[0][0] < stamp - ASSOCIATION_S:
                colours.pop(0)
            depth = depth_image(message, self._camera, self._topics.compressed_depth)
            colour = self._colour(stamp, depth, colours)
        except FrameError as error:
            skips.skip(f"{self._topics.depth} at {stamp:.6f}", str(error))
            return
        if skips.returned == 0 and not self._scale_checked:
            check_scale(
                self._path,
                depth,
                f"in topic {self._topics.depth}",
                "Convert its images to millimetres (16UC1) or metres (32FC1)",
            )
        pose = None
        if self._fixed is not None:
            pose = self._transforms.between(self._fixed, self._depth_frame, stamp)
        skips.note(stamp)
        yield Frame(stamp, depth=DepthView(depth, self._camera), colour=colour, T_world_camera=pose)

    def _colour(
        self, stamp: float, depth: np.ndarray, colours: Sequence[tuple[float, Any]]
    ) -> ColourView | None:
        """The nearest colour image, registered to the depth image if another camera took it."""
        if self._colour_camera is None:
            return None
        near = min(colours, key=lambda one: abs(one[0] - stamp), default=None)
        if near is None or abs(near[0] - stamp) > ASSOCIATION_S:
            return None
        rgb = colour_image(near[1], self._colour_camera, self._topics.compressed_colour)
        frame = near[1].header.frame_id
        if frame == self._depth_frame:
            if self._undistortion is None:
                return ColourView(rgb, self._colour_camera)
            u, v = self._undistortion
            undistorted = cv2.remap(rgb, u, v, cv2.INTER_LINEAR)
            return ColourView(np.asarray(undistorted, np.uint8), self._camera)
        T_colour_depth = self._transforms.between(frame, self._depth_frame, stamp)
        if T_colour_depth is None:
            return None
        registered = colours_of_depth(depth, self._camera, rgb, self._colour_camera, T_colour_depth)
        return ColourView(registered, self._camera)

    @cached_property
    def _undistortion(self) -> Float32[np.ndarray, "2 h w"] | None:
        """Pixel (u, v) of the raw colour image for each pixel of the rectified depth image of the same camera.

        (-1, -1) where it shows none. None if the images match without undistortion, or differ in size.
        """
        one, other = self._camera, self._colour_camera
        if other is None or one.is_distorted or not other.is_distorted:
            return None
        if (one.width, one.height) != (other.width, other.height):
            return None
        pixels = np.nan_to_num(other.project(one.rays), nan=-1.0).astype(np.float32)
        return np.ascontiguousarray(np.moveaxis(pixels, -1, 0))

    def _first(self, reader: Any, topic: str) -> Any:
        chosen = [c for c in reader.connections if c.topic == topic]
        for _, message in decoded(reader, chosen, SkipLog()):
            return message
        raise RecordingError(f"{self._path}: topic {topic} has no readable message")

    def _first_camera(self, reader: Any, topic: str, images: str) -> Camera:
        message = self._first(reader, topic)
        try:
            return camera_of_info(message, is_rectified(images))
        except ConfigError as error:
            raise RecordingError(
                f"{self._path}, topic {topic} of the images {images}: {error}"
            ) from error

    def _first_frame_id(self, reader: Any, topic: str) -> str:
        return str(self._first(reader, topic).header.frame_id).lstrip("/")

    def _read_transforms(self, reader: Any) -> Transforms:
        found = Transforms()
        chosen = [c for c in reader.connections if c.msgtype in _TF]
        for connection, message in decoded(reader, chosen, SkipLog()):
            static = connection.topic.endswith("tf_static")
            for one in message.transforms:
                found.add(
                    one.header.frame_id,
                    one.child_frame_id,
                    None if static else _seconds(one.header.stamp),
                    one.transform,
                )
        return found

    @contextlib.contextmanager
    def _reader(self) -> Iterator[Any]:
        """The open bag; a bag without message definitions is read with those of ROS 2 Humble."""
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore

        with contextlib.ExitStack() as stack:
            try:
                if self._path.is_dir():
                    check_metadata(self._path / METADATA)
                check_files(self._path)
                store = get_typestore(Stores.ROS2_HUMBLE)
                reader = stack.enter_context(AnyReader([self._path], default_typestore=store))
                check_counts(reader)
            except Exception as error:
                cut = "; the file is cut: `mcap recover FILE -o NEW` mends it"
                raise RecordingError(
                    f"{self._path}: cannot be read as a ROS bag: {words(error)}"
                    f"{cut * ('end magic' in str(error))}; expected a ROS 1 .bag, "
                    "a ROS 2 folder with metadata.yaml, or a ROS 2 .mcap"
                ) from error
            yield reader


def is_rosbag(path: Path) -> bool:
    """Whether a path is a bag, by its name, its metadata, or the profile of an MCAP file."""
    if path.is_dir():
        return (path / METADATA).is_file()
    if path.suffix in (".bag", ".db3"):
        return True
    if path.suffix != ".mcap":
        return False
    try:
        return b"ros2" in safe_input.head(path, _PROFILE_BYTES)
    except UnreadableError:  # said by the reader of MCAP
        return False


def check_files(path: Path) -> None:
    """Raise an UnreadableError for a bag that opening would wait for, or whose magic bytes are not those of its name."""
    for file in sorted(path.iterdir()) if path.is_dir() else [path]:
        magic = _MAGIC.get(file.suffix)
        if magic is not None:
            begin = safe_input.head(file, len(magic))
            if begin != magic:
                raise UnreadableError(f"{file.name} begins with {begin!r}, not with {magic!r}")


def check_metadata(path: Path) -> None:
    """Raise an UnreadableError for metadata that takes a parser of YAML long: large, or nested deeply."""
    content = safe_input.data(path, MOST_METADATA_BYTES)
    depth = 0
    for mark in re.findall(rb"[\[{\]}]", content):
        depth += 1 if mark in b"[{" else -1
        if depth > MOST_NESTED:
            raise UnreadableError("its metadata.yaml is nested too deeply")


def check_counts(reader: Any) -> None:
    """Raise an UnreadableError if the metadata has no whole number of messages for a topic; the reader does not check."""
    for one in reader.connections:
        if not isinstance(one.msgcount, int) or one.msgcount < 0:
            raise UnreadableError(f"it counts {one.msgcount!r} messages of {one.topic}")


def _settled(
    stamp: float, now: float, colours: Sequence[tuple[float, Any]], topic: str | None
) -> bool:
    """Whether no later message can bring a nearer colour image for a depth image; also if its stamp is far too late."""
    if topic is None or abs(now - stamp) > _MAX_WAIT_S:
        return True
    return any(other >= stamp for other, _ in colours)


def _seconds(stamp: Any) -> float:
    return float(stamp.sec) + 1e-9 * float(stamp.nanosec)
