"""Where the body is: by its own filter, by poses that came with the recording, or not at all.

The cycle asks three things and does not care which kind answers: where is the body now, where should the
floor be in this camera, and where does this camera stand in the upright map frame.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from perception.floor.prior import handheld_prior, kinematic_prior
from perception.levelling import UP, level, rotation_between, shadow
from perception.localisation.filter import PoseFilter, UpdateReport
from perception.localisation.registration import (
    Registration,
    RegistrationConfig,
    RegistrationReport,
)
from perception.localisation.scan import joined, scan
from perception.primitives.frame import Frame
from perception.primitives.gaussian import Gaussian
from perception.primitives.landmark import Sighting
from perception.primitives.plane import Plane
from perception.primitives.pose import Pose2, Pose3

log = logging.getLogger(__name__)

STEP_S = 0.65
"""One footstep, seed 000."""


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


@dataclass(frozen=True)
class Standing:
    """What one depth sensor sees rise from the floor and stand still.

    Args:
        points: Upright map frame as believed when the camera was placed, z above the floor, m.
        sigma: Deviation of each along its ray, m.
        T_map_camera: The camera in the same frame.
    """

    points: Float[np.ndarray, "n 3"]
    sigma: Float[np.ndarray, "n"]
    T_map_camera: Pose3


@runtime_checkable
class Whereabouts(Protocol):
    """Who knows where the body is."""

    @property
    def pose(self) -> Gaussian | None:
        """(x, y, yaw) of the body in the map frame, m and rad; None if nobody knows."""
        ...

    def update(self, frame: Frame, sightings: Sequence[Sighting]) -> UpdateReport | None:
        """Take in the next frame; what became of its landmarks."""
        ...

    def register(self, seen: Sequence[Standing]) -> RegistrationReport | None:
        """Correct the pose by what stands about; what became of it, None if nobody compares."""
        ...

    def expected_floor(self, T_body_camera: Pose3 | None) -> Plane:
        """The floor in the camera frame before looking, with covariance."""
        ...

    def place(self, T_body_camera: Pose3 | None, floor: Plane | None) -> Placed | None:
        """The camera over the floor that was seen, or over the expected one; None if neither is known."""
        ...


class Walker:
    """A walking body: footsteps, inertial sensor, landmarks and what stands about, joined by the localiser."""

    def __init__(
        self,
        localiser: PoseFilter,
        config: PriorConfig,
        registration: RegistrationConfig | None = None,
    ) -> None:
        self._localiser = localiser
        self._config = config
        self._registration = Registration(registration)
        self._stamp_s: float | None = None
        self._anchored = False
        self._shift = np.zeros(3)  # how far clocks let images be off, along the motion

    @property
    def pose(self) -> Gaussian:
        """By the localiser."""
        return self._localiser.pose

    def update(self, frame: Frame, sightings: Sequence[Sighting]) -> UpdateReport | None:
        """Predict by odometry and inertial sensor, correct by landmarks."""
        elapsed = 0.0 if self._stamp_s is None else frame.stamp_s - self._stamp_s
        self._stamp_s = frame.stamp_s
        frame = self._believable(frame, elapsed)
        before = self._localiser.state
        self._localiser.predict(frame.odometry, frame.imu, elapsed)
        expected = self._localiser.state
        self._registration.moved(self._localiser.config, before, frame.odometry, elapsed, expected)
        self._shift = np.zeros(3)
        if frame.odometry is not None and elapsed > 0.0:
            self._shift = frame.odometry.motion.vector * (self._config.clock_sigma_s / elapsed)
        report = self._localiser.update([shifted(one, self._shift) for one in sightings])
        self._registration.learnt(expected, self._localiser.state)
        if report.accepted + report.rejected > 0:
            self._anchored = report.accepted > report.rejected
        return report

    def register(self, seen: Sequence[Standing]) -> RegistrationReport | None:
        """Lay what stands about over the map of former views."""
        config = self._registration.config
        if not config.enabled or not seen:
            return None
        T_body_map = self._localiser.pose2.inverse().lifted()
        cameras = [T_body_map @ one.T_map_camera for one in seen]
        fronts = joined(
            [
                scan(T_body_map.apply(one.points), one.sigma, camera.position[:2], config.scan)
                for one, camera in zip(seen, cameras, strict=True)
            ]
        )
        ahead = cameras[0].rotation[:, 2]
        state, report = self._registration.register(
            self._localiser.state,
            fronts,
            math.atan2(ahead[1], ahead[0]),
            self._anchored,
            self._shift,
        )
        self._localiser.believe(state)
        return report

    def _believable(self, frame: Frame, elapsed_s: float) -> Frame:
        """The frame without step odometry if no legs can have done what it says."""
        if frame.odometry is None:
            return frame
        made = math.hypot(frame.odometry.motion.x, frame.odometry.motion.y)
        steps = max(1.0, abs(frame.odometry.steps), elapsed_s / STEP_S)
        if not made > self._config.longest_step_m * steps:
            return frame
        log.warning("odometry of %.2f m in %.2f s is not believed", made, elapsed_s)
        return replace(frame, odometry=None)

    def expected_floor(self, T_body_camera: Pose3 | None) -> Plane:
        """Where the joint angles put it."""
        if T_body_camera is None:
            return handheld_prior(None)
        return kinematic_prior(
            T_body_camera,
            math.radians(self._config.joints_tilt_deg),
            self._config.joints_height_m,
        )

    def place(self, T_body_camera: Pose3 | None, floor: Plane | None) -> Placed | None:
        """Joint angles levelled by the floor, at the localiser's pose."""
        if T_body_camera is None:
            return None
        floor = floor or self.expected_floor(T_body_camera)
        x, y, yaw = (float(v) for v in self.pose.mean)
        return Placed(Pose2(x, y, yaw).lifted() @ level(T_body_camera, floor), floor)


