"""One instant of the sensors, from a robot or a recording.

A sensor that the robot does not have is None. The type defines the meaning of an image: depth along the optical axis
(`DepthView`), range along the ray (`RangeView`), a stereo pair (`StereoView`), colour (`ColourView`). Perception
converts each of the first three to `Depth`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, UInt8

from .camera import Camera
from .own_body import JointReading
from .pose import Pose2, Pose3


@dataclass(frozen=True)
class DepthView:
    """Depth along the optical axis, m, NaN where there is none (RGB-D cameras).

    `T_body_camera` is the pose of the camera on the body by joint angles; None for a handheld camera.
    """

    depth: Float32[np.ndarray, "h w"]
    camera: Camera
    T_body_camera: Pose3 | None = None


@dataclass(frozen=True)
class RangeView:
    """Range along the ray, m, NaN where there is none, and the amplitude of the return (TOF cameras).

    Amplitude 1 is that of a white target 2 m straight ahead.
    """

    range_m: Float32[np.ndarray, "h w"]
    amplitude: Float32[np.ndarray, "h w"] | None
    camera: Camera
    T_body_camera: Pose3 | None = None


LEAST_BASELINE_M, MOST_BASELINE_M = 1e-3, 5.0
"""Of a stereo pair, ours: others were calibrated in mm or in squares of the board."""


@dataclass(frozen=True)
class StereoView:
    """A grey stereo pair; `camera` is the left one, the right one is `baseline_m` to its right.

    The cameras are parallel and equal. If `camera` has distortion, both images have it; `rectification.rectified`
    removes it.
    """

    left: UInt8[np.ndarray, "h w"]
    right: UInt8[np.ndarray, "h w"]
    baseline_m: float
    camera: Camera
    T_body_camera: Pose3 | None = None


@dataclass(frozen=True)
class ColourView:
    """A colour image in the order red, green, blue."""

    rgb: UInt8[np.ndarray, "h w 3"]
    camera: Camera
    T_body_camera: Pose3 | None = None


@dataclass(frozen=True)
class Depth:
    """Depth with its standard deviation, from any depth sensor.

    Args:
        z: Along the optical axis, m, NaN where there is none.
        sigma: Standard deviation of z, m, NaN where there is none.
        camera: Intrinsics.
        T_body_camera: Pose of the camera on the body; None for a handheld camera.
        baseline_m: Of a stereo pair, 0 for one camera; fx baseline / z pixels at the left border, which the right
            image does not show, have no depth.
        amplitude: Of the return of a time-of-flight camera; None otherwise.
    """

    z: Float32[np.ndarray, "h w"]
    sigma: Float32[np.ndarray, "h w"]
    camera: Camera
    T_body_camera: Pose3 | None = None
    baseline_m: float = 0.0
    amplitude: Float32[np.ndarray, "h w"] | None = None


@dataclass(frozen=True)
class StepOdometry:
    """Motion of the body since the previous frame, by joint angles.

    Args:
        motion: Body frame now in the previous body frame, by joint angles and stance foot.
        steps: Footsteps made (0.5: half a step); slip grows with them.
        rise_m: Height of the body frame, midway between the feet, above the previous one.
    """

    motion: Pose2
    steps: float
    rise_m: float = 0.0


@dataclass(frozen=True)
class Imu:
    """Mean of the inertial sensor over the time since the previous frame, body axes.

    Args:
        angular_velocity: (3,), rad/s.
        specific_force: (3,), m/s^2; (0, 0, +9.81) at rest.
    """

    angular_velocity: Float[np.ndarray, "3"]
    specific_force: Float[np.ndarray, "3"]


@dataclass(frozen=True)
class FeetReading:
    """Soles of the feet by the joint encoders, body frame.

    The body frame is midway between the feet, on the ground; on two levels, between them.

    Args:
        left, right: Middle and heading of a level sole.
        left_m, right_m: Its height, m.
        lifted: Whether the left and the right foot are in the air.
    """

    left: Pose2
    right: Pose2
    left_m: float = 0.0
    right_m: float = 0.0
    lifted: tuple[bool, bool] = (False, False)

    def sole(self, foot: int) -> Pose3:
        """The sole of a foot, 1 the left, -1 the right, body frame."""
        pose, height_m = (self.left, self.left_m) if foot > 0 else (self.right, self.right_m)
        return Pose3((pose.x, pose.y, height_m), pose.lifted().quat_xyzw)


@dataclass(frozen=True)
class Frame:
    """Measurements of all sensors at one instant.

    Args:
        stamp_s: Time, s, by the clock of the recording.
        tof, depth, stereo, colour: Images; None without such a camera, or without an image at this instant.
        odometry: Motion since the previous frame; None without step odometry.
        imu: Inertial sensor; None without one.
        T_world_camera: Pose of the depth camera given by the recording (motion capture, another SLAM system);
            None in a live run.
        footstep_due: Whether the gait needs its next walk command at this instant.
        joints: Angles of all joints; None where the robot's own body is not known.
        feet: Where the feet are; None where that is not known.
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
    joints: JointReading | None = None
    feet: FeetReading | None = None
