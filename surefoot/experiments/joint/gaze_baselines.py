"""Gaze policies for comparison: random, coverage, information gain, and an oracle that knows the truth.

Source: coverage and information gain as usual in active perception (Bajcsy, Aloimonos and Tsotsos 2018, review);
forms and numbers ours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from perception.obstacles.tracker import TrackerConfig
from perception.primitives.gaussian import deviation
from perception.primitives.landmark import Landmark
from perception.primitives.obstacle import MOVING, Obstacle
from perception.primitives.pose import Pose2
from perception.primitives.robot_model import RobotModel
from planning.commands import GazeCommand
from planning.gaze.attention import TAG_BEARING_RAD, TAG_RANGE_PER_M, TAG_REACH_M, GazeContext
from planning.gaze.landmark_gain import gains
from planning.gaze.policy import AHEAD, GazeConfig, MapGaze
from planning.gaze.sampling import from_camera, sample_region
from planning.gaze.selection import GazeMapConfig, shown

if TYPE_CHECKING:
    from ..support.geometric_perception import GeometricPerception

DETECTION_M = 0.02  # standard deviation of a detection
NEAR_M = 2.0  # movers within this distance count
OBLIQUE_RAD = math.radians(65.0)  # greatest viewing angle at which a tag is decoded
LOST_M = TrackerConfig().largest_sigma_m  # of a mover without a track


class RandomGaze:
    """Any pan, the tilt of the sweep."""

    def __init__(self, config: GazeConfig, robot: RobotModel) -> None:
        self._rng = np.random.default_rng(0)
        self._most = math.radians(robot.head.pan_deg)

    def next(
        self,
        stamp_s: float,
        robot: Pose2,
        via: Float[np.ndarray, "2"],
        obstacles: Sequence[Obstacle],
        known: GazeContext | None = None,
    ) -> GazeCommand:
        """Uniform over the range of the neck."""
        return GazeCommand(float(self._rng.uniform(-self._most, self._most)), AHEAD.tilt_rad)


class BaselineGaze(MapGaze):
    """What the values of these policies are made of."""

    def __init__(self, config: GazeConfig, robot: RobotModel) -> None:
        super().__init__(GazeMapConfig(head=robot.head, step_deg=3.0), robot)

    def stale(self, known: GazeContext) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n"]]:
        """Cells of the sampling region, world frame, m, and their staleness in [0, 1]; none without a grid."""
        if known.grid is None or known.confidence is None:
            return np.zeros((0, 2)), np.zeros(0)
        cells, confidence = sample_region(known.grid, known.confidence, known.pose, self.map)
        limit = 1.0 - known.confidence.config.stale_below
        return cells, np.minimum((1.0 - confidence.astype(float)) / limit, 1.0)

    def of_points(
        self, known: GazeContext, places: Float[np.ndarray, "n 2"], worth: Float[np.ndarray, "n"]
    ) -> Float[np.ndarray, "rows columns"]:
        """Total worth of the floor points that each direction shows."""
        return shown(from_camera(known.pose, places, self.robot.eye_m), worth, self.map)

    def of_marks(
        self, known: GazeContext, worth: Float[np.ndarray, "k"]
    ) -> Float[np.ndarray, "rows columns"]:
        """The same of the landmarks."""
        marks = np.array([mark.position for mark in known.landmarks]).reshape(-1, 3)
        seen = from_camera(known.pose, marks[:, :2], self.robot.eye_m, marks[:, 2])
        return shown(seen, worth, self.map)

    def shares(self, known: GazeContext) -> Float[np.ndarray, "k"]:
        """Relative reduction of the deviation of the position by a sighting of each landmark within reach."""
        marks = np.array([mark.position for mark in known.landmarks]).reshape(-1, 3)
        offsets = marks[:, :2] - known.pose.mean[:2]
        found = gains(offsets, known.pose.covariance, TAG_RANGE_PER_M, TAG_BEARING_RAD)
        return np.where(np.hypot(*offsets.T) <= TAG_REACH_M, found, 0.0)


class CoverageGaze(BaselineGaze):
    """The direction that shows the most stale ground."""

    def total(
        self, via: Float[np.ndarray, "2"], obstacles: Sequence[Obstacle], known: GazeContext
    ) -> Float[np.ndarray, "rows columns"]:
        """Sum of the staleness in view."""
        return self.of_points(known, *self.stale(known))


class InformationGaze(BaselineGaze):
    """The direction with the largest expected gain of information, in nats.

    A mover's position gains log of its deviation before and after a detection; the pose likewise by a landmark; a
    stale cell the entropy of a cell of which nothing is known.
    """

    def total(
        self, via: Float[np.ndarray, "2"], obstacles: Sequence[Obstacle], known: GazeContext
    ) -> Float[np.ndarray, "rows columns"]:
        """Sum of the gains of all that is in view."""
        cells, staleness = self.stale(known)
        total = self.of_points(known, cells, math.log(2.0) * staleness)
        movers = [one for one in obstacles if one.moving >= MOVING]
        places = np.array([one.position for one in movers]).reshape(-1, 2)
        spread = np.array([one.state.covariance[:2, :2] for one in movers]).reshape(-1, 2, 2)
        worth = 0.5 * np.log(np.linalg.det(np.eye(2) + spread / DETECTION_M**2))
        total += self.of_points(known, places, worth)
        return total + self.of_marks(known, -np.log1p(-np.minimum(self.shares(known), 0.999)))


class OracleGaze(BaselineGaze):
    """Knows the truth: where the movers are, what is hidden, and the figures by which a gaze is judged.

    It takes the direction that at once reduces most the sum of the shares of stale ground in view, of the deviation of
    the position, and of the deviation of each mover nearby. One direction at a time, like everybody.
    """

    def watch(self, perception: GeometricPerception) -> None:
        """Take the truth from here."""
        self._truth = perception

    def total(
        self, via: Float[np.ndarray, "2"], obstacles: Sequence[Obstacle], known: GazeContext
    ) -> Float[np.ndarray, "rows columns"]:
        """Sum of the relative reductions of all that is in view and not hidden."""
        true = self._truth.truth.robot_pose()
        here = np.array([true.x, true.y])
        cells, staleness = self.stale(known)
        free = self._truth.free_m(true, cells) > np.hypot(*(cells - here).T)
        total = self.of_points(known, cells[free], staleness[free] / max(len(cells), 1))
        worth = []
        movers = self._truth.discs[: self._truth.movers]
        for k, (x, y, radius) in enumerate(movers.tolist()):
            place = np.array([x, y])
            away = float(np.hypot(*(place - here)))
            clear = self._truth.free_m(true, place[None], without=k)[0] > away
            near = [o for o in obstacles if np.hypot(*(o.position - place)) < 3.0 * radius]
            sigmas = [deviation(o.state.covariance[:2, :2]) for o in near]
            sigma = min(sigmas, default=LOST_M)
            reduced = max(sigma - DETECTION_M, 0.0) / LOST_M
            worth.append(reduced if clear and away < NEAR_M else 0.0)
        total += self.of_points(known, movers[:, :2], np.array(worth))
        seen = np.array([self._decodable(mark, true) for mark in known.landmarks], np.bool_)
        return total + self.of_marks(known, np.where(seen, self.shares(known), 0.0))

    def _decodable(self, mark: Landmark, true: Pose2) -> bool:
        """Whether a look at a tag from here would decode it: near, not too oblique, not hidden."""
        place = np.array(mark.position[:2])
        apart = place - (true.x, true.y)
        away, direction = math.hypot(*apart), math.atan2(apart[1], apart[0])
        if away > TAG_REACH_M or self._viewing_angle(place, direction) > OBLIQUE_RAD:
            return False
        return bool(self._truth.free_m(true, place[None])[0] >= away - 0.1)

    def _viewing_angle(self, place: Float[np.ndarray, "2"], direction_rad: float) -> float:
        """Angle between the line of sight and the normal of the wall that a tag hangs on."""
        x0, y0, x1, y1 = self._truth.walls
        gaps = np.array([place[0] - x0, x1 - place[0], place[1] - y0, y1 - place[1]])
        across = abs(math.cos(direction_rad)) if gaps.argmin() < 2 else abs(math.sin(direction_rad))
        return math.acos(min(across, 1.0))