def shifted(sighting: Sighting, shift: Float[np.ndarray, "3"]) -> Sighting:
    """The sighting, less sure by a body that may be off by (x, y, yaw), m and rad, body frame."""
    distance, bearing = (float(v) for v in sighting.measured)
    if not math.isfinite(bearing):
        return sighting
    c, s = math.cos(bearing), math.sin(bearing)
    reach = max(distance, 0.1)
    off = np.array(
        [
            c * shift[0] + s * shift[1],
            shift[2] + (c * shift[1] - s * shift[0]) / reach,
        ]
    )
    return replace(sighting, covariance=sighting.covariance + np.outer(off, off))


class Given:
    """Poses that came with the recording.

    The map frame is the recording's world turned upright: about its known gravity, or else about the
    first floor that is seen. Its floor is the running mean of the floors seen.
    """

    def __init__(self, up_world: tuple[float, float, float] | None, config: PriorConfig) -> None:
        self._config = config
        self._R_map_world = None if up_world is None else rotation_between(np.array(up_world), UP)
        self._T_map_camera: Pose3 | None = None
        self._given: Pose3 | None = None
        self._floors, self._floor_height_m = 0, 0.0  # how many were seen, and their mean height

    @property
    def pose(self) -> Gaussian | None:
        """Below the camera, heading where it looks; None for a frame without a pose."""
        if self._T_map_camera is None:
            return None
        ahead = self._T_map_camera.rotation[:, 2]
        x, y, _ = self._T_map_camera.translation
        heading = math.radians(self._config.given_heading_deg)
        deviations = np.array([self._config.given_position_m] * 2 + [heading])
        return Gaussian(np.array([x, y, math.atan2(ahead[1], ahead[0])]), np.diag(deviations**2))

    def update(self, frame: Frame, sightings: Sequence[Sighting]) -> UpdateReport | None:
        """Take the frame's pose."""
        self._given = frame.T_world_camera
        self._T_map_camera = None
        if self._given is not None and self._R_map_world is not None:
            upright = Pose3.from_rotation(self._R_map_world, np.zeros(3))
            self._T_map_camera = upright @ self._given
        return None

    def register(self, seen: Sequence[Standing]) -> RegistrationReport | None:
        """The given poses stand."""
        return None

    def expected_floor(self, T_body_camera: Pose3 | None) -> Plane:
        """Horizontal, at the height of the floors seen so far."""
        if self._T_map_camera is None:
            return handheld_prior(None)
        up_camera = self._T_map_camera.rotation.T @ UP
        tilt = math.radians(self._config.given_tilt_deg)
        if not self._floors:
            weak = handheld_prior(up_camera)
            covariance = weak.covariance.copy()
            covariance[:2, :2] = np.eye(2) * tilt**2
            return Plane(up_camera, weak.offset_m, covariance)
        height = self._T_map_camera.translation[2] - self._floor_height_m
        return Plane(up_camera, height, np.diag([tilt**2, tilt**2, self._config.given_height_m**2]))

    def place(self, T_body_camera: Pose3 | None, floor: Plane | None) -> Placed | None:
        """The given pose; heights are measured from the floor that is seen."""
        if self._given is None:
            return None
        if self._T_map_camera is None:  # the first floor says what is up
            if floor is None:
                return None
            self._R_map_world = rotation_between(self._given.rotation @ floor.normal, UP)
            upright = Pose3.from_rotation(self._R_map_world, np.zeros(3))
            self._T_map_camera = upright @ self._given
        if floor is not None:
            height = float(self._T_map_camera.translation[2]) - floor.offset_m
            self._floors += 1
            self._floor_height_m += (height - self._floor_height_m) / self._floors
        elif not self._floors:
            return None
        return Placed(self._T_map_camera, floor or self.expected_floor(T_body_camera))


class Nowhere:
    """A camera in the hand without poses: every frame stands alone, over its own shadow."""

    pose: Gaussian | None = None

    def update(self, frame: Frame, sightings: Sequence[Sighting]) -> UpdateReport | None:
        """Nothing is known of the motion."""
        return None

    def register(self, seen: Sequence[Standing]) -> RegistrationReport | None:
        """There is no map to compare with."""
        return None

    def expected_floor(self, T_body_camera: Pose3 | None) -> Plane:
        """Below, somewhere."""
        return handheld_prior(None)

    def place(self, T_body_camera: Pose3 | None, floor: Plane | None) -> Placed | None:
        """Over the floor that is seen; without one, nowhere."""
        return None if floor is None else Placed(shadow(floor), floor)
