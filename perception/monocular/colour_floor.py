"""Perception by one colour camera: floor by colour, contacts of obstacles with it, detections for the tracker.

`ColourFloorFinder` lives from frame to frame: it remembers the colours of the floor, and the last picture if
motion is estimated by optical flow.

Source: seed 000, sections 2 and 3; the detections are ours.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from ..obstacles.track import Detection
from ..primitives.errors import InputError
from ..primitives.frame import ColourView
from ..primitives.pose import Pose2
from .contact_detections import FloorContacts, detections, floor_contacts
from .cycle import Monocular, MonocularConfig
from .result import MonocularResult, Picture

LOG = logging.getLogger(__name__)

DETECT_TO_M = 2.5  # ours: beyond this, half a degree of pitch is 15 cm
AROUND_M = 0.10 * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
"""Ours: floor must be visible this far round a track before the track counts as missed."""


@dataclass(frozen=True, eq=False)
class ColourFloor:
    """The floor by colour in one picture.

    Args:
        result: All stages of the monocular cycle.
        contacts: Where obstacles touch the floor.
        detections: Obstacles that are discs, body frame.
        robot: Pose that the picture was placed by, map frame.
    """

    result: MonocularResult
    contacts: FloorContacts
    detections: tuple[Detection, ...]
    robot: Pose2

    def shows_free(self, places: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, "n"]:
        """At which places, map frame, m, an obstacle would have been detected and only floor is visible."""
        near = np.hypot(*(places - [self.robot.x, self.robot.y]).T) < DETECT_TO_M
        bare = self.contacts.shows_floor(places)
        for offset in AROUND_M:  # an obstacle partly outside the picture is not missed
            bare &= self.contacts.shows_floor(places + offset)
        return np.asarray(bare & near)


class ColourFloorFinder:
    """Finds the floor by colour, frame by frame."""

    def __init__(self, config: MonocularConfig, flow: bool) -> None:
        """Begin without any floor colours.

        Args:
            config: Of the monocular cycle.
            flow: Estimate motion by optical flow between consecutive pictures.
        """
        self._monocular = Monocular(config)
        self._flow = flow
        self._previous: Picture | None = None

    def find(self, colour: ColourView | None, robot: Pose2, stamp_s: float) -> ColourFloor | None:
        """The floor in one picture.

        Args:
            colour: The picture with its camera in the body frame.
            robot: Where it was taken, map frame.
            stamp_s: When, s.

        Returns:
            None without a picture, or for a picture that does not fit its camera.
        """
        if colour is None or colour.T_body_camera is None:
            return None
        try:
            placed = robot.lifted() @ colour.T_body_camera
            picture = Picture(colour.rgb, colour.camera, placed, stamp_s)
        except InputError as error:
            LOG.warning("%.1f s: picture not used: %s", stamp_s, error)
            return None
        result = self._monocular.cycle(self._previous if self._flow else None, picture)
        self._previous = picture
        contacts = floor_contacts(result)
        found = detections(contacts, robot, DETECT_TO_M)
        return ColourFloor(result, contacts, tuple(found), robot)


def either(
    *visible: Callable[[np.ndarray], np.ndarray],
) -> Callable[[np.ndarray], np.ndarray]:
    """Visibility by any of several sensors."""

    def seen(places: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, "n"]:
        return np.any([one(places) for one in visible], axis=0)

    return seen
