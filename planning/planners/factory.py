"""Planners by name, with the recovery and the fall-back that belong to them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

from perception.primitives import plugins

from ..plugin_calls import call
from .depth_loss_fallback import DepthLossFallback
from .mission import PLANNERS
from .planner import Planner
from .settings import PlanningConfig
from .stuck_recovery import StuckRecovery

BY_DEPTH = ("search", "field")
"""Planners that give way to the one by colour, or stand, while depth does not show the floor ahead."""

MEMBERS = ("reached", "observe", "decide", "distance_to_goal", "finished")


def make(
    config: PlanningConfig,
    goals: Sequence[tuple[float, float]],
    scan: bool = True,
    fall_back: bool = True,
) -> Planner:
    """The planner that the mission asks for.

    Args:
        config: Settings of planning.
        goals: Where to walk, one after the other, map frame, m.
        scan: Whether the robot has a depth camera for panoramic scans, which the recovery needs.
        fall_back: Whether the robot walks by colour while depth is lost; else it stands.

    Raises:
        InputError: A planner of the user's cannot be loaded or made.
    """
    mission = config.mission
    made = plugins.load(mission.planner, PLANNERS, "planner", MEMBERS)
    planner = cast(Planner, call(f"planner {mission.planner}", made, config, goals))
    if mission.wander or mission.planner not in BY_DEPTH:
        return planner
    if mission.planner == "search" and mission.look_about and scan:
        planner = StuckRecovery(planner, config, goals)
    return DepthLossFallback(planner, config, goals, fall_back)
