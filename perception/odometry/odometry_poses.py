"""Pose source of a recording without poses: the camera's own odometry."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ..depth.sources import DepthSources
from ..floor.levelling import UP, shadow
from ..floor.prior import handheld_prior
from ..localisation.camera_pose import CameraPose
from ..localisation.filter import UpdateReport
from ..localisation.pose_source import Placed, PriorConfig
from ..localisation.registration import RegistrationReport
from ..localisation.static_points import StaticPoints
from ..primitives.frame import Frame
from ..primitives.gaussian import Gaussian
from ..primitives.landmark import Sighting
from ..primitives.plane import Plane
from ..primitives.pose import Pose3
from ..smoothing.factors import turned_covariance
from .odometry import FIRST, LOST, RESTARTED, Step
from .pose_uncertainty import joined
from .rgbd_odometry import Odometer, OdometerConfig


class OdometryPoses:
    """A camera in the hand that follows its own way.

    The map frame is upright by the first floor seen. A lost frame keeps the last pose, is placed nowhere, and
    so adds nothing to any map. As long as no frame has been laid over another, these may be single pictures:
    each then stands alone, over its own shadow.
    """

    def __init__(
        self,
        rng: np.random.Generator,
        prior: PriorConfig,
        config: OdometerConfig | None = None,
        sources: DepthSources | None = None,
    ) -> None:
        self._prior = prior
        self._sources = sources or DepthSources()
        self.odometer = Odometer(rng, config)
        self._step: Step | None = None
        self._covariances: dict[
            int, Float[np.ndarray, "6 6"]
        ] = {}  # of references, and of the latest
        self._covariance = np.zeros((6, 6))

    @property
    def T_map_camera(self) -> Pose3 | None:
        """The camera in the upright map frame; None until a floor is seen."""
        start = self.odometer.T_world_start
        return None if start is None or self._step is None else start @ self._step.T_start_camera

    @property
    def T_map_origin(self) -> Pose3 | None:
        """The first image's axes in the upright map frame; None until a floor is seen."""
        return self.odometer.T_world_start

    @property
    def camera(self) -> CameraPose | None:
        """The latest image's pose in the axes of the first one; None if it is lost."""
        step = self._step
        if step is None or step.state in (LOST, RESTARTED):
            return None
        distortion = self.odometer.config.back_end.distortion
        return CameraPose(step.T_start_camera, self._covariance, distortion)

    @property
    def _alone(self) -> bool:
        """Whether no depth image, or none beside the first, was laid over another."""
        states = self.odometer.states
        return len(states) != 1 and all(one in (FIRST, LOST, RESTARTED) for one in states)

    @property
    def pose(self) -> Gaussian | None:
        """Below the camera, heading where it looks; None until a floor is seen, or if nothing was ever followed."""
        T = self.T_map_camera
        if T is None or self._alone:
            return None
        ahead = T.rotation[:, 2]
        mean = np.array([T.translation[0], T.translation[1], math.atan2(ahead[1], ahead[0])])
        start = self.odometer.T_world_start
        assert start is not None
        # this image's; the first's is carried along
        distortion = self.odometer.config.back_end.distortion
        covariance = turned_covariance(self._covariance + distortion, start.rotation)
        planar = np.ix_([0, 1, 5], [0, 1, 5])
        floor = np.diag([1e-4**2, 1e-4**2, 1e-4**2])  # where the world begins is known
        return Gaussian(mean, covariance[planar] + floor)

    def update(self, frame: Frame, sightings: Sequence[Sighting]) -> UpdateReport | None:
        """Follow the camera; a frame without depth leaves it where it was."""
        image = self._sources.for_odometry(frame)
        if image is None:
            return None
        number = len(self.odometer.states)
        step = self._step = self.odometer.take_images(image.depth, image.rgb, image.sensor)
        first = self.odometer.config.back_end.distortion
        before = self._covariances.get(step.reference, first)
        reference = step.T_start_camera @ step.motion.inverse()
        self._covariance = joined(before, reference, step.motion, step.covariance)
        self._covariances[number] = self._covariance
        kept = {number, *(one.number for one in self.odometer.odometry.references)}
        self._covariances = {n: c for n, c in self._covariances.items() if n in kept}
        return None

    def register(self, seen: Sequence[StaticPoints]) -> RegistrationReport | None:
        """Images have been laid over each other already."""
        return None

    def expected_floor(self, T_body_camera: Pose3 | None) -> Plane:
        """Horizontal, at height zero of the map; below somewhere while that is unknown."""
        T = self.T_map_camera
        if T is None or self._alone or not T.translation[2] > 0.0:
            return handheld_prior(None)
        c = self.odometer.config
        tilt = math.radians(c.floor_tilt_deg)
        return Plane(
            T.rotation.T @ UP,
            T.translation[2],
            np.diag([tilt**2, tilt**2, c.floor_height_m**2]),
        )

    def place(self, T_body_camera: Pose3 | None, floor: Plane | None) -> Placed | None:
        """Where odometry has it; a lost camera is nowhere."""
        if self._alone:
            return None if floor is None else Placed(shadow(floor), floor)
        T = self.T_map_camera
        if T is None or self._step is None or self._step.state in (LOST, RESTARTED):
            return None
        return Placed(T, floor or self.expected_floor(T_body_camera))
