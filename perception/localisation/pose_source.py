"""Where the body is: by its own filter, by poses that came with the recording, or not at all.

The cycle asks three things and does not care which kind answers: where is the body now, where should the
floor be in this camera, and where does this camera stand in the upright map frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from ..floor.levelling import camera_above_floor
from ..floor.prior import handheld_prior
from ..primitives.frame import Frame
from ..primitives.gaussian import Gaussian
from ..primitives.landmark import Sighting
from ..primitives.plane import Plane
from ..primitives.pose import Pose3
from .filter import UpdateReport
from .registration import RegistrationReport
from .static_points import StaticPoints


@dataclass(frozen=True)
class PriorConfig:
    """How far the floor may be from where it is expected."""

    joints_tilt_deg: float = (
        1.2  # head roll .72, pitch .5 deg (walking study) and 0.3 deg joint offsets
    )
    joints_height_m: float = 0.01  # ours: sole compliance and bumps
    given_tilt_deg: float = 4.0  # ours: gravity of handheld sets is good to 1-3 deg
    given_height_m: float = 0.10  # ours: a pose jump of a few centimetres must not lose the floor
    given_position_m: float = 0.01  # motion capture and SLAM poses: about 1 cm
    given_heading_deg: float = 0.5
    start_m: float = 0.02  # ours: a robot is put down on its mark by hand
    start_deg: float = 1.0  # ours
    clock_sigma_s: float = 0.013  # ours: images against joints; about half a frame of a camera
    longest_step_m: float = 0.15  # ours: the gait makes 0.08; joints that report more are wrong


@dataclass(frozen=True)
class Placed:
    """A camera in the upright map frame, and the floor it stands over."""

    T_map_camera: Pose3
    floor: Plane


@runtime_checkable
class PoseSource(Protocol):
    """Who knows where the body is."""

    @property
    def pose(self) -> Gaussian | None:
        """(x, y, yaw) of the body in the map frame, m and rad; None if nobody knows."""
        ...

    def update(self, frame: Frame, sightings: Sequence[Sighting]) -> UpdateReport | None:
        """Take in the next frame; what became of its landmarks."""
        ...

    def register(self, seen: Sequence[StaticPoints]) -> RegistrationReport | None:
        """Correct the pose by what stands about; what became of it, None if nobody compares."""
        ...

    def expected_floor(self, T_body_camera: Pose3 | None) -> Plane:
        """The floor in the camera frame before looking, with covariance."""
        ...

    def place(self, T_body_camera: Pose3 | None, floor: Plane | None) -> Placed | None:
        """The camera over the floor that was seen, or over the expected one; None if neither is known."""
        ...


class Nowhere:
    """A camera in the hand without poses: every frame stands alone, over its own shadow."""

    pose: Gaussian | None = None

    def update(self, frame: Frame, sightings: Sequence[Sighting]) -> UpdateReport | None:
        """Nothing is known of the motion."""
        return None

    def register(self, seen: Sequence[StaticPoints]) -> RegistrationReport | None:
        """There is no map to compare with."""
        return None

    def expected_floor(self, T_body_camera: Pose3 | None) -> Plane:
        """Below, somewhere."""
        return handheld_prior(None)

    def place(self, T_body_camera: Pose3 | None, floor: Plane | None) -> Placed | None:
        """Over the floor that is seen; without one, nowhere."""
        return None if floor is None else Placed(camera_above_floor(floor), floor)
