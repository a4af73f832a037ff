"""A corridor with pedestrians who walk along it by social forces, and a unicycle that must get through.

The corridor, its pedestrians' places and speeds follow the public corridor scenario of the pedestrian simulator of the
laboratory that printed the task (oscardegroot/jackal_socialsim): 46 m by 6 m, pedestrians at 1.14 to 1.66 m/s of whom
one stream starts 3 to 15 m ahead and goes on, the other starts 20 to 35 m ahead and comes towards the robot.

Source: Trevisan et al. 2025 (arXiv 2506.21205), section V; Helbing and Molnar 1995 (social forces).
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from perception.primitives.gaussian import Gaussian
from perception.primitives.motion import Motion
from perception.primitives.obstacle import Obstacle
from perception.primitives.pose import Pose2
from perception.primitives.robot_model import GaitLimits, RobotModel
from planning.commands import WalkCommand
from planning.footsteps import footstep
from planning.safety.step_filter import StepFilter

LENGTH_M, WIDTH_M, GOAL_M = 46.0, 6.0, 35.0
BEGIN_M = -3.0
PERIOD_S, TICK_S = 0.2, 0.05
LONGEST_S = 60.0
PERSON_M = 0.3  # radius of a pedestrian
CELL_M = 0.2  # distance of the wall points that a planner is given
AHEAD_M = 12.0  # via point on the line of the corridor
PLACE_SIGMA_M, SPEED_SIGMA_MPS = 0.01, 0.05  # of the pedestrians as the planner is told
SPEEDS_MPS = (1.14, 1.66)
STREAMS = (((3.0, 15.0), (-1.0, 0.0), 35.0), ((20.0, 35.0), (0.0, 1.0), -35.0))
RELAX_S = 0.5  # Helbing and Molnar 1995, here and below
PUSH_M2PS2, RANGE_M = 2.1, 0.3
WALL_M2PS2, WALL_RANGE_M = 10.0, 0.2
BEHIND, SIGHT_RAD = 0.5, math.radians(100.0)
MOST = 1.3
ONLY_STRAIGHT, NEVER = np.array([0.0, 0.0, 1.0, 0.0, 0.0]), np.zeros((5, 5))

UNICYCLE = RobotModel(
    radius_m=0.33,
    gait=GaitLimits(
        cruise_mps=2.0, max_speed_mps=2.0, max_back_mps=0.5, max_side_mps=0.0,
        max_turn_deg=23.0, single_support_s=PERIOD_S, double_support_s=0.0,
    ),
)  # fmt: skip
"""2 m/s, turning at 2 rad/s, five decisions a second."""


@dataclass(frozen=True)
class Passage:
    """One run.

    Args:
        safe: Whether it touched nobody and no wall.
        arrived: Whether it came to the goal in time.
        seconds: Until the goal, or the end.
        decisions_ms: Computing time of every decision.
    """

    safe: bool
    arrived: bool
    seconds: float
    decisions_ms: tuple[float, ...]


class Crowd:
    """Pedestrians; who has arrived begins anew, so that their number stays."""

    def __init__(self, count: int, reacting: bool, rng: np.random.Generator) -> None:
        self._reacting, self._rng = reacting, rng
        self.state = np.zeros((count, 4))
        self._goals, self._speeds = np.zeros((count, 2)), np.zeros(count)
        for k in range(count):
            self._place(k)

    def _place(self, k: int) -> None:
        for _ in range(100):
            (x0, x1), (y0, y1), away = STREAMS[k % 2]
            x, y = self._rng.uniform(x0, x1), self._rng.uniform(y0, y1)
            others = np.delete(self.state, k, axis=0)
            if not len(others) or np.hypot(*(others[:, :2] - [x, y]).T).min() > 2.0 * PERSON_M:
                break
        self._speeds[k] = self._rng.uniform(*SPEEDS_MPS)
        self._goals[k] = x + away, y
        self.state[k] = x, y, math.copysign(self._speeds[k], away), 0.0

    def advance(self, dt: float, robot: Float[np.ndarray, "2"]) -> None:
        """Walk for one tick; the robot's place counts only if they react to it."""
        places, velocities = self.state[:, :2], self.state[:, 2:]
        to_goal = self._goals - places
        wish = to_goal / np.maximum(np.hypot(*to_goal.T), 1e-9)[:, None]
        force = (self._speeds[:, None] * wish - velocities) / RELAX_S
        others = np.concatenate([places, robot[None]]) if self._reacting else places
        away = places[:, None] - others[None]
        apart = np.maximum(np.hypot(away[..., 0], away[..., 1]), 1e-6)
        apart[np.arange(len(places)), np.arange(len(places))] = np.inf
        push = PUSH_M2PS2 / RANGE_M * np.exp(-(apart - 2.0 * PERSON_M) / RANGE_M)
        ahead = -np.einsum("nmi,ni->nm", away, wish) / apart
        push = np.where(ahead >= math.cos(SIGHT_RAD), push, BEHIND * push)
        force += np.nan_to_num(push[..., None] * away / apart[..., None]).sum(axis=1)
        for side in (1.0, -1.0):
            gap = WIDTH_M / 2.0 - side * places[:, 1] - PERSON_M
            force[:, 1] -= side * WALL_M2PS2 / WALL_RANGE_M * np.exp(-gap / WALL_RANGE_M)
        velocities = velocities + dt * force
        speed = np.hypot(*velocities.T)
        velocities *= np.minimum(1.0, MOST * self._speeds / np.maximum(speed, 1e-9))[:, None]
        self.state[:, 2:], self.state[:, :2] = velocities, places + dt * velocities
        limit = WIDTH_M / 2.0 - PERSON_M
        self.state[:, 1] = np.clip(self.state[:, 1], -limit, limit)
        for k in np.flatnonzero(np.abs(to_goal[:, 0]) < 1.0):
            self._place(int(k))

    def tracks(self, stamp_s: float) -> list[Obstacle]:
        """The pedestrians as a planner is told of them: place and velocity, to be predicted straight on."""
        P = np.diag([PLACE_SIGMA_M, PLACE_SIGMA_M, SPEED_SIGMA_MPS, SPEED_SIGMA_MPS]) ** 2
        found = []
        for k, state in enumerate(self.state):
            straight = Gaussian(state.copy(), P)
            motion = Motion(
                ONLY_STRAIGHT,
                np.tile(state, (5, 1)),
                np.tile(P, (5, 1, 1)),
                NEVER,
                P[2:, 2:],
                straight,
            )
            found.append(Obstacle(straight, PERSON_M, 1.7, k, 1.0, stamp_s, 0.0, motion))
        return found


