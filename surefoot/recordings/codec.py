"""Encoding of frames for recordings.

Depth and range become 16-bit integers, colour images JPEG, stereo pairs PNG (JPEG at quality 95 would change 5 % of
the disparities by more than 0.37 px and save 40 % of the space; measured on the Middlebury motorcycle with noise of
2 grey levels). Stamps, poses, odometry and inertial measurements are stored without loss.

The pipeline always receives `decode(encode(frame))`, both live and from a recording. Encoding a decoded frame
again changes nothing but the JPEG images. Source: ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Float32, UInt8, UInt16

from perception.primitives import safe_input
from perception.primitives.camera import Camera
from perception.primitives.errors import InputError
from perception.primitives.frame import (
    LEAST_BASELINE_M,
    MOST_BASELINE_M,
    ColourView,
    DepthView,
    FeetReading,
    Frame,
    Imu,
    RangeView,
    StepOdometry,
    StereoView,
)
from perception.primitives.own_body import JointReading
from perception.primitives.pose import Pose3
from perception.primitives.safe_input import UnreadableError

from .recording import FrameError

RANGE_UNITS_PER_METRE = 2**14 / 5.0  # 0.31 mm: 14 bits over the 5 m of an SR4000; up to 20 m
DEPTH_UNITS_PER_METRE = 5000.0  # 0.2 mm: exact for TUM's unit and for millimetres; up to 13.1 m
LARGEST = 1e12  # of any number in a frame: s, m, rad; more is damage
FEET_M = 10.0  # of any number about the feet in the body frame; more is damage
NONE = 0  # value of pixels without depth
BACKGROUND_M = 1000.0  # ours: renderers write 1e10 or a far plane where there is no surface
_AMPLITUDE_NONE = 65535
_JPEG = [cv2.IMWRITE_JPEG_QUALITY, 92]
_JPEG += [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]


@dataclass(frozen=True, eq=False)
class EncodedDepth:
    """Depth or range in integer units; 0 without depth."""

    units: UInt16[np.ndarray, "h w"]
    units_per_metre: float
    camera: Camera
    T_body_camera: Pose3 | None = None


@dataclass(frozen=True, eq=False)
class EncodedAmplitude:
    """Amplitude in integer units, 65535 without amplitude; the scale is a power of two."""

    units: UInt16[np.ndarray, "h w"]
    units_per_one: float


@dataclass(frozen=True, eq=False)
class EncodedPicture:
    """A compressed image of a camera; `form` is "jpeg" or "png"."""

    data: bytes
    form: str
    camera: Camera
    T_body_camera: Pose3 | None = None


@dataclass(frozen=True, eq=False)
class EncodedStereo:
    """The rectified pair, compressed without loss."""

    left: EncodedPicture
    right: EncodedPicture
    baseline_m: float


@dataclass(frozen=True, eq=False)
class EncodedFrame:
    """An encoded frame; the parts are named as in `Frame`."""

    stamp_s: float
    tof: EncodedDepth | None = None
    amplitude: EncodedAmplitude | None = None
    depth: EncodedDepth | None = None
    stereo: EncodedStereo | None = None
    colour: EncodedPicture | None = None
    odometry: StepOdometry | None = None
    imu: Imu | None = None
    T_world_camera: Pose3 | None = None
    footstep_due: bool = False
    joints: JointReading | None = None
    feet: FeetReading | None = None


def encode(frame: Frame) -> EncodedFrame:
    """Encode a frame.

    Depth that exceeds 16 bits is dropped, negative amplitude becomes zero.

    Raises:
        InputError: A number is not finite, or an image has not the size of its camera.
    """
    fault = fault_of(frame)
    if fault is not None:
        raise InputError(f"frame at {frame.stamp_s} s: {fault}")
    tof, depth, stereo, colour = frame.tof, frame.depth, frame.stereo, frame.colour
    return EncodedFrame(
        frame.stamp_s,
        None if tof is None else _encode_depth(tof.range_m, RANGE_UNITS_PER_METRE, tof),
        None if tof is None or tof.amplitude is None else _encode_amplitude(tof.amplitude),
        None if depth is None else _encode_depth(depth.depth, DEPTH_UNITS_PER_METRE, depth),
        None if stereo is None else _encode_stereo(stereo),
        None if colour is None else _encode_colour(colour),
        frame.odometry,
        None if frame.imu is None else _exact(frame.imu),
        frame.T_world_camera,
        frame.footstep_due,
        frame.joints,
        frame.feet,
    )


def decode(encoded: EncodedFrame) -> Frame:
    """Decode a frame.

    Raises:
        FrameError: An image cannot be decoded or has not the size of its camera, or a number is not finite.
    """
    tof, depth, stereo, colour = encoded.tof, encoded.depth, encoded.stereo, encoded.colour
    frame = Frame(
        stamp_s=encoded.stamp_s,
        tof=None
        if tof is None
        else RangeView(
            metres(tof.units, tof.units_per_metre),
            None if encoded.amplitude is None else _decode_amplitude(encoded.amplitude),
            tof.camera,
            tof.T_body_camera,
        ),
        depth=None
        if depth is None
        else DepthView(
            metres(depth.units, depth.units_per_metre), depth.camera, depth.T_body_camera
        ),
        stereo=None if stereo is None else _decode_stereo(stereo),
        colour=None
        if colour is None
        else ColourView(_unpack(colour, colour_wanted=True), colour.camera, colour.T_body_camera),
        odometry=encoded.odometry,
        imu=encoded.imu,
        T_world_camera=encoded.T_world_camera,
        footstep_due=encoded.footstep_due,
        joints=encoded.joints,
        feet=encoded.feet,
    )
    fault = fault_of(frame)
    if fault is not None:
        raise FrameError(fault)
    return frame


def metres(
    units: UInt16[np.ndarray, "h w"], units_per_metre: float, none: tuple[int, ...] = (NONE,)
) -> Float32[np.ndarray, "h w"]:
    """Depth from integer units, m; NaN without depth. All readers use this formula."""
    depth = (units / np.float64(units_per_metre)).astype(np.float32)
    for mark in none:
        depth[units == mark] = np.nan
    return depth


def metres_of_floats(depth: Float[np.ndarray, "h w"]) -> Float32[np.ndarray, "h w"]:
    """Depth of floats, m; NaN for what is not positive, or as far as the background of a renderer."""
    with np.errstate(invalid="ignore", over="ignore"):
        good = (depth > 0.0) & (depth < BACKGROUND_M)
    return np.where(good, depth, np.nan).astype(np.float32)


def _encode_depth(
    depth: Float32[np.ndarray, "h w"], units_per_metre: float, view: RangeView | DepthView
) -> EncodedDepth:
    scaled = np.rint(depth * np.float64(units_per_metre))
    with np.errstate(invalid="ignore"):
        units = np.where((scaled > NONE) & (scaled <= 65535), scaled, NONE).astype(np.uint16)
    return EncodedDepth(units, units_per_metre, view.camera, view.T_body_camera)


def _encode_amplitude(amplitude: Float32[np.ndarray, "h w"]) -> EncodedAmplitude:
    """Encode with the largest power of two that fits, so that encoding again changes nothing."""
    known = np.isfinite(amplitude)
    values = np.where(known, np.maximum(amplitude, 0), 0).astype(np.float64)
    greatest = float(values.max(initial=0.0))
    power = 0
    if greatest > 0.0:
        power = math.floor(math.log2(65534.0 / greatest))
        while round(math.ldexp(greatest, power + 1)) < _AMPLITUDE_NONE:
            power += 1
        while round(math.ldexp(greatest, power)) >= _AMPLITUDE_NONE:
            power -= 1
    units_per_one = math.ldexp(1.0, power)
    units = np.where(known, np.rint(values * units_per_one), _AMPLITUDE_NONE).astype(np.uint16)
    return EncodedAmplitude(units, units_per_one)


def _decode_amplitude(encoded: EncodedAmplitude) -> Float32[np.ndarray, "h w"]:
    amplitude = (encoded.units / np.float64(encoded.units_per_one)).astype(np.float32)
    amplitude[encoded.units == _AMPLITUDE_NONE] = np.nan
    return amplitude


def _encode_colour(view: ColourView) -> EncodedPicture:
    data = cv2.imencode(".jpg", cv2.cvtColor(view.rgb, cv2.COLOR_RGB2BGR), _JPEG)[1]
    return EncodedPicture(data.tobytes(), "jpeg", view.camera, view.T_body_camera)


def _exact(imu: Imu) -> Imu:
    return Imu(imu.angular_velocity.astype(np.float64), imu.specific_force.astype(np.float64))


def _encode_stereo(view: StereoView) -> EncodedStereo:
    left, right = (
        EncodedPicture(
            cv2.imencode(".png", image)[1].tobytes(), "png", view.camera, view.T_body_camera
        )
        for image in (view.left, view.right)
    )
    return EncodedStereo(left, right, view.baseline_m)


def _decode_stereo(encoded: EncodedStereo) -> StereoView:
    return StereoView(
        _unpack(encoded.left, colour_wanted=False),
        _unpack(encoded.right, colour_wanted=False),
        encoded.baseline_m,
        encoded.left.camera,
        encoded.left.T_body_camera,
    )


def _unpack(picture: EncodedPicture, colour_wanted: bool) -> UInt8[np.ndarray, "..."]:
    flag = cv2.IMREAD_COLOR if colour_wanted else cv2.IMREAD_GRAYSCALE
    try:
        image = safe_input.picture(picture.data, flag)
    except UnreadableError as error:
        raise FrameError(
            f"recorded {picture.form} image of {len(picture.data)} bytes {error}"
        ) from error
    return cv2.cvtColor(image, cv2.COLOR_BGR2RGB) if colour_wanted else image


def fault_of(frame: Frame) -> str | None:
    """What is impossible in a frame; None if nothing is."""
    values: dict[str, tuple[float, ...]] = {"stamp_s": (frame.stamp_s,)}
    if frame.odometry is not None:
        motion = frame.odometry.motion
        values["odometry"] = (*motion.vector, frame.odometry.steps, frame.odometry.rise_m)
    if frame.imu is not None:
        values["imu"] = (*frame.imu.angular_velocity, *frame.imu.specific_force)
        if len(values["imu"]) != 6:
            return f"imu has {len(values['imu'])} numbers; 6 were expected"
    if frame.stereo is not None:
        baseline = frame.stereo.baseline_m
        if not LEAST_BASELINE_M <= baseline <= MOST_BASELINE_M:
            return f"baseline is {baseline:g} m; {LEAST_BASELINE_M:g} to {MOST_BASELINE_M:g} m were expected"
    if frame.feet is not None:
        feet = frame.feet
        values["feet"] = (*feet.left.vector, *feet.right.vector, feet.left_m, feet.right_m)
        if not all(abs(number) < FEET_M for number in values["feet"]):
            return f"feet is {values['feet']}; feet within {FEET_M:.0f} m of the body were expected"
    poses = {"T_world_camera": frame.T_world_camera}
    if frame.joints is not None:
        values["joints"] = frame.joints.angles
        poses["joints.T_body_base"] = frame.joints.T_body_base
    for name in ("tof", "depth", "stereo", "colour"):
        view = getattr(frame, name)
        if view is None:
            continue
        poses[f"{name}.T_body_camera"] = view.T_body_camera
        size = (view.camera.height, view.camera.width)
        for part in ("range_m", "amplitude", "depth", "left", "right", "rgb"):
            image = getattr(view, part, None)
            if image is not None and image.shape[:2] != size:
                return f"{name}.{part} is {image.shape[1]}x{image.shape[0]} px; its camera is {size[1]}x{size[0]} px"
    for name, pose in poses.items():
        if pose is not None:
            values[name] = (*pose.translation, *pose.quat_xyzw)
            if not math.isclose(math.hypot(*pose.quat_xyzw), 1.0, abs_tol=1e-3):
                return f"{name} has the quaternion {pose.quat_xyzw}; one of length 1 was expected"
    for name, numbers in values.items():
        if not all(abs(number) < LARGEST for number in numbers):
            return f"{name} is {numbers}; finite numbers below {LARGEST:.0e} were expected"
    return None
