"""One instant of the sensors, as it comes from a body or out of a recording.

A part that the body does not have is None. What the images mean is told by the type, never by a
convention: z along the optical axis (`DepthView`), range along the ray (`RangeView`), a rectified pair
(`StereoView`), colour (`ColourView`). `Depth` is what perception makes of any of the first three.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, UInt8

from .camera import Camera
from .pose import Pose2, Pose3


@dataclass(frozen=True)
class DepthView:
    """Depth along the optical axis, m, NaN where there is none (RGB-D cameras).

    `T_body_camera` is the camera on the body by its joint angles; None for a camera in the hand.
    """

    depth: Float32[np.ndarray, "h w"]
    camera: Camera
    T_body_camera: Pose3 | None = None


@dataclass(frozen=True)
class RangeView:
    """Range along the ray, m, NaN where there is none, and the amplitude of the return (TOF cameras)."""

    range_m: Float32[np.ndarray, "h w"]
    amplitude: Float32[np.ndarray, "h w"] | None
    camera: Camera
    T_body_camera: Pose3 | None = None


@dataclass(frozen=True)
class StereoView:
    """A rectified grey pair; the camera is the left one, the right one `baseline_m` to its right.

    A camera with distortion says that both are still as two parallel, equal lenses drew them; see
    `rectification.straightened`.
    """

    left: UInt8[np.ndarray, "h w"]
    right: UInt8[np.ndarray, "h w"]
    baseline_m: float
    camera: Camera
    T_body_camera: Pose3 | None = None


@dataclass(frozen=True)
class ColourView:
    """A colour image, red first."""

    rgb: UInt8[np.ndarray, "h w 3"]
    camera: Camera
    T_body_camera: Pose3 | None = None


@dataclass(frozen=True)
class Depth:
    """Depth with its uncertainty: what every depth sensor becomes.

    Args:
        z: Along the optical axis, m, NaN where there is none.
        sigma: Deviation of z, m, NaN where there is none.
        camera: Intrinsics.
        T_body_camera: Camera on the body; None for a camera in the hand.
        baseline_m: Of a pair; what the right image does not show, fx baseline / z pixels from the left border on,
            has no depth. 0: one camera.
    """

    z: Float32[np.ndarray, "h w"]
    sigma: Float32[np.ndarray, "h w"]
    camera: Camera
    T_body_camera: Pose3 | None = None
    baseline_m: float = 0.0


@dataclass(frozen=True)
class StepOdometry:
    """How the body believes it moved since the frame before.

    Args:
        motion: Body frame now, in the body frame of the frame before, from joint angles and stance foot.
        steps: How much of a footstep this was (0.5: half a step); slip grows with it.
    """

    motion: Pose2
    steps: float


@dataclass(frozen=True)
class Imu:
    """Mean of the inertial sensor over the time since the frame before, body axes.

    Args:
        angular_velocity: (3,), rad/s.
        specific_force: (3,), m/s^2; (0, 0, +9.81) at rest.
    """

    angular_velocity: Float[np.ndarray, "3"]
    specific_force: Float[np.ndarray, "3"]


@dataclass(frozen=True)
class Frame:
    """Everything the sensors say at one instant.

    Args:
        stamp_s: Time of the instant, s, in the recording's own clock.
        tof, depth, stereo, colour: The views, None where the body has no such camera or it rested.
        odometry: Motion since the frame before; None if the body has no legs or no memory of them.
        imu: Inertial sensor.
        T_world_camera: Pose of the depth camera as *given by the recording* (motion capture, another
            SLAM system); None in a live run, always.
        footstep_due: Whether the gait asks for its next walk command at this instant.
    """

    stamp_s: float
    tof: RangeView | None = None
    depth: DepthView | None = None
    stereo: StereoView | None = None
    colour: ColourView | None = None
    odometry: StepOdometry | None = None
    imu: Imu | None = None
    T_world_camera: Pose3 | None = None
    footstep_due: bool = False
