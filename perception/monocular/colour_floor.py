"""Perception with one colour camera: floor by colour, obstacle contacts, and detections for the tracker.

`ColourFloorFinder` keeps the colour model of the floor and, if motion is estimated by optical flow, the last picture.

Source: Han 2018 (seed 000), sections 2 and 3; the detections are ours.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from ..obstacles.track import Detection
from ..primitives.errors import InputError
from ..primitives.frame import ColourView, Imu
from ..primitives.pose import Pose2, Pose3
from . import pair_pose
from .contact_detections import ContactEdges, detect_discs, find_contact_edges
from .cycle import Monocular, MonocularConfig
from .result import MonocularResult, Picture

LOG = logging.getLogger(__name__)

DETECTION_RANGE_M = 2.5  # ours: beyond this, half a degree of pitch is 15 cm
AROUND_M = 0.10 * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
"""Ours: floor must be visible this far around a track before the track counts as missed."""


@dataclass(frozen=True, eq=False)
class ColourFloor:
    """The floor by colour in one picture.

    Args:
        result: All stages of the monocular cycle.
        contacts: Contact edges of the obstacles with the floor.
        detections: Disc-shaped obstacles, body frame.
        robot: Pose of the body when the picture was taken, map frame.
    """

    result: MonocularResult
    contacts: ContactEdges
    detections: tuple[Detection, ...]
    robot: Pose2

    def shows_free(self, places: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, "n"]:
        """Which positions, map frame, m, are within detection range and surrounded by visible floor."""
        near = np.hypot(*(places - [self.robot.x, self.robot.y]).T) < DETECTION_RANGE_M
        free = self.contacts.shows_floor(places)
        for offset in AROUND_M:  # an obstacle partly outside the picture is not missed
            free &= self.contacts.shows_floor(places + offset)
        return np.asarray(free & near)


class ColourFloorFinder:
    """Finds the floor by colour, frame by frame."""

    def __init__(self, config: MonocularConfig, flow: bool) -> None:
        """Begin without a colour model.

        Args:
            config: Settings of the monocular cycle.
            flow: Estimate motion by optical flow between consecutive pictures.
        """
        self._monocular = Monocular(config)
        self._flow = flow
        self._previous: Picture | None = None
        self._T_body_camera: Pose3 | None = None  # of the last frame; None if it had no picture

    def find(
        self, colour: ColourView | None, robot: Pose2, stamp_s: float, imu: Imu | None = None
    ) -> ColourFloor | None:
        """The floor in one picture.

        Args:
            colour: The picture with its camera in the body frame.
            robot: Pose of the body when the picture was taken, map frame.
            stamp_s: Time of the picture, s.
            imu: Means since the last frame; None without inertial sensor.

        Returns:
            None without a picture, or if the picture does not fit its camera or pose.
        """
        before, self._T_body_camera = self._T_body_camera, None
        if colour is None or colour.T_body_camera is None:
            return None
        try:
            placed = robot.lifted() @ colour.T_body_camera
            picture = Picture(colour.rgb, colour.camera, placed, stamp_s)
        except InputError as error:
            LOG.warning("%.1f s: picture not used: %s", stamp_s, error)
            return None
        previous, sway = self._previous if self._flow else None, None
        if previous is not None and before is not None and imu is not None:
            seconds = stamp_s - previous.stamp_s
            sway = pair_pose.sway_by_gyro(
                imu.angular_velocity, seconds, before, colour.T_body_camera, robot.yaw
            )
        result = self._monocular.cycle(previous, picture, sway)
        self._previous, self._T_body_camera = picture, colour.T_body_camera
        contacts = find_contact_edges(result)
        detections = detect_discs(contacts, robot, DETECTION_RANGE_M)
        return ColourFloor(result, contacts, tuple(detections), robot)


def seen_by_any(
    *visible: Callable[[np.ndarray], np.ndarray],
) -> Callable[[np.ndarray], np.ndarray]:
    """Visibility of positions by at least one of several sensors."""

    def seen(places: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, "n"]:
        return np.any([one(places) for one in visible], axis=0)

    return seen
