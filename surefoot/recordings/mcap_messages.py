"""Messages of a frame in MCAP: Foxglove's protobuf schemas where they exist, JSON for the rest.

A frame is a group of messages with the same log time and sequence number. It ends with a `/frame` message, which
names the topics of the group and contains what Foxglove's schemas lack (exact stamp, units, baseline).

Topics: `/tof/range`, `/tof/amplitude`, `/depth/image` (RawImage 16UC1), `/colour/image`, `/stereo/left`,
`/stereo/right` (CompressedImage), each camera's `calibration`, `/tf` (cameras on the body; the given pose
in the world), `/odometry`, `/imu`, `/joints`, `/feet`, `/frame`, and once at the start `/recording`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from google.protobuf.message import Message
from google.protobuf.timestamp_pb2 import Timestamp

from perception.primitives import safe_input
from perception.primitives.camera import Camera
from perception.primitives.frame import FeetReading, Imu, StepOdometry
from perception.primitives.landmark import Landmark
from perception.primitives.pose import Pose2, Pose3

from ..foxglove import calibration, frame_id, timestamp, transform
from .codec import EncodedAmplitude, EncodedDepth, EncodedFrame, EncodedPicture, EncodedStereo
from .own_body_json import joints_from_json, joints_to_json, own_body_from_json, own_body_to_json
from .recording import FrameError, RecordingInfo

FRAME_TOPIC = "/frame"
RECORDING_TOPIC = "/recording"
FORMAT = 3  # increases when older readers cannot read the new files: 2 has joint angles, 3 the feet
PROTOBUF_TOPICS: dict[str, type[Message]] = {
    "/tof/range": RawImage,
    "/tof/amplitude": RawImage,
    "/tof/calibration": CameraCalibration,
    "/depth/image": RawImage,
    "/depth/calibration": CameraCalibration,
    "/stereo/left": CompressedImage,
    "/stereo/right": CompressedImage,
    "/stereo/calibration": CameraCalibration,
    "/colour/image": CompressedImage,
    "/colour/calibration": CameraCalibration,
    "/tf": FrameTransforms,
}
_NUMBER = {"type": "number"}
_XYZ = {"type": "array", "items": _NUMBER, "minItems": 3, "maxItems": 3}
_FOOT = {
    "type": "object",
    "properties": dict.fromkeys(("x", "y", "z", "yaw"), _NUMBER) | {"lifted": {"type": "boolean"}},
}
JSON_TOPICS: dict[str, dict[str, object]] = {
    "/odometry": {
        "title": "surefoot.StepOdometry",
        "type": "object",
        "description": "Body pose in the body frame of the previous frame: m, rad; number of footsteps; rise of the body, m.",
        "properties": dict.fromkeys(("x", "y", "yaw", "steps", "rise"), _NUMBER),
    },
    "/imu": {
        "title": "surefoot.Imu",
        "type": "object",
        "description": "Means since the previous frame, body axes: rad/s, m/s^2.",
        "properties": {"angular_velocity": _XYZ, "specific_force": _XYZ},
    },
    "/joints": {
        "title": "surefoot.JointReading",
        "type": "object",
        "description": "Joint angles by the encoders, rad, and the base of their tree in the body frame: m, quaternion.",
        "properties": {
            "angles": {"type": "array", "items": _NUMBER},
            "translation": _XYZ,
            "quat_xyzw": {"type": "array", "items": _NUMBER, "minItems": 4, "maxItems": 4},
        },
    },
    "/feet": {
        "title": "surefoot.FeetReading",
        "type": "object",
        "description": "Soles by the encoders, body frame: x, y, height in m, yaw in rad, and whether the foot is in the air.",
        "properties": {"left": _FOOT, "right": _FOOT},
    },
    FRAME_TOPIC: {
        "title": "surefoot.Frame",
        "type": "object",
        "description": "Ends the group of one frame and names its topics; units are counts per metre (or per one).",
        "properties": {
            "stamp_s": _NUMBER,
            "footstep_due": {"type": "boolean"},
            "topics": {"type": "array", "items": {"type": "string"}},
            "units": {"type": "object", "additionalProperties": _NUMBER},
            "baseline_m": _NUMBER,
        },
    },
    RECORDING_TOPIC: {
        "title": "surefoot.Recording",
        "type": "object",
        "description": "Information about the recording.",
        "properties": {"name": {"type": "string"}, "landmarks": {"type": "array"}},
    },
}
_WORLD, _BODY = "world", "body"


def frame_messages(encoded: EncodedFrame) -> Iterator[tuple[str, Message | dict[str, Any]]]:
    """Topics and messages of one frame, `/frame` last."""
    stamp = timestamp(encoded.stamp_s)
    closing: dict[str, Any] = {
        "stamp_s": float(encoded.stamp_s),
        "footstep_due": bool(encoded.footstep_due),
        "units": {},
    }
    group: list[tuple[str, Message | dict[str, Any]]] = []
    for part, image, topic in (
        ("tof", encoded.tof, "/tof/range"),
        ("depth", encoded.depth, "/depth/image"),
    ):
        if image is not None:
            group.append((topic, _raw(image.units, part, stamp)))
            group.append((f"/{part}/calibration", calibration(image.camera, part, stamp)))
            closing["units"][topic] = float(image.units_per_metre)
    if encoded.amplitude is not None:
        group.append(("/tof/amplitude", _raw(encoded.amplitude.units, "tof", stamp)))
        closing["units"]["/tof/amplitude"] = float(encoded.amplitude.units_per_one)
    if encoded.stereo is not None:
        group.append(("/stereo/left", _compressed(encoded.stereo.left, "stereo", stamp)))
        group.append(("/stereo/right", _compressed(encoded.stereo.right, "stereo", stamp)))
        camera = encoded.stereo.left.camera
        group.append(("/stereo/calibration", calibration(camera, "stereo", stamp)))
        closing["baseline_m"] = float(encoded.stereo.baseline_m)
    if encoded.colour is not None:
        group.append(("/colour/image", _compressed(encoded.colour, "colour", stamp)))
        group.append(("/colour/calibration", calibration(encoded.colour.camera, "colour", stamp)))
    transforms = _transforms(encoded, stamp)
    if transforms.transforms:
        group.append(("/tf", transforms))
    if encoded.odometry is not None:
        odometry = encoded.odometry
        x, y, yaw = odometry.motion.vector.tolist()
        values = {"x": x, "y": y, "yaw": yaw, "steps": odometry.steps, "rise": odometry.rise_m}
        group.append(("/odometry", {name: float(value) for name, value in values.items()}))
    if encoded.imu is not None:
        group.append(("/imu", {k: v.tolist() for k, v in vars(encoded.imu).items()}))
    if encoded.joints is not None:
        group.append(("/joints", joints_to_json(encoded.joints)))
    if encoded.feet is not None:
        group.append(("/feet", _feet_to_json(encoded.feet)))
    closing["topics"] = [topic for topic, _ in group]
    yield from group
    yield FRAME_TOPIC, closing


def frame_from_messages(closing: Mapping[str, Any], data: Mapping[str, bytes]) -> EncodedFrame:
    """The frame of a complete group, from the payload of each topic.

    Raises:
        FrameError: A topic that `/frame` names is missing or cannot be parsed.
    """
    missing = [topic for topic in closing["topics"] if topic not in data]
    if missing:
        raise FrameError(f"without its {', '.join(missing)}")
    parts: dict[str, Any] = {}
    for topic in closing["topics"]:
        if topic in PROTOBUF_TOPICS:
            parts[topic] = PROTOBUF_TOPICS[topic].FromString(data[topic])
        else:
            parts[topic] = safe_input.json(data[topic])
    poses = {
        (t.parent_frame_id, t.child_frame_id): _pose(t)
        for t in (parts["/tf"].transforms if "/tf" in parts else ())
    }
    return EncodedFrame(
        stamp_s=closing["stamp_s"],
        tof=_depth(parts, poses, closing["units"], "tof", "/tof/range"),
        amplitude=_amplitude(parts, closing["units"]),
        depth=_depth(parts, poses, closing["units"], "depth", "/depth/image"),
        stereo=_stereo(parts, poses, closing.get("baseline_m")),
        colour=_picture(parts, poses, "colour", "/colour/image"),
        odometry=_odometry(parts.get("/odometry")),
        imu=_imu(parts.get("/imu")),
        T_world_camera=next((T for (parent, _), T in poses.items() if parent == _WORLD), None),
        footstep_due=closing["footstep_due"],
        joints=joints_from_json(parts.get("/joints")),
        feet=_feet(parts.get("/feet")),
    )


def info_to_json(info: RecordingInfo) -> dict[str, Any]:
    """Content of the `/recording` message."""
    return {
        "format": FORMAT,
        "name": info.name,
        "scene": info.scene,
        "poses_given": info.poses_given,
        "landmarks": [asdict(landmark) for landmark in info.landmarks],
        "start": None if info.start is None else asdict(info.start),
        "start_covariance": _list(info.start_covariance),
        "gravity_up_world": info.gravity_up_world,
        "floor_height_world_m": info.floor_height_world_m,
        "calibrated": info.calibrated,
        "levels": info.levels,
    } | ({} if info.own_body is None else {"own_body": own_body_to_json(info.own_body)})


def info_from_json(values: Mapping[str, Any], frames: int | None) -> RecordingInfo:
    """The inverse of `info_to_json`."""
    up = values["gravity_up_world"]
    return RecordingInfo(
        name=values["name"],
        kind="mcap",
        poses_given=values["poses_given"],
        frames=frames,
        landmarks=tuple(
            Landmark(mark["identity"], tuple(mark["position"]), mark["side_m"])
            for mark in values["landmarks"]
        ),
        start=None if values["start"] is None else Pose2(**values["start"]),
        start_covariance=_array(values["start_covariance"]),
        scene=values["scene"],
        gravity_up_world=None if up is None else (up[0], up[1], up[2]),
        floor_height_world_m=values["floor_height_world_m"],
        calibrated=values.get("calibrated", True),  # without the key: the simulated robot's
        own_body=own_body_from_json(values["own_body"]) if "own_body" in values else None,
        levels=bool(values.get("levels", False)),
    )


def _raw(units: np.ndarray, part: str, stamp: Timestamp) -> RawImage:
    height, width = units.shape
    data = units.astype("<u2", copy=False).tobytes()
    return RawImage(
        timestamp=stamp,
        frame_id=frame_id(part),
        width=width,
        height=height,
        encoding="16UC1",
        step=2 * width,
        data=data,
    )


def _compressed(picture: EncodedPicture, part: str, stamp: Timestamp) -> CompressedImage:
    return CompressedImage(
        timestamp=stamp, frame_id=frame_id(part), data=picture.data, format=picture.form
    )


def _transforms(encoded: EncodedFrame, stamp: Timestamp) -> FrameTransforms:
    stereo = None if encoded.stereo is None else encoded.stereo.left
    views = {
        "tof": encoded.tof,
        "depth": encoded.depth,
        "stereo": stereo,
        "colour": encoded.colour,
    }
    poses = [
        (_BODY, frame_id(part), view.T_body_camera)
        for part, view in views.items()
        if view is not None and view.T_body_camera is not None
    ]
    if encoded.T_world_camera is not None:
        on_body = encoded.depth is None or encoded.depth.T_body_camera is not None
        child = "given_camera" if on_body else frame_id("depth")  # a frame has one parent
        poses.append((_WORLD, child, encoded.T_world_camera))
    return FrameTransforms(transforms=[transform(*pose, stamp) for pose in poses])


def _pose(transform: FrameTransform) -> Pose3:
    t, q = transform.translation, transform.rotation
    return Pose3((t.x, t.y, t.z), (q.x, q.y, q.z, q.w))


def _camera(calibration: CameraCalibration) -> Camera:
    k, lens = calibration.K, tuple(calibration.D)
    return Camera(calibration.width, calibration.height, k[0], k[4], k[2], k[5], lens)


def _units(image: RawImage) -> np.ndarray:
    if image.encoding != "16UC1" or len(image.data) != 2 * image.width * image.height:
        raise FrameError(
            f"image of {image.width}x{image.height} px, {image.encoding}, has {len(image.data)} "
            "bytes; 16UC1 with 2 bytes per pixel was expected"
        )
    units = np.frombuffer(image.data, "<u2").reshape(image.height, image.width)
    return units.astype(np.uint16, copy=False)


def _depth(
    parts: Mapping[str, Any],
    poses: Mapping[tuple[str, str], Pose3],
    units: Mapping[str, float],
    part: str,
    topic: str,
) -> EncodedDepth | None:
    if topic not in parts:
        return None
    camera = _camera(parts[f"/{part}/calibration"])
    return EncodedDepth(
        _units(parts[topic]), _scale(units, topic), camera, poses.get((_BODY, frame_id(part)))
    )


def _amplitude(parts: Mapping[str, Any], units: Mapping[str, float]) -> EncodedAmplitude | None:
    topic = "/tof/amplitude"
    if topic not in parts:
        return None
    return EncodedAmplitude(_units(parts[topic]), _scale(units, topic))


def _scale(units: Mapping[str, float], topic: str) -> float:
    """Units per metre, or per one, of a topic."""
    if not (0.0 < units[topic] < math.inf):
        raise FrameError(f"{topic} has {units[topic]} units; a positive number was expected")
    return units[topic]


def _picture(
    parts: Mapping[str, Any], poses: Mapping[tuple[str, str], Pose3], part: str, topic: str
) -> EncodedPicture | None:
    if topic not in parts:
        return None
    image = parts[topic]
    return EncodedPicture(
        image.data,
        image.format,
        _camera(parts[f"/{part}/calibration"]),
        poses.get((_BODY, frame_id(part))),
    )


def _stereo(
    parts: Mapping[str, Any], poses: Mapping[tuple[str, str], Pose3], baseline_m: float | None
) -> EncodedStereo | None:
    left = _picture(parts, poses, "stereo", "/stereo/left")
    right = _picture(parts, poses, "stereo", "/stereo/right")
    if left is None or right is None or baseline_m is None:
        return None
    return EncodedStereo(left, right, baseline_m)


def _odometry(values: Mapping[str, float] | None) -> StepOdometry | None:
    if values is None:
        return None
    return StepOdometry(
        Pose2(values["x"], values["y"], values["yaw"]), values["steps"], values.get("rise", 0.0)
    )


def _imu(values: Mapping[str, list[float]] | None) -> Imu | None:
    if values is None:
        return None
    return Imu(np.array(values["angular_velocity"]), np.array(values["specific_force"]))


def _feet_to_json(feet: FeetReading) -> dict[str, dict[str, float | bool]]:
    pairs = zip((feet.left, feet.right), (feet.left_m, feet.right_m), feet.lifted, strict=True)
    return {
        side: {
            "x": float(pose.x),
            "y": float(pose.y),
            "z": float(height_m),
            "yaw": float(pose.yaw),
            "lifted": bool(lifted),
        }
        for side, (pose, height_m, lifted) in zip(("left", "right"), pairs, strict=True)
    }


def _feet(values: Mapping[str, Mapping[str, Any]] | None) -> FeetReading | None:
    if values is None:
        return None
    left, right = values["left"], values["right"]
    return FeetReading(
        Pose2(left["x"], left["y"], left["yaw"]),
        Pose2(right["x"], right["y"], right["yaw"]),
        left["z"],
        right["z"],
        (left["lifted"], right["lifted"]),
    )


def _list(array: np.ndarray | None) -> list[Any] | None:
    return None if array is None else array.tolist()


def _array(values: list[Any] | None) -> np.ndarray | None:
    return None if values is None else np.array(values, dtype=np.float64)
