"""Velocity obstacles, a baseline for the guard: the velocity nearest to the wanted one without a contact soon.

Each moving obstacle and each cell nearby forbids the velocities that lead to it within a time horizon. The robot alone
avoids, since these obstacles do not. Of a fan of velocities it takes the one with the least penalty: the distance to
the wanted velocity plus the inverse of the time to contact.

Source: Fiorini, Shiller, "Motion planning in dynamic environments using velocity obstacles" (IJRR 17, 1998);
penalty by time to contact after van den Berg, Lin, Manocha, "Reciprocal velocity obstacles" (ICRA 2008).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import MOVING, Obstacle
from perception.primitives.pose import Pose2
from perception.primitives.robot_model import DARWIN_OP, RobotModel
from planning.commands import WalkCommand
from planning.footsteps import footstep

from . import _baseline_kernels as kernels
from .dynamic_window import BASELINE_CELL_M, BASELINE_MARGIN_M

DIRECTIONS, SPEEDS = 48, 4  # ours: the fan, up to top speed; and standing
HORIZON_S = 8.0  # ours: as the guard
CELL_HORIZON_S = 2.0  # ours: the route avoids static obstacles farther away
NEAR_M = 0.5  # ours: farther cells are out of reach within that time
WEIGHT_M = 0.2  # van den Berg 2008: w, here m (speed times time to contact)


class VelocityObstacles:
    """Chooses a velocity for every step; without memory."""

    def __init__(self, robot: RobotModel = DARWIN_OP) -> None:
        self._robot = robot
        angles = np.arange(DIRECTIONS) * 2.0 * math.pi / DIRECTIONS
        rates = robot.gait.max_speed_mps * (1 + np.arange(SPEEDS))
        rates = rates / SPEEDS
        fan = rates[:, None, None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        self._fan = np.concatenate([np.zeros((1, 2)), fan.reshape(-1, 2)])

    def choose(
        self,
        desired: WalkCommand,
        robot: Gaussian,
        obstacles: Sequence[Obstacle],
        occupied: Float[np.ndarray, "n 2"],
        target: Float[np.ndarray, "2"],
        stamp_s: float,
        unseen: Float[np.ndarray, "k 2"] | None = None,
    ) -> WalkCommand:
        """The step towards the velocity with the least penalty."""
        gait = self._robot.gait
        if desired == WalkCommand():
            return desired  # the robot stands to look round
        wanted = target - robot.mean[:2]
        wanted = gait.cruise_mps * wanted / max(float(np.hypot(*wanted)), 1e-9)
        moving = [o for o in obstacles if o.moving >= MOVING]
        reach = self._robot.radius_m + BASELINE_MARGIN_M
        discs = [[*o.position, *o.velocity, o.radius_m + reach, HORIZON_S] for o in moving]
        near = occupied[np.hypot(*(occupied - robot.mean[:2]).T) < NEAR_M]
        cell_m = self._robot.breadth * BASELINE_CELL_M
        cells = [[float(x), float(y), 0.0, 0.0, cell_m, CELL_HORIZON_S] for x, y in near]
        velocities = np.concatenate([wanted[None], self._fan])
        contact_s = np.empty(len(velocities))
        kernels.times_to_contact(
            robot.mean[:2].astype(np.float64),
            velocities,
            np.array([*discs, *cells], np.float64).reshape(-1, 6),
            contact_s,
        )
        penalty = np.hypot(*(velocities - wanted).T) + WEIGHT_M / np.maximum(contact_s, 0.1)
        best = velocities[int(np.argmin(penalty))]
        speed = float(np.hypot(*best))
        pose = Pose2(*(float(v) for v in robot.mean))
        heading = math.atan2(best[1], best[0]) if speed > 0.0 else pose.yaw
        return footstep(heading, speed, pose, gait)
