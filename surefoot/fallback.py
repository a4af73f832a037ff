"""Walking on when depth fails: a planner by depth, and behind it the walker by colour.

While depth is trusted the first one decides and the second one does not exist. When trust is lost a walker
by colour sets out for the goals that are left; when trust returns it is forgotten. The maps are the
pipeline's and go on meanwhile.

Source: ours; seed 003 has no answer to a room without texture, seed 000 needs none.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace

from perception.depth.health import DepthTrust
from perception.estimate import Estimate
from perception.primitives.frame import Frame

from .config.schema import Config
from .planners import Decision, Planner
from .run.pipeline import Pipeline
from .swarm_planner import SwarmPlanner

LOG = logging.getLogger(__name__)

BY_COLOUR = "no depth: by colour"


class Fallback:
    """The planner that was asked for as long as depth is trusted, the swarm's while it is not."""

    def __init__(
        self, planner: Planner, config: Config, goals: Sequence[tuple[float, float]]
    ) -> None:
        """Set out.

        Args:
            planner: Who decides while depth is trusted.
            config: Of everything.
            goals: The same that the planner has.
        """
        self._planner = planner
        swarm = replace(config.swarm, goal_times_s=())  # goals are those of the planner
        self._config, self._goals = replace(config, swarm=swarm), goals
        self._by_colour: SwarmPlanner | None = None
        self.trust = DepthTrust(config.depth_trust)

    @property
    def reached(self) -> int:
        """Goals reached so far."""
        return self._planner.reached

    @property
    def looks(self) -> Sequence[object]:
        """What the planner saw by looking about, if it does."""
        return getattr(self._planner, "looks", ())

    def distance_to_goal(self, estimate: Estimate) -> float:
        """From the estimated pose to the present goal, m; 0 when all are reached."""
        return self._planner.distance_to_goal(estimate)

    def finished(self, estimate: Estimate) -> bool:
        """Whether the mission is over, as the planner sees it; goals are counted in both."""
        if self._by_colour is not None:
            self._by_colour.finished(estimate)
        return self._planner.finished(estimate)

    def notice(self, frame: Frame, estimate: Estimate, pipeline: Pipeline) -> None:
        """Take in one cycle."""
        self._planner.notice(frame, estimate, pipeline)
        if self._by_colour is not None:
            self._by_colour.notice(frame, estimate, pipeline)

    def decide(self, frame: Frame, estimate: Estimate, pipeline: Pipeline) -> Decision:
        """The next footstep by whom depth allows."""
        trusted = self.trust.update([(view.depth, view.floor) for view in estimate.views])
        if trusted and self._by_colour is not None:
            LOG.warning("%.1f s: depth is back", estimate.stamp_s)
            self._by_colour = None
        elif not trusted and self._by_colour is None:
            LOG.warning("%.1f s: no depth of the floor ahead: walking by colour", estimate.stamp_s)
            self._by_colour = SwarmPlanner(self._config, self._goals[self.reached :])
            self._by_colour.notice(frame, estimate, pipeline)
        if self._by_colour is None:
            return self._planner.decide(frame, estimate, pipeline)
        decision = self._by_colour.decide(frame, estimate, pipeline)
        return replace(decision, why=f"{BY_COLOUR}, {decision.why}")
