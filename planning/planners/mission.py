"""What a walk is to do: planner, goals, tolerances, time."""

from __future__ import annotations

import math
from dataclasses import dataclass

from perception.primitives.errors import ConfigError

PLANNERS = {
    "search": "navigator:Navigator",
    "field": "field_planner:FieldPlanner",
    "swarm": "swarm_planner:SwarmPlanner",
    "avoidance": "avoidance_planner:AvoidancePlanner",
}
"""Who may decide the next footstep: name to module and class of this package."""


ARRIVING = ("search", "field")
"""Those of them that walk by the univector field, which can arrive with a given heading."""


WANDERING = ("search",)
"""Those of them that explore."""


@dataclass(frozen=True)
class MissionConfig:
    """What a live run is to do."""

    planner: str = "search"  # the joint stack; see `planners`
    goals: int = 1  # how many of the scene's goals, in order
    look_about: bool = True  # specification: where the search finds no way, seed 004's motions
    wander: bool = False  # explore instead, until the time is up (seed 003, experiment E6)
    tolerance_m: float = 0.10  # seed 000: goal tolerance
    headings_deg: tuple[float, ...] = ()  # seed 001: to arrive with, one a goal; nan or none: any
    heading_tolerance_deg: float = 5.0  # seed 001, E1: arrival error
    time_limit_s: float = 300.0  # ours: a walk of 6 m takes 90 s, detours included 150 s

    def __post_init__(self) -> None:
        if self.planner not in PLANNERS:
            raise ConfigError(
                f"mission: planner={self.planner!r} is unknown; choose {', '.join(PLANNERS)}"
            )
        if self.goals < 1:
            raise ConfigError(f"mission: goals={self.goals} must be at least 1")
        for name in ("tolerance_m", "time_limit_s", "heading_tolerance_deg"):
            if not getattr(self, name) > 0.0:
                raise ConfigError(f"mission: {name}={getattr(self, name)} must be positive")
        if self.wander and self.planner not in WANDERING:
            raise ConfigError(
                f"mission: planner={self.planner!r} walks to goals; leave wander off, or choose "
                f"{' or '.join(WANDERING)}"
            )
        if any(math.isinf(heading) for heading in self.headings_deg):
            raise ConfigError(
                f"mission: headings_deg={self.headings_deg} must be finite; nan stands for any heading"
            )
        if self.headings_deg and self.planner not in ARRIVING:
            raise ConfigError(
                f"mission: planner={self.planner!r} arrives with any heading; leave headings_deg empty, or "
                f"choose {' or '.join(ARRIVING)}"
            )
