"""Messages of a moment: Foxglove's schemas for what viewers draw, one JSON message for every number.

A moment is a group of messages with the same log time and sequence number, `/estimate/moment` last. Reading restores
every field: numbers to the bit, transforms of cameras to rounding.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Grid_pb2 import Grid
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.Odometry_pb2 import Odometry
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from google.protobuf.message import Message
from google.protobuf.timestamp_pb2 import Timestamp

from mapping.ground.surface import Border
from mapping.objects.footprints import Footprint
from perception.primitives import safe_input
from perception.primitives.camera import Camera
from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import Obstacle
from perception.primitives.pose import Pose2, Pose3
from planning.gaze.selection import DirectionMap

from ..foxglove import BODY, MAP, calibration, frame_id, timestamp, transform
from .footprint_entries import footprint_entry, footprint_of
from .moment import FloorSeen, Layers, Moment, Prediction, SurfaceSeen

MOMENT, FOOTPRINTS = "/estimate/moment", "/estimate/footprints"
GRID, COLOUR, DEPTH, GAZE = "/estimate/grid", "/estimate/colour", "/estimate/depth", "/plan/gaze"
READ = (MOMENT, FOOTPRINTS, GRID, COLOUR, DEPTH, GAZE)
"""Topics that `moment_from_messages` reads; the others repeat their content for viewers."""

JSON_TOPICS: dict[str, dict[str, object]] = {
    MOMENT: {
        "title": "surefoot.Moment",
        "type": "object",
        "description": "Every number of one moment; m, rad, s, world frame. docs/outputs.md lists the keys.",
        "properties": {"stamp_s": {"type": "number"}, "why": {"type": "string"}},
    },
    FOOTPRINTS: {
        "title": "surefoot.Footprints",
        "type": "object",
        "description": "Ground of the static obstacles, as in obstacles.json; once, with the last moment.",
        "properties": {"footprints": {"type": "array"}},
    },
}
_LAYERS = np.dtype([("probability", "u1"), ("confidence", "u1"), ("height_m", "<f4")])
_FIELDS = {
    "probability": (0, PackedElementField.UINT8),
    "confidence": (1, PackedElementField.UINT8),
    "height_m": (2, PackedElementField.FLOAT32),
}  # of a cell of 6 bytes: where each begins
_SCALARS = ("radius_m", "height_m", "moving", "seen_s", "since_s")  # of an obstacle
_PLANAR = np.ix_((0, 1, 5), (0, 1, 5))  # x, y, yaw among x, y, z, roll, pitch, yaw


def moment_to_messages(moment: Moment) -> Iterator[tuple[str, Message | dict[str, Any]]]:
    """Topics and messages of one moment, `/estimate/moment` last."""
    stamp = timestamp(moment.stamp_s)
    transforms = _transforms(moment, stamp)
    if transforms.transforms:
        yield "/estimate/tf", transforms
    if moment.pose is not None:
        yield "/estimate/odometry", _odometry(moment.pose, stamp)
    if moment.head is not None:
        yield "/head/joints", _joints(moment.head, stamp)
    if moment.grid is not None:
        yield GRID, _grid(moment.grid, stamp)
    if moment.colour is not None:
        yield COLOUR, _colour(moment, stamp)
    if moment.depth is not None:
        yield DEPTH, _depth(moment, stamp)
        if moment.depth_sensor in moment.lenses:
            lens = _thinned(moment.lenses[moment.depth_sensor], moment.depth.shape)
            yield f"{DEPTH}/calibration", calibration(lens, moment.depth_sensor, stamp)
    if moment.gaze_map is not None:
        yield GAZE, _gaze(moment.gaze_map, stamp)
    if moment.why:
        yield "/plan/why", Log(timestamp=stamp, level=Log.INFO, message=moment.why, name="planner")
    yield MOMENT, _numbers_of(moment)


def moment_from_messages(data: Mapping[str, bytes]) -> Moment:
    """The moment of a complete group, from the payload of each topic."""
    values = safe_input.json(data[MOMENT])
    picture = {}
    if DEPTH in data:
        image = RawImage.FromString(data[DEPTH])
        depth_m = np.frombuffer(image.data, "<f4").reshape(image.height, image.width)
        step_m = values["depth_step_m"]
        picture = {
            "depth": np.rint(depth_m / step_m).astype(np.uint8),
            "depth_step_m": step_m,
            "depth_sensor": values["depth_sensor"],
        }
    return Moment(
        stamp_s=values["stamp_s"],
        pose=_gaussian(values["pose"]),
        cameras={
            name: Pose3(tuple(one["translation"]), tuple(one["quat_xyzw"]))
            for name, one in values["cameras"].items()
        },
        lenses={name: _camera(*one) for name, one in values["lenses"].items()},
        head=_pair(values["head"]),
        feet=_array(values["feet"]),
        heights_m=_array(values.get("heights_m")),
        height_sigma_m=values.get("height_sigma_m"),
        steps=np.array(values["steps"], np.float64).reshape(-1, 3),
        route=np.array(values["route"], np.float64).reshape(-1, 2),
        goal=_array(values["goal"]),
        gaze=_pair(values["gaze"]),
        gaze_map=_gaze_map(data.get(GAZE), values),
        why=values["why"],
        status=tuple(values.get("status", ())),
        risk=values["risk"],
        floor={name: _floor(one) for name, one in values["floor"].items()},
        grid=_layers(data.get(GRID)),
        surfaces=_surfaces(values.get("surfaces")),
        tracks=tuple(_obstacle(one) for one in values["tracks"]),
        predictions=tuple(
            tuple(_prediction(one) for one in each["predictions"]) for each in values["tracks"]
        ),
        footprints=None,
        timing_ms=values["timing_ms"],
        colour=CompressedImage.FromString(data[COLOUR]).data if COLOUR in data else None,
        colour_sensor=values["colour_sensor"],
        **picture,
    )


def footprints_message(footprints: Sequence[Footprint]) -> dict[str, Any]:
    """Content of `/estimate/footprints`."""
    return {"footprints": [footprint_entry(one) for one in footprints]}


def footprints_of(data: bytes) -> tuple[Footprint, ...]:
    """The footprints of a message."""
    return tuple(footprint_of(entry) for entry in safe_input.json(data)["footprints"])


def _numbers_of(moment: Moment) -> dict[str, Any]:
    """Content of `/estimate/moment`; what is not finite is null."""
    predictions = moment.predictions or ((),) * len(moment.tracks)
    gaze = moment.gaze_map
    return {
        "stamp_s": float(moment.stamp_s),
        "pose": None if moment.pose is None else _state(moment.pose),
        "cameras": {
            name: {"translation": list(pose.translation), "quat_xyzw": list(pose.quat_xyzw)}
            for name, pose in moment.cameras.items()
        },
        "lenses": {name: _lens(one) for name, one in moment.lenses.items()},
        "head": _list(moment.head),
        "feet": _list(moment.feet),
        "heights_m": _list(moment.heights_m),
        "height_sigma_m": moment.height_sigma_m,
        "steps": _list(moment.steps),
        "route": _list(moment.route),
        "goal": _list(moment.goal),
        "gaze": _list(moment.gaze),
        "gaze_pans": None if gaze is None else _list(gaze.pans),
        "gaze_tilts": None if gaze is None else _list(gaze.tilts),
        "why": moment.why,
        "status": list(moment.status),
        "risk": moment.risk,
        "floor": {
            name: {
                "normal": _list(one.normal),
                "height_m": one.height_m,
                "covariance": _list(one.covariance),
                "share": one.share,
            }
            for name, one in moment.floor.items()
        },
        "surfaces": None
        if moment.surfaces is None
        else [
            {
                "corners": _list(one.corners),
                "borders": [Border(b).name.lower() for b in one.borders],
            }
            for one in moment.surfaces
        ],
        "tracks": [_track(one, each) for one, each in zip(moment.tracks, predictions, strict=True)],
        "timing_ms": moment.timing_ms,
        "colour_sensor": moment.colour_sensor,
        "depth_step_m": moment.depth_step_m,
        "depth_sensor": moment.depth_sensor,
    }


def _track(one: Obstacle, predictions: Sequence[Prediction]) -> dict[str, Any]:
    return {
        "track": one.track,
        **_state(one.state),
        **{name: _list(getattr(one, name)) for name in _SCALARS},
        "modes": None if one.motion is None else one.motion.named,
        "predictions": [
            {
                "seconds": each.seconds,
                "weight": each.weight,
                "mean": _list(each.mean),
                "covariance": _list(each.covariance),
            }
            for each in predictions
        ],
    }


def _surfaces(values: Sequence[Mapping[str, Any]] | None) -> tuple[SurfaceSeen, ...] | None:
    if values is None:
        return None
    return tuple(
        SurfaceSeen(
            np.array(one["corners"], np.float64).reshape(-1, 3),
            np.array([Border[name.upper()] for name in one["borders"]], int),
        )
        for one in values
    )


def _obstacle(one: Mapping[str, Any]) -> Obstacle:
    state = _gaussian(one)
    assert state is not None
    scalars = {k: math.nan if one[k] is None else one[k] for k in _SCALARS}
    return Obstacle(state, track=one["track"], motion=None, **scalars)


def _prediction(one: Mapping[str, Any]) -> Prediction:
    mean, covariance = (np.array(one[k], np.float64) for k in ("mean", "covariance"))
    return Prediction(one["seconds"], one["weight"], mean, covariance)


def _floor(one: Mapping[str, Any]) -> FloorSeen:
    normal, covariance = (np.array(one[k], np.float64) for k in ("normal", "covariance"))
    return FloorSeen(normal, one["height_m"], covariance, one["share"])


def _state(gaussian: Gaussian) -> dict[str, Any]:
    return {"mean": _list(gaussian.mean), "covariance": _list(gaussian.covariance)}


def _gaussian(values: Mapping[str, Any] | None) -> Gaussian | None:
    if values is None:
        return None
    return Gaussian(*(np.array(values[k], np.float64) for k in ("mean", "covariance")))


def _list(values: Any) -> Any:
    """As lists; None stays, and stands for what is not finite."""
    if values is None:
        return None
    array = np.asarray(values, np.float64)
    if not np.isfinite(array).all():
        array = array.astype(object)
        array[~np.isfinite(np.asarray(values, np.float64))] = None
    return array.tolist()


def _array(values: Any) -> np.ndarray | None:
    return None if values is None else np.array(values, np.float64)


def _pair(values: Any) -> tuple[float, float] | None:
    return None if values is None else (values[0], values[1])


def _camera(
    width: int, height: int, fx: float, fy: float, cx: float, cy: float, distortion: list[float]
) -> Camera:
    return Camera(width, height, fx, fy, cx, cy, tuple(distortion))


def _lens(camera: Camera) -> list[Any]:
    flat = [camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy]
    return [*flat, list(camera.distortion)]


def _transforms(moment: Moment, stamp: Timestamp) -> FrameTransforms:
    """map to body, and body to each camera; without a pose of the body map to each camera."""
    poses, T_parent_map, parent = [], Pose3(), MAP
    if moment.pose is not None:
        T_map_body = Pose2(*moment.pose.mean.tolist()).lifted()
        poses.append((MAP, BODY, T_map_body))
        T_parent_map, parent = T_map_body.inverse(), BODY
    for name, pose in moment.cameras.items():
        poses.append((parent, frame_id(name), T_parent_map @ pose))
    return FrameTransforms(transforms=[transform(*one, stamp) for one in poses])


def _odometry(pose: Gaussian, stamp: Timestamp) -> Odometry:
    x, y, yaw = pose.mean.tolist()
    message = Odometry(timestamp=stamp, frame_id=MAP, body_frame_id=BODY)
    message.pose.position.x, message.pose.position.y = x, y
    message.pose.orientation.z = math.sin(yaw / 2)
    message.pose.orientation.w = math.cos(yaw / 2)
    covariance = np.zeros((6, 6))
    covariance[_PLANAR] = pose.covariance
    message.pose_covariance.extend(covariance.ravel().tolist())
    return message


def _joints(head: tuple[float, float], stamp: Timestamp) -> JointStates:
    message = JointStates(timestamp=stamp)
    for name, position in zip(("pan", "tilt"), head, strict=True):
        message.joints.add(name=name, position=position)
    return message


def _grid(layers: Layers, stamp: Timestamp) -> Grid:
    rows, columns = layers.probability.shape
    cells = np.empty((rows, columns), _LAYERS)
    for name in _FIELDS:
        cells[name] = getattr(layers, name)
    message = Grid(
        timestamp=stamp,
        frame_id=MAP,
        column_count=columns,
        cell_stride=_LAYERS.itemsize,
        row_stride=_LAYERS.itemsize * columns,
        data=cells.tobytes(),
    )
    message.cell_size.x = message.cell_size.y = layers.cell_m
    message.pose.position.x, message.pose.position.y = layers.origin.tolist()
    message.pose.orientation.w = 1.0
    for name, (offset, kind) in _FIELDS.items():
        message.fields.add(name=name, offset=offset, type=kind)
    return message


def _layers(data: bytes | None) -> Layers | None:
    if data is None:
        return None
    message = Grid.FromString(data)
    cells = np.frombuffer(message.data, _LAYERS).reshape(-1, message.column_count)
    origin = np.array([message.pose.position.x, message.pose.position.y])
    parts = (np.ascontiguousarray(cells[name]) for name in _FIELDS)
    return Layers(origin, message.cell_size.x, *parts)


def _gaze(gaze: DirectionMap, stamp: Timestamp) -> RawImage:
    """As a picture: up is up, and the left of the robot at the left."""
    picture = np.rint(255.0 * gaze.values.T[:, ::-1]).astype(np.uint8)
    height, width = picture.shape
    return RawImage(
        timestamp=stamp,
        width=width,
        height=height,
        encoding="mono8",
        step=width,
        data=picture.tobytes(),
    )


def _gaze_map(data: bytes | None, values: Mapping[str, Any]) -> DirectionMap | None:
    if data is None:
        return None
    message = RawImage.FromString(data)
    picture = np.frombuffer(message.data, np.uint8).reshape(message.height, message.width)
    pans, tilts = (np.array(values[f"gaze_{k}"], np.float64) for k in ("pans", "tilts"))
    return DirectionMap(picture[:, ::-1].T / 255.0, pans, tilts)


def _colour(moment: Moment, stamp: Timestamp) -> CompressedImage:
    assert moment.colour is not None
    camera = frame_id(moment.colour_sensor)
    return CompressedImage(timestamp=stamp, frame_id=camera, data=moment.colour, format="jpeg")


def _depth(moment: Moment, stamp: Timestamp) -> RawImage:
    assert moment.depth is not None
    height, width = moment.depth.shape
    depth_m = moment.depth * np.float32(moment.depth_step_m)
    return RawImage(
        timestamp=stamp,
        frame_id=frame_id(moment.depth_sensor),
        width=width,
        height=height,
        encoding="32FC1",
        step=4 * width,
        data=depth_m.astype("<f4").tobytes(),
    )


def _thinned(camera: Camera, shape: tuple[int, ...]) -> Camera:
    """The camera of a picture of every n-th pixel."""
    every = -(-camera.width // shape[1])
    fx, fy, cx, cy = (v / every for v in (camera.fx, camera.fy, camera.cx, camera.cy))
    return Camera(shape[1], shape[0], fx, fy, cx, cy, camera.distortion)
