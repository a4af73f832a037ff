"""Bags written with the rosbags package: a camera approaches a wall."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

WIDTH, HEIGHT = 32, 24
KINDS = ("ros1", "ros2", "mcap")
BASELINE_M = 0.05
TF = "tf2_msgs/msg/TFMessage"


def depth_mm(frame: int) -> np.ndarray:
    """A wall, 1 mm deeper per column, 10 mm per frame, with a hole."""
    z = 1500 + np.arange(WIDTH)[None, :] + 10 * frame + np.zeros((HEIGHT, 1))
    z[0, 0] = 0
    return z.astype(np.uint16)


def colour(frame: int) -> np.ndarray:
    """RGB image (h, w, 3); every pixel differs."""
    rows, columns = np.mgrid[0:HEIGHT, 0:WIDTH]
    return np.stack([rows * 10, columns * 7, np.full_like(rows, 40 + frame)], -1).astype(np.uint8)


class Bag:
    """Writes messages of any of the three kinds of bag.

    Args:
        path: Without suffix.
        kind: "ros1", "ros2" (sqlite3) or "mcap".
    """

    def __init__(self, path: Path, kind: str) -> None:
        self.ros1 = kind == "ros1"
        self.store = get_typestore(Stores.ROS1_NOETIC if self.ros1 else Stores.ROS2_HUMBLE)
        if self.ros1:  # the package's own collection lacks it
            tf = get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TF)
            self.store.register(tf)
        self.types = self.store.types
        self.writer: Any
        if self.ros1:
            self.path = path.with_suffix(".bag")
            self.writer = Writer1(self.path)
        else:
            self.path = path
            plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
            self.writer = Writer2(path, version=8, storage_plugin=plugin)
        self.writer.open()
        self._connections: dict[str, Any] = {}

    def write(self, topic: str, message: Any, stamp_s: float) -> None:
        """One message."""
        kind = message.__msgtype__
        if topic not in self._connections:
            self._connections[topic] = self.writer.add_connection(topic, kind, typestore=self.store)
        serialize = self.store.serialize_ros1 if self.ros1 else self.store.serialize_cdr
        self.writer.write(self._connections[topic], round(stamp_s * 1e9), serialize(message, kind))

    def close(self) -> Path:
        """The finished bag."""
        self.writer.close()
        return self.path

    def header(self, stamp_s: float, frame: str) -> Any:
        """A header; ROS 1 counts them."""
        whole = int(stamp_s)
        stamp = self.types["builtin_interfaces/msg/Time"](
            sec=whole, nanosec=round((stamp_s - whole) * 1e9)
        )
        extra = {"seq": 0} if self.ros1 else {}
        return self.types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame, **extra)

    def image(self, stamp_s: float, frame: str, pixels: np.ndarray, encoding: str) -> Any:
        """A raw image, its rows padded by four bytes."""
        rows = np.ascontiguousarray(pixels).view(np.uint8).reshape(pixels.shape[0], -1)
        padded = np.pad(rows, ((0, 0), (0, 4)))
        return self.types["sensor_msgs/msg/Image"](
            header=self.header(stamp_s, frame),
            height=pixels.shape[0],
            width=pixels.shape[1],
            encoding=encoding,
            is_bigendian=0,
            step=padded.shape[1],
            data=padded.ravel(),
        )

    def compressed(self, stamp_s: float, frame: str, data: bytes, words: str) -> Any:
        """A compressed image."""
        return self.types["sensor_msgs/msg/CompressedImage"](
            header=self.header(stamp_s, frame), format=words, data=np.frombuffer(data, np.uint8)
        )

    def info(self, stamp_s: float, frame: str, model: str = "plumb_bob", **lists: Any) -> Any:
        """f = 30 px, the middle of the image as its centre; `d`, `k`, `p` may be given."""
        k = np.array([30.0, 0, 15.5, 0, 30.0, 11.5, 0, 0, 1])
        region = self.types["sensor_msgs/msg/RegionOfInterest"](
            x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
        )
        values = {"d": np.zeros(5), "k": k, "r": np.eye(3).ravel(), "p": np.zeros(12)}
        values |= {name: np.asarray(value, np.float64) for name, value in lists.items()}
        if self.ros1:
            values = {name.upper(): value for name, value in values.items()}
        return self.types["sensor_msgs/msg/CameraInfo"](
            header=self.header(stamp_s, frame),
            height=HEIGHT,
            width=WIDTH,
            distortion_model=model,
            binning_x=0,
            binning_y=0,
            roi=region,
            **values,
        )

    def transform(
        self, stamp_s: float, parent: str, child: str, xyz: tuple[float, float, float]
    ) -> Any:
        """A shift without a turn."""
        t = self.types["geometry_msgs/msg/Vector3"](x=xyz[0], y=xyz[1], z=xyz[2])
        q = self.types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0)
        one = self.types["geometry_msgs/msg/TransformStamped"](
            header=self.header(stamp_s, parent),
            child_frame_id=child,
            transform=self.types["geometry_msgs/msg/Transform"](translation=t, rotation=q),
        )
        return self.types[TF](transforms=[one])


def compressed_depth(pixels_mm: np.ndarray) -> bytes:
    """PNG of integer millimetres after its header of 12 bytes."""
    return struct.pack("<iff", 0, 0.0, 0.0) + cv2.imencode(".png", pixels_mm)[1].tobytes()


def compressed_metres(metres: np.ndarray, a: float = 100.0, b: float = 1.0) -> bytes:
    """PNG of inverse depth, value = A / depth + B, after its header."""
    units = np.where(metres > 0, np.rint(a / np.maximum(metres, 1e-3) + b), 0).astype(np.uint16)
    return struct.pack("<iff", 0, a, b) + cv2.imencode(".png", units)[1].tobytes()


def write_bag(path: Path, kind: str, frames: int = 5, colour_frame: str = "camera") -> Path:
    """Depth, colour and their cameras at 10 Hz; tf moves the camera 0.1 m along x per frame, with stamps in between."""
    bag = Bag(path, kind)
    bag.write("/tf_static", bag.transform(0.0, "base", "camera", (0.0, 0.0, 0.5)), 0.0)
    bag.write(
        "/tf_static", bag.transform(0.0, "camera", "colour_camera", (BASELINE_M, 0.0, 0.0)), 0.0
    )
    for i in range(frames):
        stamp = 10.0 + 0.1 * i
        for shift in (-0.05, 0.05):
            at = 0.1 * i + shift
            bag.write("/tf", bag.transform(stamp + shift, "map", "base", (at, 0.0, 0.0)), stamp)
        bag.write("/cam/depth/camera_info", bag.info(stamp, "camera"), stamp)
        bag.write("/cam/depth/image", bag.image(stamp, "camera", depth_mm(i), "16UC1"), stamp)
        bag.write("/cam/rgb/camera_info", bag.info(stamp, colour_frame), stamp)
        bag.write(
            "/cam/rgb/image", bag.image(stamp + 0.004, colour_frame, colour(i), "rgb8"), stamp
        )
    return bag.close()
