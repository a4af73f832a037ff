"""What a walk is to do: planner, goals, tolerances, time limit."""

from __future__ import annotations

import math
from dataclasses import dataclass

from perception.primitives import plugins
from perception.primitives.errors import ConfigError
from perception.primitives.settings import setting

PLANNERS = {
    "search": "planning.planners.search_planner:SearchPlanner",
    "field": "planning.planners.field_planner:FieldPlanner",
    "swarm": "planning.planners.swarm_planner:SwarmPlanner",
    "avoidance": "planning.planners.avoidance_planner:AvoidancePlanner",
    "footholds": "planning.planners.foothold_planner:FootholdPlanner",
}
"""Our planners: name to class."""

ON_LEVELS = "footholds"
"""The one of them for ground of several levels."""

ARRIVING = ("search", "field")
"""Those of them that can arrive with a given heading."""

EXPLORING = ("search",)
"""Those of them that explore."""


@dataclass(frozen=True)
class MissionConfig:
    """What a live run is to do."""

    planner: str = setting(
        "search",
        "",
        "search, field, swarm, avoidance, footholds (scenes of several levels), or package.module:Class",
        "ours",
    )
    goals: int = setting(1, "", "how many of the scene's goals, in order", "ours")
    look_about: bool = setting(
        True, "", "recover by panoramic scan and avoidance motion when stuck", "specification"
    )
    wander: bool = setting(
        False, "", "explore until the time is up, without goals", "seed 003, experiment E6"
    )
    tolerance_m: float = setting(
        0.10, "m", "distance at which a goal counts as reached", "seed 000"
    )
    headings_deg: tuple[float, ...] = setting(
        (), "deg", "heading to arrive with, one per goal; nan: any", "seed 001"
    )
    heading_tolerance_deg: float = setting(
        5.0, "deg", "error at which a heading counts as reached", "seed 001, E1"
    )
    time_limit_s: float = setting(
        300.0, "s", "end of the run", "ours: a walk of 6 m takes 90 to 150 s"
    )

    def __post_init__(self) -> None:
        problem = plugins.check(self.planner, PLANNERS, "planner")
        if problem is not None:
            raise ConfigError(f"mission: {problem}")
        own = self.planner not in PLANNERS
        if self.goals < 1:
            raise ConfigError(f"mission: goals={self.goals} must be at least 1")
        for name in ("tolerance_m", "time_limit_s", "heading_tolerance_deg"):
            if not getattr(self, name) > 0.0:
                raise ConfigError(f"mission: {name}={getattr(self, name)} must be positive")
        if self.wander and not own and self.planner not in EXPLORING:
            raise ConfigError(
                f"mission: planner={self.planner!r} walks to goals; leave wander off, or choose "
                f"{' or '.join(EXPLORING)}"
            )
        if any(math.isinf(heading) for heading in self.headings_deg):
            raise ConfigError(
                f"mission: headings_deg={self.headings_deg} must be finite; nan stands for any heading"
            )
        if self.headings_deg and not own and self.planner not in ARRIVING:
            raise ConfigError(
                f"mission: planner={self.planner!r} arrives with any heading; leave headings_deg empty, or "
                f"choose {' or '.join(ARRIVING)}"
            )
