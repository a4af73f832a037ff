"""A dynamic window among movers: the usual local planner, kept as a peer of field and guard.

Every speed and turn that the next step allows is held for a while; those that keep clear of everything, each
mover going straight on, are valued by heading, clearance and speed. Cruising speed is fast enough: a peer that
walks faster than the others is compared with nobody. Faster is for getting out of the way.

Source: Fox, Burgard, Thrun, "The dynamic window approach to collision avoidance" (IEEE Robotics and Automation
Magazine 4, 1997); movers at constant velocity as in Seder, Petrovic, "Dynamic window based approach to mobile
robot motion control in the presence of moving obstacles" (ICRA 2007).
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
from perception.primitives.robot_model import DARWIN_OP, RobotModel

from ..commands import WalkCommand
from ..footsteps import limited_step
from . import _baseline_kernels as kernels
from .step_filter import BASELINE_CELL_M


@dataclass(frozen=True)
class DynamicWindowConfig:
    """Samples, horizon and weights."""

    speeds: int = 9  # ours: from back to cruise, and top speed
    turns: int = 15  # ours: from right to left
    horizon_s: float = 5.2  # ours: eight steps
    margin_m: float = 0.05  # as the guard's
    w_heading: float = 0.8  # Fox 1997: 2 of 2.4, here of 1
    w_clear: float = 0.1  # Fox 1997: 0.2
    w_speed: float = 0.1  # Fox 1997: 0.2
    clear_m: float = 0.5  # ours: farther is clear

    def __post_init__(self) -> None:
        if self.speeds < 2 or self.turns < 2:
            raise ConfigError(
                f"dynamic window: speeds={self.speeds} and turns={self.turns} must be at least 2"
            )
        for name in ("horizon_s", "clear_m"):
            if not getattr(self, name) > 0.0:
                raise ConfigError(f"dynamic window: {name}={getattr(self, name)} must be positive")


class DynamicWindow:
    """Chooses a speed and a turn for every step; without memory."""

    def __init__(
        self, config: DynamicWindowConfig | None = None, robot: RobotModel = DARWIN_OP
    ) -> None:
        self._config = config or DynamicWindowConfig()
        self._robot = robot

    def choose(
        self,
        desired: WalkCommand,
        robot: Gaussian,
        obstacles: Sequence[Obstacle],
        occupied: Float[np.ndarray, "n 2"],
        target: Float[np.ndarray, "2"],
        stamp_s: float,
    ) -> WalkCommand:
        """The step of the best pair; if no pair keeps clear, the one that does so longest."""
        config, gait = self._config, self._robot.gait
        if desired == WalkCommand():
            return desired  # it is looking round
        movers = [o for o in obstacles if o.moving >= MOVING]
        discs = np.array(
            [[*o.position, *o.velocity, o.radius_m + self._robot.radius_m] for o in movers]
        ).reshape(-1, 5)
        slow = np.linspace(-gait.max_back_mps, gait.cruise_mps, config.speeds)
        speeds = np.append(slow, gait.max_speed_mps)  # linspace ends at cruise exactly
        turns = np.linspace(-gait.max_turn_rad, gait.max_turn_rad, config.turns)
        pairs = np.stack(np.meshgrid(speeds, turns, indexing="ij"), axis=-1).reshape(-1, 2)
        found = np.empty((len(pairs), 3))
        near = np.hypot(*(occupied - robot.mean[:2]).T) < 1.2
        kernels.hold_speeds(
            robot.mean.astype(np.float64),
            pairs,
            gait.step_s,
            round(config.horizon_s / gait.step_s),
            discs,
            np.ascontiguousarray(occupied[near], np.float64),
            self._robot.breadth * BASELINE_CELL_M,
            target.astype(np.float64),
            found,
        )
        gap, clear_s, off = found.T
        worth = config.w_heading * (1.0 - off / math.pi)
        worth += config.w_clear * np.clip(gap / config.clear_m, 0.0, 1.0)
        worth += config.w_speed * pairs[:, 0] / gait.max_speed_mps
        worth -= pairs[:, 0] > gait.cruise_mps  # faster only where nothing slower keeps clear
        admissible = gap > config.margin_m
        best = int(np.argmax(np.where(admissible, worth, -10.0 + clear_s + gap)))
        speed, turn = (float(v) for v in pairs[best])
        return limited_step(gait, speed, 0.0, turn)
