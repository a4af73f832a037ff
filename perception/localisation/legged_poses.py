"""Pose source of a walking robot: localisation by step odometry, gyro, landmarks and scan registration."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from ..floor.levelling import level
from ..floor.prior import handheld_prior, kinematic_prior
from ..monitoring.clock import UsualIntervals, ends
from ..primitives.frame import Frame, Imu, StepOdometry
from ..primitives.gaussian import Gaussian
from ..primitives.landmark import Sighting
from ..primitives.plane import Plane
from ..primitives.pose import Pose2, Pose3
from .filter import PoseFilter, UpdateReport
from .pose_source import PlacedCamera, PriorConfig
from .registration import Registration, RegistrationConfig, RegistrationReport
from .scan import Scan, joined, scan
from .static_points import StaticPoints

log = logging.getLogger(__name__)


STEP_S = 0.65  # duration of a footstep, seed 000
CLOCK_SIGMA_S = 0.013  # ours: time offset of images and joint angles; half a frame period


class LeggedLocaliser:
    """Joins the pose filter and scan registration."""

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
        self._intervals = UsualIntervals()
        self._anchored = False
        self._shift = np.zeros(3)  # motion of the body within the clock offset

    @property
    def pose(self) -> Gaussian:
        """Gaussian over (x, y, yaw), by the pose filter."""
        return self._localiser.pose

    @property
    def pose2(self) -> Pose2:
        """Its mean."""
        return self._localiser.pose2

    def update(self, frame: Frame, sightings: Sequence[Sighting]) -> UpdateReport | None:
        """Predict by odometry and gyro, update with landmarks."""
        elapsed = 0.0 if self._stamp_s is None else frame.stamp_s - self._stamp_s
        if self._stamp_s is not None:
            missing = self._intervals.missing(ends(frame), elapsed)
            if missing > 0.0:  # odometry and gyro are of the time since a frame that was lost
                self._predict(None, None, missing)
                elapsed -= missing
        self._stamp_s = frame.stamp_s
        frame = self._plausible(frame, elapsed)
        self._predict(frame.odometry, frame.imu, elapsed)
        expected = self._localiser.state
        self._shift = np.zeros(3)
        if frame.odometry is not None and elapsed > 0.0:
            self._shift = frame.odometry.motion.vector * (CLOCK_SIGMA_S / elapsed)
        report = self._localiser.update([with_time_offset(one, self._shift) for one in sightings])
        self._registration.correct(expected, self._localiser.state)
        if report.accepted + report.rejected > 0:
            self._anchored = report.accepted > report.rejected
        return replace(report, doubts=tuple(self._localiser.doubts()))

    def _predict(self, odometry: StepOdometry | None, imu: Imu | None, seconds: float) -> None:
        """Advance pose and keyframes."""
        before = self._localiser.state
        self._localiser.predict(odometry, imu, seconds)
        noise, after = self._localiser.process_noise, self._localiser.state
        self._registration.predict(before, odometry, noise, after)

    def register(self, seen: Sequence[StaticPoints]) -> RegistrationReport | None:
        """Register the static points of all depth sensors with the keyframes."""
        if not self._registration.config.enabled or not seen:
            return None
        T_body_map = self._localiser.pose2.inverse().lifted()
        cameras = [T_body_map @ one.T_map_camera for one in seen]
        fronts = joined(
            [
                scan(T_body_map.apply(one.points), one.sigma, camera.position[:2])
                for one, camera in zip(seen, cameras, strict=True)
            ]
        )
        return self.register_scan(fronts, cameras[0])

    def register_scan(self, fronts: Scan, T_body_camera: Pose3) -> RegistrationReport | None:
        """Register a scan, body frame, with the keyframes; None if that is not enabled.

        Args:
            fronts: The scan.
            T_body_camera: Of the camera, to whose direction the errors of a scan as a whole refer.
        """
        if not self._registration.config.enabled:
            return None
        ahead = T_body_camera.rotation[:, 2]
        state, report = self._registration.register(
            self._localiser.state,
            fronts,
            math.atan2(ahead[1], ahead[0]),
            self._anchored,
            self._shift,
        )
        self._localiser.set_state(state)
        return report

    def _plausible(self, frame: Frame, elapsed_s: float) -> Frame:
        """The frame without step odometry if that exceeds what the legs can do."""
        if frame.odometry is None:
            return frame
        length = math.hypot(frame.odometry.motion.x, frame.odometry.motion.y)
        steps = max(1.0, abs(frame.odometry.steps), elapsed_s / STEP_S)
        if not length > self._config.longest_step_m * steps:
            return frame
        log.warning(
            "step odometry of %.2f m in %.2f s is implausible and ignored", length, elapsed_s
        )
        return replace(frame, odometry=None)

    def expected_floor(self, T_body_camera: Pose3 | None) -> Plane:
        """The floor by joint angles."""
        if T_body_camera is None:
            return handheld_prior(None)
        return kinematic_prior(
            T_body_camera,
            math.radians(self._config.joints_tilt_deg),
            self._config.joints_height_m,
        )

    def place(self, T_body_camera: Pose3 | None, floor: Plane | None) -> PlacedCamera | None:
        """The camera by joint angles, levelled by the floor, at the localised pose."""
        if T_body_camera is None:
            return None
        floor = floor or self.expected_floor(T_body_camera)
        x, y, yaw = (float(v) for v in self.pose.mean)
        return PlacedCamera(Pose2(x, y, yaw).lifted() @ level(T_body_camera, floor), floor)


def with_time_offset(sighting: Sighting, shift: Float[np.ndarray, "3"]) -> Sighting:
    """Add the uncertainty of a body displaced by (x, y, yaw), m and rad, body frame, to a sighting."""
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
