"""The settings of planning: all that a planner is given besides its goals."""

from __future__ import annotations

from dataclasses import dataclass, field

from perception.primitives.robot_model import DARWIN_OP, RobotModel

from ..avoidance.choice import AvoidanceConfig
from ..exploration import ExplorationConfig
from ..footholds.search import FootholdConfig
from ..gaze.policy import GazeConfig
from ..safety.guard import GuardConfig
from ..search.potential import SearchConfig
from ..search.route import RouteConfig
from ..swarm.settings import SwarmWalkerConfig
from ..univector.fields import FieldConfig
from .mission import MissionConfig

BESIDE_GUARD = FieldConfig(
    gaze_coupling=False, virtual_obstacles=False, velocity_change=False, uncertainty=False
)
"""The published field without its additions: the guard does their work. Measured (001-E4): field alone 153 contacts on
100 courses, with the guard 1; all additions save none (on six courses 6 and 6)."""


@dataclass(frozen=True)
class PlanningConfig:
    """Settings of every part of planning.

    Args:
        seed: Of random choices.
        robot: Sizes of the body, limits of gait and head.
        cell_m: Side of a cell of the grid.
        mission: Goals, tolerances, time limit.
        search: Potential and grid search.
        route: When the path is searched anew.
        footholds: Where feet may stand on ground of several levels.
        exploration: Choice of places to visit.
        univector: Field of the planners "field" (to the goal) and "search" (to its via points).
        guard: Check of every step against predicted obstacles.
        swarm: The planner by one colour camera.
        avoidance: Choice of the avoidance motion.
        gaze: Choice of the gaze.
    """

    seed: int = 0
    robot: RobotModel = DARWIN_OP
    cell_m: float = 0.05
    mission: MissionConfig = field(default_factory=MissionConfig)
    search: SearchConfig = field(default_factory=SearchConfig)
    route: RouteConfig = field(default_factory=RouteConfig)
    footholds: FootholdConfig = field(default_factory=FootholdConfig)
    exploration: ExplorationConfig = field(default_factory=ExplorationConfig)
    univector: FieldConfig = BESIDE_GUARD
    guard: GuardConfig = field(default_factory=GuardConfig)
    swarm: SwarmWalkerConfig = field(default_factory=SwarmWalkerConfig)
    avoidance: AvoidanceConfig = field(default_factory=AvoidanceConfig)
    gaze: GazeConfig = field(default_factory=GazeConfig)
