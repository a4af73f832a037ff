"""Pose source of a recording without poses: RGB-D odometry, frame by frame."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ..depth.reach import ReachesConfig
from ..depth.sources import DepthSources
from ..floor.choose import FloorConfig
from ..floor.levelling import UP, camera_above_floor
from ..floor.prior import handheld_prior
from ..localisation.camera_pose import CameraPose
from ..localisation.filter import UpdateReport
from ..localisation.pose_source import PlacedCamera
from ..localisation.registration import RegistrationReport
from ..localisation.static_points import StaticPoints
from ..monitoring import status
from ..primitives.frame import Frame
from ..primitives.gaussian import Gaussian
from ..primitives.landmark import Sighting
from ..primitives.plane import Plane
from ..primitives.pose import Pose3
from ..smoothing.factors import turned_covariance
from .odometry import FIRST, LOST, RESTARTED, Step
from .pose_uncertainty import compounded, planar_gaussian
from .rgbd_odometry import Odometer, OdometerConfig
from .view_errors import since_start, view_correlation

FLOOR_TILT_DEG = 3.0  # ours: tilt of a floor against earlier floors and the odometry between them
FLOOR_HEIGHT_M = 0.08  # ours: its height, likewise


class OdometryPoses:
    """Poses of a hand-held camera by its own odometry.

    The map frame is upright, as defined by the first floor that is found. A lost frame keeps the last pose and
    is not placed, so nothing is mapped from it. Until one image has been aligned with another, the frames may be
    unrelated single images: each is then placed above its own floor at the origin.
    """

    def __init__(
        self,
        rng: np.random.Generator,
        config: OdometerConfig | None = None,
        floor: FloorConfig | None = None,
        sources: DepthSources | None = None,
        reach: ReachesConfig | None = None,
    ) -> None:
        """Begin before the first frame.

        Args:
            rng: Random numbers of the floor search.
            config: Settings of the odometry.
            floor: Settings of the floor search.
            sources: Depth images of the frames, shared with the pipeline.
            reach: As for `Odometer`.
        """
        self._sources = sources or DepthSources()
        self.odometer = Odometer(rng, config, floor, self._sources.structured_light, reach)
        self.stamps: list[float] = []  # of the depth images, s
        self._step: Step | None = None
        self._covariances: dict[int, Float[np.ndarray, "6 6"]] = {}  # of references and the latest
        self._covariance = np.zeros((6, 6))
        self._floor: Plane | None = None  # the latest detected floor, map frame

    @property
    def T_map_camera(self) -> Pose3 | None:
        """The camera in the upright map frame; None until a floor is found."""
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
        of_view = self.odometer.view_error.covariance
        return CameraPose(step.T_start_camera, self._covariance + self._common(), of_view)

    @property
    def step(self) -> Step | None:
        """The latest step of the odometry; None before the first depth image."""
        return self._step

    @property
    def _unrelated(self) -> bool:
        """True if there was no depth image, or none after the first could be aligned."""
        states = self.odometer.states
        return len(states) != 1 and all(one in (FIRST, LOST, RESTARTED) for one in states)

    @property
    def pose(self) -> Gaussian | None:
        """The point below the camera and the heading of its optical axis; None until a floor is found."""
        T = self.T_map_camera
        if T is None or self._unrelated:
            return None
        start = self.odometer.T_world_start
        assert start is not None
        whole = self._covariance + self._common() + self._view_error()
        return planar_gaussian(T, turned_covariance(whole, start.rotation))

    def _common(self) -> Float[np.ndarray, "6 6"]:
        """Covariance of the latest pose by the vergence of a stereo pair, axes of the first image."""
        return self.odometer.vergence.of_image(-1)

    def _view_error(self) -> Float[np.ndarray, "6 6"]:
        """Covariance of the view error of this image relative to the first one, axes of the first one."""
        assert self._step is not None
        T = self._step.T_start_camera
        alike = view_correlation(
            T.position[None], T.rotation[None], np.zeros((1, 3)), np.eye(3)[None]
        )
        return since_start(self.odometer.view_error.covariance, T.position, float(alike[0, 0]))

    def update(self, frame: Frame, sightings: Sequence[Sighting]) -> UpdateReport | None:
        """Track the camera; a frame without depth leaves the pose unchanged. The report of a lost camera says so."""
        image = self._sources.for_odometry(frame)
        if image is None:
            return None
        number = len(self.odometer.states)
        self.stamps.append(frame.stamp_s)
        step = self._step = self.odometer.track_images(image.depth, image.rgb, image.sensor)
        before = self._covariances.get(step.reference, np.zeros((6, 6)))
        reference = step.T_start_camera @ step.motion.inverse()
        self._covariance = compounded(before, reference, step.motion, step.covariance)
        self._covariances[number] = self._covariance
        kept = {number, *(one.number for one in self.odometer.odometry.references)}
        self._covariances = {n: c for n, c in self._covariances.items() if n in kept}
        lost = step.state in (LOST, RESTARTED)
        return UpdateReport(0, 0, [], (status.Doubt(status.LOST, status.STAND),)) if lost else None

    def register(self, seen: Sequence[StaticPoints]) -> RegistrationReport | None:
        """Nothing to do: odometry has aligned the images already."""
        return None

    def expected_floor(self, T_body_camera: Pose3 | None) -> Plane:
        """Horizontal, at the height of the floor detected last; the weak prior of a hand-held camera without a pose.

        The first floor defines the vertical, with the errors of the sensor: the floor is tilted against it.
        """
        T = self.T_map_camera
        if T is None or self._unrelated or not T.translation[2] > 0.0:
            return handheld_prior(None)
        tilt = math.radians(FLOOR_TILT_DEG)
        height, variance = float(T.translation[2]), FLOOR_HEIGHT_M**2
        if self._floor is not None:
            here = self._floor.moved(T.inverse())
            height, variance = here.offset_m, variance + float(here.covariance[2, 2])
        return Plane(T.rotation.T @ UP, height, np.diag([tilt**2, tilt**2, variance]))

    def place(self, T_body_camera: Pose3 | None, floor: Plane | None) -> PlacedCamera | None:
        """The camera at the pose of odometry; None while it is lost."""
        if self._unrelated:
            return None if floor is None else PlacedCamera(camera_above_floor(floor), floor)
        T = self.T_map_camera
        if T is None or self._step is None or self._step.state in (LOST, RESTARTED):
            return None
        if floor is not None:
            self._floor = floor.moved(T)
        return PlacedCamera(T, floor or self.expected_floor(T_body_camera))
