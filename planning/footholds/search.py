"""Footsteps over surfaces: A* from the standing foot to a goal, as far as the ground is known.

A node is a standing foot. From it the other foot goes to one of a discrete set of places: level steps ahead, to the side
and turned as on flat ground, and on every surface in reach the middle, and the places that are just clear of its nearer
and its farther side. A place counts only if the chance that the sole misses an edge there, and the chance that it leaves
what was seen, stay below a bound, and if no other surface is above it. The cost is the length of the path, weighted by the
map of obstacles where there is one, and a share for each footstep, turn, rise and chance. Stairs down cost more than
stairs up and allow shorter steps: the foot lands beyond an edge that hides its place.

The estimate of the rest is the length of the way on a coarse map of the surfaces, weighted, so that few nodes are expanded and
a plan may cost more than the best (weighted A*). Where the goal is out of
what is known, the plan leads to the known place nearest to it. Plans are made anew at every step; each takes the
map as it is, with the slip of one step.

Source: after Chestnutt et al. 2005 (A* over footsteps), Griffin et al. 2019 (on plane regions); the rest ours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from jaxtyping import Float

from mapping.ground.surface import Surface
from perception.primitives.errors import ConfigError
from perception.primitives.pose import Pose2
from perception.primitives.robot_model import RobotModel
from perception.primitives.settings import setting

from ..commands import WalkCommand
from ..search.path import Terrain
from . import _search_kernels as kernels
from .foothold import Foothold, FootNoise, packed

DESCENT = 0.9  # ours: length of a step down, relative to one up
SLOPE = math.tan(math.radians(5.0))  # ours: of ground on which a level sole stands
FARTHEST_M = 12.0  # ours: of a goal from the robot; the coarse map reaches there
# Ours: that a plan looks ahead, of the longest ones, on and between levels.
LEVEL_STEPS, RISES = 6, 3
NODES = 140  # ours: that a search expands at most while the robot walks on
STEP, TURN, RISE, FALL, CHANCE = 0.5, 1.0, 1.0, 2.0, 4.0
"""Ours: costs of a footstep, of a turn by 1 rad and of a chance as large as the bound, in longest steps; of a rise and of a
descent by 1 m, in m."""


@dataclass(frozen=True)
class FootholdConfig:
    """Choice of footholds."""

    risk: float = setting(
        0.01, "", "largest chance that a foot misses an edge, or leaves what was seen", "ours"
    )

    def __post_init__(self) -> None:
        if not 0.0 < self.risk < 0.5:
            raise ConfigError(f"footholds: risk={self.risk} must lie in (0, 0.5); 0.01 is usual")


@dataclass(frozen=True)
class Stance:
    """The standing foot: its middle and heading in the body frame, its height, and which it is (1 left, -1 right)."""

    foot: int
    pose: Pose2
    height_m: float = 0.0


class PlanEnd(IntEnum):
    """Where a plan ends."""

    GOAL = kernels.GOAL
    HORIZON = kernels.HORIZON
    """On the way to it, as far as plans are made."""
    BORDER = kernels.BORDER
    """At the place nearest to it that is known and in reach."""


@dataclass(frozen=True)
class FootstepPlan:
    """Footsteps to a goal.

    Args:
        footholds: One a step, body frame of the start.
        commands: The same as commands to the body.
        end: Where they lead.
        gain_m: By how much they shorten the way to the goal.
    """

    footholds: tuple[Foothold, ...]
    commands: tuple[WalkCommand, ...]
    end: PlanEnd
    gain_m: float = 0.0


def plan(
    surfaces: Sequence[Surface],
    stance: Stance,
    goal: Float[np.ndarray, "2"],
    near_m: float,
    robot: RobotModel,
    noise: FootNoise,
    config: FootholdConfig | None = None,
    ground: Terrain | None = None,
    nodes: int = NODES,
) -> FootstepPlan:
    """The next footsteps to a goal.

    Args:
        surfaces: Of the ground, body frame.
        stance: The foot that stays; the other one steps next.
        goal: (x, y), body frame, m.
        near_m: Distance from the frame between the feet to the goal at which it is reached.
        robot: Sole, stance, limits of steps.
        noise: Of the place at which a foot lands.
        config: Bound of the chances.
        ground: Cost of obstacles and movers, as of the search on flat ground, in the body frame.
        nodes: That the search expands at most; more find ways through narrow places, and take longer.

    Raises:
        ConfigError: Without a node to expand.
    """
    if nodes < 1:
        raise ConfigError(f"footholds: nodes={nodes} must be 1 or more; {NODES} is usual")
    config = config or FootholdConfig()
    sides, planes = packed(surfaces)
    if not len(sides):
        return FootstepPlan((), (), PlanEnd.BORDER)
    gait, steps = robot.gait, robot.steps
    goal = _within(goal, stance.pose)
    ahead = gait.max_speed_mps * gait.step_s
    limits = np.array([
        ahead, gait.max_back_mps * gait.step_s, gait.max_side_mps * gait.step_s, gait.max_turn_rad,
        steps.up_m, steps.down_m, steps.reach_m, DESCENT * steps.reach_m, SLOPE,
    ])  # fmt: skip
    costs = np.array([STEP * ahead, TURN * ahead, RISE, FALL, CHANCE * ahead])
    prices, blocked, grid = _grid(ground)
    start = np.array([*stance.pose.vector, stance.height_m, -1.0, stance.foot])
    reached, moves, last, end, gain_m = kernels.search(
        sides, planes, start, np.array([*goal, near_m], np.float64),
        np.array([robot.foot_m[0] / 2, robot.foot_m[1] / 2, robot.stance_m / 2, robot.radius_m]), limits, costs,
        noise.variances, config.risk, max(LEVEL_STEPS * ahead, RISES * steps.reach_m), nodes, prices, blocked, grid,
    )  # fmt: skip
    found, commands = [], []
    while last > 0:
        x, y, yaw, z, on, foot, _, missed, unseen, before = (float(v) for v in reached[last])
        forward, left, turn = (float(v) for v in moves[last])
        rise = z - float(reached[int(before), 3])
        found.append(Foothold(int(foot), Pose2(x, y, yaw), z, int(on), missed, unseen))
        commands.append(
            WalkCommand(
                forward, left, turn, gait.single_support_s, gait.double_support_s, rise_m=rise
            )
        )
        last = int(before)
    return FootstepPlan(tuple(found[::-1]), tuple(commands[::-1]), PlanEnd(int(end)), float(gain_m))


def _within(goal: Float[np.ndarray, "2"], pose: Pose2) -> Float[np.ndarray, "2"]:
    """The goal, or the place in its direction that is as far as plans go."""
    here = pose.vector[:2]
    away = goal - here
    return here + away * min(1.0, FARTHEST_M / max(float(np.linalg.norm(away)), 1e-9))


def _grid(
    ground: Terrain | None,
) -> tuple[Float[np.ndarray, "h w"], np.ndarray, Float[np.ndarray, "3"]]:
    """Costs, blocked cells, and place and size of the cells; nothing without a map."""
    if ground is None:
        return np.zeros((0, 0)), np.zeros((0, 0), np.bool_), np.array([0.0, 0.0, 1.0])
    return ground.price, ground.blocked, np.array([*ground.origin, ground.cell_m])
