"""Fall-back while depth is lost: a planner by depth, replaced by the planner by colour.

While depth shows the floor ahead the given planner decides. When it does not, a swarm planner takes the remaining
goals; when depth returns it is dropped. Without a colour camera the robot stands: unseen ground is no floor.
Perception and maps go on meanwhile.

Source: ours; seed 003 does not treat rooms without texture, seed 000 needs no depth.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace

from ..commands import WalkCommand
from ..world_model import WorldModel
from .planner import Decision, Planner
from .settings import PlanningConfig
from .swarm_planner import SwarmPlanner

LOG = logging.getLogger(__name__)

BY_COLOUR = "no depth: by colour"
STANDS = "no depth: stand"


class DepthLossFallback:
    """The given planner while depth is healthy; the swarm planner, or none, while it is not."""

    def __init__(
        self,
        planner: Planner,
        config: PlanningConfig,
        goals: Sequence[tuple[float, float]],
        by_colour: bool = True,
    ) -> None:
        """Begin with the given planner.

        Args:
            planner: Decides while depth is healthy.
            config: Settings of planning.
            goals: Those of the planner.
            by_colour: Whether to walk by colour while depth is lost; else the robot stands.
        """
        self._planner, self._walks = planner, by_colour
        swarm = replace(config.swarm, goal_times_s=())  # the goals are the planner's, in order
        self._config, self._goals = replace(config, swarm=swarm), goals
        self._by_colour: SwarmPlanner | None = None

    @property
    def reached(self) -> int:
        """Goals reached so far."""
        return self._planner.reached

    @property
    def looks(self) -> Sequence[object]:
        """Panoramic scans that the planner made, for the report."""
        return getattr(self._planner, "looks", ())

    def distance_to_goal(self, world: WorldModel) -> float:
        """Distance from the estimated pose to the present goal, m; 0 when all are reached."""
        return self._planner.distance_to_goal(world)

    def finished(self, world: WorldModel) -> bool:
        """Whether the planner's mission is over; both planners count goals."""
        if self._by_colour is not None:
            self._by_colour.finished(world)
        return self._planner.finished(world)

    def observe(self, world: WorldModel) -> None:
        """Take in one frame."""
        self._planner.observe(world)
        if self._by_colour is not None:
            self._by_colour.observe(world)

    def decide(self, world: WorldModel) -> Decision:
        """The next footstep, by depth or by colour, or none."""
        healthy = world.estimate.depth_healthy
        if not healthy and not self._walks:
            return replace(self._planner.decide(world), walk=WalkCommand(), why=STANDS)
        if healthy and self._by_colour is not None:
            LOG.warning("%.1f s: depth is back", world.stamp_s)
            self._by_colour = None
        elif not healthy and self._by_colour is None:
            LOG.warning("%.1f s: no depth of the floor ahead: walking by colour", world.stamp_s)
            self._by_colour = SwarmPlanner(self._config, self._goals[self.reached :])
            self._by_colour.observe(world)
        if self._by_colour is None:
            return self._planner.decide(world)
        decision = self._by_colour.decide(world)
        return replace(decision, why=f"{BY_COLOUR}, {decision.why}")
