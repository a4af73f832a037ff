"""The description of a robot: what its URDF does not say. `catalogue` reads it from a TOML file of a few dozen lines."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from perception.primitives.errors import InputError
from perception.primitives.robot_model import RobotModel

from . import installed

AXES = ("x", "z", "body")
SENSORS = ("tof", "depth", "stereo", "colour")


@dataclass(frozen=True)
class Legs:
    """Joints and soles.

    Args:
        left, right: Six joints each, from the hip down.
        feet: Links of the URDF that are the left and the right foot; level with all joints of the legs at zero.
        sole_m: The point of the left sole that a footstep places, from the origin of its link, in axes ahead, left and up
            of the level foot; mirrored for the right one.
        sole_size_m: Length and width of a sole.
    """

    left: tuple[str, ...]
    right: tuple[str, ...]
    feet: tuple[str, str]
    sole_m: tuple[float, float, float]
    sole_size_m: tuple[float, float]


@dataclass(frozen=True)
class Walk:
    """Lengths of the gait, see `sim.body.gait.GaitConfig`, m, and the times of a step, s."""

    com_m: float
    stance_m: float
    narrowest_m: float
    lift_m: float


@dataclass(frozen=True)
class Gaze:
    """Joints that turn and tilt the camera, and its frame.

    Args:
        pan, tilt: Joints; of the neck, or of the waist where there is none.
        frame: Link of the URDF on which the cameras are.
        axis: Axis of that frame that the cameras look along: "x" (z up), "z" (y down), or "body" (that of the body, x
            ahead, with all joints at zero).
        at_m: Of the cameras from its origin, ahead, left and up along these axes.
    """

    pan: str
    tilt: str
    frame: str
    axis: str
    at_m: tuple[float, float, float]


@dataclass(frozen=True)
class Sensor:
    """Intrinsics of a camera, and its place from that of the gaze: ahead, left, up, m.

    `down_deg` is that of a range or depth camera, `baseline_m` that of a depth camera or stereo pair, `noise_px` the standard
    deviation of disparity that the maker of a depth camera states; 0 otherwise.
    """

    width: int
    height: int
    across_deg: float
    at_m: tuple[float, float, float]
    down_deg: float = 0.0
    baseline_m: float = 0.0
    noise_px: float = 0.0


@dataclass(frozen=True)
class Dynamic:
    """How a robot walks in a physics engine, and how well its own odometry follows.

    Args:
        contact_x_m, contact_y_m: Corners of the left sole that touch the floor, from the origin of its link, ahead and
            left; mirrored for the right one.
        inward_m: By how much the planned ZMP is further inside than the point that a footstep places.
        start_s: Double support of the first step.
        step_m: Longest step ahead.
        slew_m: By how much forward motion may change from one step to the next.
        ankle_gain: Share of the tilt that the ankles of standing feet undo.
        ankle_rate_s: The same of its rate.
        shift_mps: Speed of a foot, up or down, for a load that is wrong by the whole weight.
        shift_forget_s: Time in which this shift decays.
        touch_share: Share of the weight on a sole from which it has landed.
        hold_m: Greatest height of an early landing.
        wait_s: Longest wait for a late one.
        odometry: Noise of the step odometry, by the names of `LocaliserConfig`, m and rad.
    """

    contact_x_m: tuple[float, float]
    contact_y_m: tuple[float, float]
    inward_m: float
    start_s: float
    step_m: float
    slew_m: float
    ankle_gain: float
    ankle_rate_s: float
    shift_mps: float
    shift_forget_s: float
    touch_share: float
    hold_m: float
    wait_s: float
    odometry: tuple[tuple[str, float], ...]


@dataclass(frozen=True)
class Description:
    """A robot with its model for the planners.

    Args:
        file: The TOML file.
        title, licence, origin: Of the model, for people.
        package: Distribution that has the URDF; empty: it lies beside the TOML file.
        urdf: Path of the URDF in the package, or from the TOML file.
        turn_deg: Yaw of the body's x axis in the frame of the URDF's root.
        posture: Joints that are frozen away from zero, and their angles, rad.
        model: Sizes and limits.
        sensors: Its cameras by name, of `SENSORS`.
        dynamic: How it walks in a physics engine; None: it does not.
    """

    file: Path
    title: str
    licence: str
    origin: str
    package: str
    urdf: str
    turn_deg: float
    posture: tuple[tuple[str, float], ...]
    legs: Legs
    walk: Walk
    gaze: Gaze
    model: RobotModel
    sensors: tuple[tuple[str, Sensor], ...]
    dynamic: Dynamic | None = None

    def sensor(self, name: str) -> Sensor | None:
        """A camera of this robot; None without it."""
        return dict(self.sensors).get(name)

    @property
    def moving(self) -> tuple[str, ...]:
        """The joints that move: those of both legs and of the gaze."""
        return (*self.legs.left, *self.legs.right, self.gaze.pan, self.gaze.tilt)

    def urdf_path(self) -> Path:
        """The URDF.

        Raises:
            InputError: Its package is not installed, or there is no such file.
        """
        if self.package:
            return installed.file(self.package, self.urdf, f"robot {self.file.stem!r}")
        path = self.file.parent / self.urdf
        if not os.path.isfile(path):  # also for an impossible name
            raise InputError(f"{self.file}: urdf = {self.urdf!r}: no such file; looked for {path}")
        return path
