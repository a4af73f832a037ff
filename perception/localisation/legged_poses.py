"""Pose source of a walking body: the localiser by footsteps, inertial sensor, landmarks and registration."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from ..floor.levelling import level
from ..floor.prior import handheld_prior, kinematic_prior
from ..primitives.frame import Frame
from ..primitives.gaussian import Gaussian
from ..primitives.landmark import Sighting
from ..primitives.plane import Plane
from ..primitives.pose import Pose2, Pose3
from .filter import PoseFilter, UpdateReport
from .pose_source import Placed, PriorConfig
from .registration import Registration, RegistrationConfig, RegistrationReport
from .scan import joined, scan
from .static_points import StaticPoints

log = logging.getLogger(__name__)


STEP_S = 0.65
"""One footstep, seed 000."""


class LeggedLocaliser:
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

    def register(self, seen: Sequence[StaticPoints]) -> RegistrationReport | None:
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
