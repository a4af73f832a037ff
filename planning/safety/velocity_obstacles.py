"""Velocity obstacles: the velocity nearest to the wanted one that touches nothing soon; a peer of the guard.

Each mover and each cell near by forbids the velocities that would bring the robot to it within a time horizon. The
robot takes the rest of avoiding upon itself, since blind movers take none. Of a fan of velocities
the one with the least penalty is chosen: distance to the wanted velocity plus the inverse of the time to contact.

Source: Fiorini, Shiller, "Motion planning in dynamic environments using velocity obstacles" (IJRR 17, 1998);
penalty by time to contact after van den Berg, Lin, Manocha, "Reciprocal velocity obstacles" (ICRA 2008).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from perception.primitives.errors import ConfigError
from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import MOVING, Obstacle
from perception.primitives.pose import Pose2
from perception.primitives.robot_model import DARWIN_OP, RobotModel

from ..commands import WalkCommand
from ..footsteps import footstep
from . import _baseline_kernels as kernels
from .step_filter import BASELINE_CELL_M


@dataclass(frozen=True)
class VelocityObstacleConfig:
    """Samples, horizon and weight."""

    directions: int = 48  # ours
    speeds: int = 4  # ours: up to top speed; and standing
    horizon_s: float = 8.0  # ours: as far as the guard looks
    margin_m: float = 0.05  # as the guard's
    cell_horizon_s: float = 2.0  # ours: what stands is the route's business until it is near
    weight_m: float = 0.2  # van den Berg 2008: w, here m (speed times time to contact)

    def __post_init__(self) -> None:
        if self.directions < 4 or self.speeds < 1:
            raise ConfigError(
                f"velocity obstacles: directions={self.directions} must be at least 4 and "
                f"speeds={self.speeds} at least 1"
            )
        if not self.horizon_s > 0.0:
            raise ConfigError(f"velocity obstacles: horizon_s={self.horizon_s} must be positive")


class VelocityObstacles:
    """Chooses a velocity for every step; without memory."""

    def __init__(
        self, config: VelocityObstacleConfig | None = None, robot: RobotModel = DARWIN_OP
    ) -> None:
        self._config = config or VelocityObstacleConfig()
        self._robot = robot
        angles = np.arange(self._config.directions) * 2.0 * math.pi / self._config.directions
        rates = robot.gait.max_speed_mps * (1 + np.arange(self._config.speeds))
        rates = rates / self._config.speeds
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
    ) -> WalkCommand:
        """The step towards the velocity of least penalty."""
        config, gait = self._config, self._robot.gait
        if desired == WalkCommand():
            return desired  # it is looking round
        wanted = target - robot.mean[:2]
        wanted = gait.cruise_mps * wanted / max(float(np.hypot(*wanted)), 1e-9)
        movers = [o for o in obstacles if o.moving >= MOVING]
        reach = self._robot.radius_m + config.margin_m
        discs = [[*o.position, *o.velocity, o.radius_m + reach, config.horizon_s] for o in movers]
        near = occupied[np.hypot(*(occupied - robot.mean[:2]).T) < 0.5]
        cell_m = self._robot.breadth * BASELINE_CELL_M
        cells = [[float(x), float(y), 0.0, 0.0, cell_m, config.cell_horizon_s] for x, y in near]
        velocities = np.concatenate([wanted[None], self._fan])
        contact_s = np.empty(len(velocities))
        kernels.times_to_contact(
            robot.mean[:2].astype(np.float64),
            velocities,
            np.array([*discs, *cells], np.float64).reshape(-1, 6),
            contact_s,
        )
        penalty = np.hypot(*(velocities - wanted).T) + config.weight_m / np.maximum(contact_s, 0.1)
        best = velocities[int(np.argmin(penalty))]
        speed = float(np.hypot(*best))
        pose = Pose2(*(float(v) for v in robot.mean))
        heading = math.atan2(best[1], best[0]) if speed > 0.0 else pose.yaw
        return footstep(heading, speed, pose, gait)
