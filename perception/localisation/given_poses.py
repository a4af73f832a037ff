"""Pose source of a recording with poses."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from ..floor.levelling import UP, rotation_between
from ..floor.prior import handheld_prior
from ..primitives.frame import Frame
from ..primitives.gaussian import Gaussian
from ..primitives.landmark import Sighting
from ..primitives.plane import Plane
from ..primitives.pose import Pose3
from .camera_pose import CameraPose
from .filter import UpdateReport
from .pose_source import PlacedCamera, PriorConfig
from .registration import RegistrationReport
from .static_points import StaticPoints

TILT_DEG = 4.0  # ours: the gravity direction of hand-held sets is good to 1-3 deg
HEIGHT_M = 0.10  # ours: the floor must survive a pose jump of a few centimetres
HEADING_DEG = 0.5  # ours: motion capture and SLAM
CLOCK_S = 0.02
"""Ours: by how much stamps of images and poses are off, without a common trigger; between TUM's first camera and its motion
capture it is about that."""


class GivenPoses:
    """Poses of the recording, turned upright.

    The map frame is the recording's world frame levelled by its known gravity direction, or else by the first
    detected floor. Heights are measured from the floor of each image.
    """

    def __init__(self, up_world: tuple[float, float, float] | None, config: PriorConfig) -> None:
        self._config = config
        self._R_map_world = None if up_world is None else rotation_between(np.array(up_world), UP)
        self._T_map_camera: Pose3 | None = None
        self._given: Pose3 | None = None
        self._before: tuple[float, Pose3] | None = None  # the latest given pose and its stamp, s
        self._motion = np.zeros(6)  # m/s and rad/s, axes of the recording's world
        self._floor: Plane | None = None  # the latest detected floor, map frame

    @property
    def pose(self) -> Gaussian | None:
        """The point below the camera and the heading of its optical axis; None for a frame without a pose."""
        if self._T_map_camera is None:
            return None
        ahead = self._T_map_camera.rotation[:, 2]
        x, y, _ = self._T_map_camera.translation
        assert self._R_map_world is not None
        turn = np.kron(np.eye(2), self._R_map_world)
        P = (turn @ self._covariance @ turn.T)[np.ix_((0, 1, 5), (0, 1, 5))]
        return Gaussian(np.array([x, y, math.atan2(ahead[1], ahead[0])]), P)

    @property
    def T_map_origin(self) -> Pose3 | None:
        """The recording's world in the upright map frame; None until gravity or a floor defines up."""
        R = self._R_map_world
        return None if R is None else Pose3.from_rotation(R, np.zeros(3))

    @property
    def camera(self) -> CameraPose | None:
        """The given pose of the latest frame, in the recording's world; None for a frame without one."""
        if self._given is None:
            return None
        return CameraPose(self._given, np.zeros((6, 6)), self._covariance)

    @property
    def _covariance(self) -> Float[np.ndarray, "6 6"]:
        """Of position and rotation, axes of the recording's world: that of the poses, and that of their stamps."""
        deviations = [self._config.given_position_m] * 3 + [math.radians(HEADING_DEG)] * 3
        late = CLOCK_S * self._motion
        return np.diag(np.square(deviations)) + np.outer(late, late)

    def update(self, frame: Frame, sightings: Sequence[Sighting]) -> UpdateReport | None:
        """Take the pose of the frame."""
        self._given = frame.T_world_camera
        if self._given is not None:
            if self._before is not None and frame.stamp_s > self._before[0]:
                before_s, before = self._before
                self._motion = _motion(before, self._given, frame.stamp_s - before_s)
            self._before = frame.stamp_s, self._given
        self._T_map_camera = None
        if self._given is not None and self._R_map_world is not None:
            upright = Pose3.from_rotation(self._R_map_world, np.zeros(3))
            self._T_map_camera = upright @ self._given
        return None

    def register(self, seen: Sequence[StaticPoints]) -> RegistrationReport | None:
        """Nothing to do: given poses are not corrected."""
        return None

    def expected_floor(self, T_body_camera: Pose3 | None) -> Plane:
        """Horizontal, at the height of the floor detected last.

        That floor may be tilted against the given vertical: it is continued to the present camera.
        """
        if self._T_map_camera is None:
            return handheld_prior(None)
        up_camera = self._T_map_camera.rotation.T @ UP
        tilt = math.radians(TILT_DEG)
        if self._floor is None:
            weak = handheld_prior(up_camera)
            covariance = weak.covariance.copy()
            covariance[:2, :2] = np.eye(2) * tilt**2
            return Plane(up_camera, weak.offset_m, covariance)
        here = self._floor.moved(self._T_map_camera.inverse())
        variance = HEIGHT_M**2 + float(here.covariance[2, 2])
        return Plane(up_camera, here.offset_m, np.diag([tilt**2, tilt**2, variance]))

    def place(self, T_body_camera: Pose3 | None, floor: Plane | None) -> PlacedCamera | None:
        """The camera at its given pose, height measured from the detected floor."""
        if self._given is None:
            return None
        if self._T_map_camera is None:  # the first floor defines the vertical
            if floor is None:
                return None
            self._R_map_world = rotation_between(self._given.rotation @ floor.normal, UP)
            upright = Pose3.from_rotation(self._R_map_world, np.zeros(3))
            self._T_map_camera = upright @ self._given
        if floor is not None:
            self._floor = floor.moved(self._T_map_camera)
        elif self._floor is None:
            return None
        return PlacedCamera(self._T_map_camera, floor or self.expected_floor(T_body_camera))


def _motion(before: Pose3, now: Pose3, seconds: float) -> Float[np.ndarray, "6"]:
    """Mean velocity, m/s, and rate of turn, rad/s, from one pose to another, axes of their world."""
    turned = Rotation.from_matrix(now.rotation @ before.rotation.T).as_rotvec()
    return np.concatenate([now.position - before.position, turned]) / seconds
