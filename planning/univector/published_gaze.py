"""The gaze policy as published: four evaluations, their integration map, and the middle of its highest plateau.

It has neither the survey nor the additions of `policy.EvaluationGaze`: no search for obstacles out of sight, no
urgency of the path, no gain of landmarks, no preference for the present direction. Two points that the paper leaves
open: a known landmark serves localisation in place of an obstacle, and the stale ground counts where it is, since its
mean may be fresh.

Source: Yoo 2010 (seed 001), section 3, eq. (1) to (6), and eq. (7) and (11) for the extended shapes of eq. (4).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from perception.primitives.obstacle import MOVING, Obstacle
from perception.primitives.robot_model import DARWIN_OP, RobotModel

from ..gaze import evaluations
from ..gaze.attention import GazeContext
from ..gaze.policy import GazeConfig, MapGaze
from ..gaze.sampling import from_camera, in_body, sample_region
from ..gaze.selection import GazeMapConfig, gaze_map, in_view
from .fields import FieldConfig, extended_radius
from .virtual_obstacle import virtual_obstacle


class PublishedGaze(MapGaze):
    """One gaze per footstep by eq. (1) to (6)."""

    def __init__(self, config: GazeConfig, robot: RobotModel = DARWIN_OP) -> None:
        """`config` is not used: thresholds and weights are those of the specification."""
        super().__init__(GazeMapConfig(head=robot.head), robot)
        self._field = FieldConfig()

    def total(
        self, via: Float[np.ndarray, "2"], obstacles: Sequence[Obstacle], known: GazeContext
    ) -> Float[np.ndarray, "rows columns"]:
        """GM over pan and tilt, eq. (6)."""
        pose, eye, limits = known.pose, self.robot.eye_m, self.map.evaluation
        stale, psi_map = self._stale(known)
        here = np.array([o.position for o in obstacles]).reshape(-1, 2)
        places = in_body(pose, here)
        c, s = math.cos(pose.mean[2]), math.sin(pose.mean[2])
        moves = np.array([o.moving >= MOVING for o in obstacles], np.bool_)
        velocities = np.array([o.velocity for o in obstacles]).reshape(-1, 2) * moves[:, None]
        velocities = velocities @ np.array([[c, -s], [s, c]])
        counted = concerned(places, velocities, self.robot.gait.cruise_mps)
        places, velocities = places[counted], velocities[counted]
        radii = np.array([o.radius_m for o in obstacles])[counted]
        covariances = np.array([o.state.covariance[:2, :2] for o in obstacles]).reshape(-1, 2, 2)
        psi_self = evaluations.of_self(pose.covariance, limits)
        psi = evaluations.of_obstacles(places, velocities, covariances[counted], limits)
        psi_way = self._psi_way(places, velocities, radii, psi_self + psi)
        marks = np.array([mark.position for mark in known.landmarks]).reshape(-1, 3)
        return gaze_map(
            *(psi_map, stale, psi_way, from_camera(pose, via[None], eye)[0], psi_self, psi),
            *(from_camera(pose, here[counted], eye), self.map),
            from_camera(pose, marks[:, :2], eye, marks[:, 2]),
        )

    def _psi_way(
        self,
        places: Float[np.ndarray, "n 2"],
        velocities: Float[np.ndarray, "n 2"],
        radii: Float[np.ndarray, "n"],
        psi: Float[np.ndarray, "n"],
    ) -> float:
        """psi_way: by the nearest extended obstacle or virtual obstacle, eq. (4)."""
        speed, config = self.robot.gait.cruise_mps, self._field
        sizes = extended_radius(
            radii, np.hypot(*velocities.T), psi, config, self.robot.radius_m
        ).tolist()
        discs = [*zip(places, sizes, strict=True)]
        for place, velocity, size, value in zip(places, velocities, sizes, psi, strict=True):
            extra = virtual_obstacle(place, velocity, speed, size, float(value), config)
            if extra is not None:
                discs.append((extra.place, extra.radius_m))
        return evaluations.of_way(
            np.array([place for place, _ in discs]).reshape(-1, 2),
            np.array([size for _, size in discs]),
            self.map.evaluation,
        )

    def _stale(self, known: GazeContext) -> tuple[Float[np.ndarray, "n 3"], float]:
        """Stale sample points out of view, relative to the camera, m, and psi_lm, eq. (1)."""
        if known.grid is None or known.confidence is None:
            return np.zeros((0, 3)), 0.0
        points, values = sample_region(known.grid, known.confidence, known.pose, self.map)
        seen = from_camera(known.pose, points, self.robot.eye_m)
        out = ~in_view(seen, self.present, self.map)
        stale = out & (values < known.confidence.config.stale_below)
        count = int(stale.sum())
        return seen[stale], evaluations.of_map(count, int(out.sum()) - count)


def concerned(
    places: Float[np.ndarray, "n 2"], velocities: Float[np.ndarray, "n 2"], speed_mps: float
) -> Bool[np.ndarray, "n"]:
    """The set of eq. (3): obstacles ahead, and those behind that approach.

    Args:
        places, velocities: In the body frame (x ahead), m and m/s.
        speed_mps: Forward speed of the robot.
    """
    approach = np.sum(places * (velocities - np.array([speed_mps, 0.0])), axis=1) < 0.0
    return np.asarray((places[:, 0] > 0.0) | approach)
