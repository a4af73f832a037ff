"""Where a head should look."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from perception.primitives.robot_model import DARWIN_OP, RobotModel
from planning.commands import GazeCommand
from planning.gaze import evaluations, selection
from planning.gaze.evaluations import EvaluationConfig
from planning.gaze.selection import GazeMapConfig

from . import checks
from .checks import ArrayLike


@dataclass(frozen=True, eq=False)
class GazeMap:
    """Worth of every direction of the head, and the best one.

    Args:
        values: (pans, tilts), GM of eq. (6), without unit.
        pans_rad: Of the rows, left positive.
        tilts_rad: Of the columns, down positive.
        best: Middle of the highest plateau: `pan_rad`, `tilt_rad`.
        psi_map, psi_self, psi_way: Evaluations (1), (2) and (4), in [0, 1].
        psi_obstacles: (n,), evaluation (3) of each obstacle; 0 for those behind that do not approach.
    """

    values: Float[np.ndarray, "rows columns"]
    pans_rad: Float[np.ndarray, "rows"]
    tilts_rad: Float[np.ndarray, "columns"]
    best: GazeCommand
    psi_map: float
    psi_self: float
    psi_way: float
    psi_obstacles: Float[np.ndarray, "n"]


def gaze_map(
    waypoint: ArrayLike,
    positions: ArrayLike = (),
    velocities: ArrayLike | None = None,
    covariances: ArrayLike | None = None,
    *,
    pose_covariance: ArrayLike | None = None,
    stale: ArrayLike = (),
    fresh: int = 0,
    radii_m: ArrayLike = 0.1,
    present: GazeCommand | None = None,
    robot_velocity: ArrayLike = (0.0, 0.0),
    robot: RobotModel = DARWIN_OP,
    **settings: Any,
) -> GazeMap:
    """The gaze map GM over pan and tilt, and where to look.

    All places are on the floor in the body frame: x ahead, y left, m.

    Args:
        waypoint: (2,), point that the robot walks to.
        positions: (n, 2), obstacles.
        velocities: (n, 2), their own, m/s; None: they stand.
        covariances: (n, 2, 2) of the positions, m^2; must be given with positions.
        pose_covariance: (3, 3) of the robot's (x, y, yaw), m and rad; None: the pose is known exactly.
        stale: (k, 2), N_lp sample points out of view whose confidence is below lambda_cf.
        fresh: N_cp, number of sample points out of view whose confidence is not.
        radii_m: One number or (n,), of the obstacles.
        present: Where the head looks now, which decides between equal plateaus; None: straight ahead.
        robot_velocity: (2,), m/s.
        robot: Range of the head, height of the camera, radius.
        settings: Fields of `planning.gaze.selection.GazeMapConfig`: weights, field of view, `step_deg`.

    Raises:
        InputError: An array has the wrong shape or is not finite, a covariance is none, or a setting is
            impossible.

    Source: seed 001, section 3, eq. (1) to (6).
    """
    checks.instance(robot, RobotModel, "robot")
    config = checks.configured(GazeMapConfig, {"head": robot.head, **settings}, "gaze_map")
    limits: EvaluationConfig = config.evaluation
    target = checks.numbers(waypoint, (2,), "waypoint")
    places = checks.numbers(positions, (None, 2), "positions")
    count = len(places)
    moved = checks.numbers(velocities, (count, 2), "velocities", 0.0)
    spreads = (
        np.zeros((0, 2, 2))
        if count == 0
        else checks.covariances(covariances, (count, 2, 2), "covariances")
    )
    radii = checks.radii(radii_m, count)
    own = (
        np.zeros((3, 3))
        if pose_covariance is None
        else checks.covariances(pose_covariance, (3, 3), "pose_covariance")
    )
    ground = checks.numbers(stale, (None, 2), "stale")
    speed = checks.numbers(robot_velocity, (2,), "robot_velocity")
    counted = _relevant(places, moved, speed)
    psi_obstacles = np.where(counted, evaluations.of_obstacles(places, moved, spreads, limits), 0.0)
    psi_way = evaluations.of_way(places[counted], radii[counted] + robot.radius_m, limits)
    psi_map = evaluations.of_map(len(ground), checks.whole(fresh, "fresh"))
    psi_self = evaluations.of_self(own, limits)
    values = selection.gaze_map(
        psi_map,
        _from_eye(ground, robot),
        psi_way,
        _from_eye(target[None], robot)[0],
        psi_self,
        psi_obstacles[counted],
        _from_eye(places[counted], robot),
        config,
    )
    now = checks.optional(present, GazeCommand, "present") or GazeCommand()
    best = selection.highest_plateau(values, now, config)
    return GazeMap(
        values, config.pans, config.tilts, best, psi_map, psi_self, psi_way, psi_obstacles
    )


def _from_eye(places: Float[np.ndarray, "n 2"], robot: RobotModel) -> Float[np.ndarray, "n 3"]:
    """Places on the floor relative to the camera above the body's origin, body axes, m."""
    return np.column_stack([places, np.full(len(places), -robot.eye_m)])


def _relevant(
    places: Float[np.ndarray, "n 2"],
    velocities: Float[np.ndarray, "n 2"],
    robot_velocity: Float[np.ndarray, "2"],
) -> Bool[np.ndarray, "n"]:
    """The set of eq. (3), O_dted|bappr: all obstacles ahead, and those behind that approach."""
    approaching = np.sum(places * (velocities - robot_velocity), axis=1) < 0.0
    return np.asarray((places[:, 0] > 0.0) | approaching)
