"""The dynamic window approach among moving obstacles, a baseline for the guard.

Every pair of speed and turn that the next step allows is rolled out. Pairs that keep clear of all obstacles, each at
constant velocity, are scored by heading, clearance and speed. The usual speed is the cruising speed, so that walking
times are comparable; higher speeds are for evasion only.

Source: Fox, Burgard, Thrun, "The dynamic window approach to collision avoidance" (IEEE Robotics and Automation
Magazine 4, 1997); moving obstacles as in Seder, Petrovic, "Dynamic window based approach to mobile robot motion
control in the presence of moving obstacles" (ICRA 2007).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import MOVING, Obstacle
from perception.primitives.robot_model import DARWIN_OP, RobotModel
from planning.commands import WalkCommand
from planning.footsteps import limited_step

from . import _baseline_kernels as kernels

SPEEDS, TURNS = 9, 15  # ours: from backwards to cruise, and top speed; from right to left
HORIZON_S = 5.2  # ours: eight steps
NEAR_M = 1.2  # ours: farther cells are out of reach
CLEAR_M = 0.5  # ours: clearance that scores fully
BASELINE_CELL_M = 0.17
"""Ours: distance that the baselines keep from the middle of an occupied cell, for a DARwIn-OP."""

BASELINE_MARGIN_M = 0.05
"""Ours: margin of the baselines to moving obstacles, as the guard's default."""

HEADING, CLEARANCE, SPEED = 0.8, 0.1, 0.1  # Fox 1997: weights of 2, 0.2 and 0.2, here of a sum of 1


class DynamicWindow:
    """Chooses a speed and a turn for every step; without memory."""

    def __init__(self, robot: RobotModel = DARWIN_OP) -> None:
        self._robot = robot

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
        """The step of the best pair; if no pair keeps clear, of the pair with the latest contact."""
        gait = self._robot.gait
        if desired == WalkCommand():
            return desired  # the robot stands to look round
        moving = [o for o in obstacles if o.moving >= MOVING]
        discs = np.array(
            [[*o.position, *o.velocity, o.radius_m + self._robot.radius_m] for o in moving]
        ).reshape(-1, 5)
        slow = np.linspace(-gait.max_back_mps, gait.cruise_mps, SPEEDS)
        speeds = np.append(slow, gait.max_speed_mps)
        turns = np.linspace(-gait.max_turn_rad, gait.max_turn_rad, TURNS)
        pairs = np.stack(np.meshgrid(speeds, turns, indexing="ij"), axis=-1).reshape(-1, 2)
        found = np.empty((len(pairs), 3))
        near = np.hypot(*(occupied - robot.mean[:2]).T) < NEAR_M
        kernels.hold_speeds(
            robot.mean.astype(np.float64),
            pairs,
            gait.step_s,
            round(HORIZON_S / gait.step_s),
            discs,
            np.ascontiguousarray(occupied[near], np.float64),
            self._robot.breadth * BASELINE_CELL_M,
            target.astype(np.float64),
            found,
        )
        gap, clear_s, off = found.T
        worth = HEADING * (1.0 - off / math.pi)
        worth += CLEARANCE * np.clip(gap / CLEAR_M, 0.0, 1.0)
        worth += SPEED * pairs[:, 0] / gait.max_speed_mps
        worth -= pairs[:, 0] > gait.cruise_mps  # only where nothing slower keeps clear
        admissible = gap > BASELINE_MARGIN_M
        best = int(np.argmax(np.where(admissible, worth, -10.0 + clear_s + gap)))
        speed, turn = (float(v) for v in pairs[best])
        return limited_step(gait, speed, 0.0, turn)