def passage(
    make: Callable[[RobotModel], StepFilter], count: int, reacting: bool, seed: int
) -> Passage:
    """One run of the unicycle through the corridor.

    Args:
        make: The check on every step, for a robot.
        count: Of pedestrians.
        reacting: Whether they see the robot.
        seed: Of their places and speeds.
    """
    rng = np.random.default_rng([seed, count, int(reacting)])
    crowd, steps = Crowd(count, reacting, rng), make(UNICYCLE)
    walls = _walls()
    pose, last, taken = Pose2(), WalkCommand(), []
    sure = np.diag([1e-4, 1e-4, 1e-4])
    for cycle in range(round(LONGEST_S / PERIOD_S)):
        stamp = cycle * PERIOD_S
        target = np.array([min(pose.x + AHEAD_M, GOAL_M), 0.0])
        heading = math.atan2(target[1] - pose.y, target[0] - pose.x)
        desired = footstep(heading, UNICYCLE.gait.cruise_mps, pose, UNICYCLE.gait)
        begun = time.thread_time()
        command = steps.choose(
            desired, Gaussian(pose.vector, sure), crowd.tracks(stamp), walls, target, stamp
        )
        taken.append(1e3 * (time.thread_time() - begun))
        for tick in range(round(PERIOD_S / TICK_S)):
            # the body follows its commands by half a period
            doing = last if tick < PERIOD_S / TICK_S / 2 else command
            share = TICK_S / PERIOD_S
            pose = pose @ Pose2(doing.forward_m * share, 0.0, doing.turn_rad * share)
            crowd.advance(TICK_S, np.array([pose.x, pose.y]))
            gap = np.hypot(*(crowd.state[:, :2] - [pose.x, pose.y]).T).min()
            at_wall = WIDTH_M / 2.0 - abs(pose.y) <= UNICYCLE.radius_m
            if gap <= UNICYCLE.radius_m + PERSON_M or at_wall:
                return Passage(False, False, stamp, tuple(taken))
            if pose.x >= GOAL_M:
                return Passage(True, True, stamp + (tick + 1) * TICK_S, tuple(taken))
        last = command
    return Passage(True, False, LONGEST_S, tuple(taken))


def _walls() -> Float[np.ndarray, "n 2"]:
    """Middles of occupied cells along both walls."""
    x = np.arange(BEGIN_M, BEGIN_M + LENGTH_M, CELL_M)
    return np.concatenate([np.column_stack([x, np.full(len(x), s * WIDTH_M / 2)]) for s in (1, -1)])
