"""Pose source: where the body and its cameras are, in the map frame.

Three implementations: `legged_poses` (the walking robot's own localiser), `given_poses` (a recording with
poses) and `odometry.odometry_poses` (a hand-held camera without poses). The pipeline uses any of them alike.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from ..primitives.errors import ConfigError
from ..primitives.frame import Frame
from ..primitives.gaussian import Gaussian
from ..primitives.landmark import Sighting
from ..primitives.plane import Plane
from ..primitives.pose import Pose3
from ..primitives.settings import setting
from .filter import UpdateReport
from .registration import RegistrationReport
from .static_points import StaticPoints


@dataclass(frozen=True)
class PriorConfig:
    """Uncertainty of the start pose, of given poses and of the kinematic floor prior."""

    joints_tilt_deg: float = setting(
        1.2,
        "deg",
        "standard deviation of the floor's tilt by joint angles",
        "ours: walking trials, head roll .72, pitch .5 deg, and 0.3 deg joint offsets",
    )
    given_position_m: float = setting(
        0.01, "m", "standard deviation of the poses of a recording", "motion capture and SLAM"
    )
    start_m: float = 0.02  # ours: a robot placed on its mark by hand; standard deviation of the start position, unless the recording has one
    longest_step_m: float = 0.15  # ours: the gait makes 0.08; longest plausible step; step odometry beyond it is ignored
    joints_height_m: float = 0.01  # ours: sole compliance and bumps
    start_deg: float = 1.0  # ours: standard deviation of the start heading

    def __post_init__(self) -> None:
        for name in ("joints_tilt_deg", "given_position_m"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"prior: {name}={value} must be positive and finite")


@dataclass(frozen=True)
class PlacedCamera:
    """A camera in the upright map frame, and the floor below it in the camera frame."""

    T_map_camera: Pose3
    floor: Plane


@runtime_checkable
class PoseSource(Protocol):
    """Poses of the body and its cameras, frame by frame."""

    @property
    def pose(self) -> Gaussian | None:
        """(x, y, yaw) of the body in the map frame, m and rad; None if unknown."""
        ...

    def update(self, frame: Frame, sightings: Sequence[Sighting]) -> UpdateReport | None:
        """Process the next frame; returns the report on its landmarks, if any are used."""
        ...

    def register(self, seen: Sequence[StaticPoints]) -> RegistrationReport | None:
        """Correct the pose by scan registration; None if this source does not register scans."""
        ...

    def expected_floor(self, T_body_camera: Pose3 | None) -> Plane:
        """The floor prior in the camera frame, with covariance."""
        ...

    def place(self, T_body_camera: Pose3 | None, floor: Plane | None) -> PlacedCamera | None:
        """The camera above the detected floor, or above the expected one; None if its pose is unknown."""
        ...
