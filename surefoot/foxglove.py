"""Parts of Foxglove's messages that recordings and estimates share."""

from __future__ import annotations

from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from google.protobuf.timestamp_pb2 import Timestamp

from perception.primitives.camera import Camera
from perception.primitives.pose import Pose3

from .mcap_file import nanoseconds

MAP, BODY = "map", "body"
"""Names of frames."""


def timestamp(stamp_s: float) -> Timestamp:
    """A stamp as a protobuf message."""
    seconds, rest = divmod(nanoseconds(stamp_s), 10**9)
    return Timestamp(seconds=seconds, nanos=rest)


def frame_id(sensor: str) -> str:
    """Name of the frame of a camera."""
    return f"{sensor}_camera"


def transform(parent: str, child: str, pose: Pose3, stamp: Timestamp) -> FrameTransform:
    """The pose of a frame in its parent."""
    message = FrameTransform(timestamp=stamp, parent_frame_id=parent, child_frame_id=child)
    for name, value in zip("xyz", pose.translation, strict=True):
        setattr(message.translation, name, value)
    for name, value in zip("xyzw", pose.quat_xyzw, strict=True):
        setattr(message.rotation, name, value)
    return message


def calibration(camera: Camera, sensor: str, stamp: Timestamp) -> CameraCalibration:
    """The intrinsics of a camera."""
    fx, fy, cx, cy = camera.fx, camera.fy, camera.cx, camera.cy
    return CameraCalibration(
        timestamp=stamp,
        frame_id=frame_id(sensor),
        width=camera.width,
        height=camera.height,
        distortion_model="plumb_bob" if len(camera.distortion) == 5 else "rational_polynomial",
        D=list(camera.distortion),
        K=[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        R=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        P=[fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
    )
