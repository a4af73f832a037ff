"""Who decides the next footstep: four planners behind one interface, chosen by `mission.planner`.

"search" is the joint stack of seeds 003 and 001 (`navigator`), "field" the univector field of seed 001
straight to the goal, "swarm" the map-free walker of seed 000, "avoidance" the one of seed 004 that stops
before what blocks it, looks about and chooses a motion.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol, cast, runtime_checkable

import numpy as np
from jaxtyping import UInt8

from perception.estimate import Estimate
from perception.primitives.frame import Frame
from planning.commands import GazeCommand, WalkCommand
from planning.planners.mission import PLANNERS

from .config.schema import Config
from .run.pipeline import Pipeline

BY_DEPTH = ("search", "field")
"""Who is replaced by the walker by colour while depth cannot be trusted."""


@dataclass(frozen=True)
class Decision:
    """What the body is asked to do, and why in a word.

    Args:
        walk: The next footstep.
        gaze: Where to look meanwhile.
        why: "survey", "walk", "guard", "blocked", or a planner's own word.
        timing_ms: Time of each stage, of planners that tell them apart.
        drawn: Draws what it was decided by, for people: RGB; None: nothing to show.
    """

    walk: WalkCommand
    gaze: GazeCommand
    why: str
    timing_ms: dict[str, float] = field(default_factory=dict, compare=False)
    drawn: Callable[[], UInt8[np.ndarray, "h w 3"]] | None = field(default=None, compare=False)


@runtime_checkable
class Planner(Protocol):
    """From what is known to the next footstep."""

    @property
    def reached(self) -> int:
        """Goals reached so far; for a planner that wanders, places visited."""
        ...

    def notice(self, frame: Frame, estimate: Estimate, pipeline: Pipeline) -> None:
        """Take in one cycle; called for every frame, before any decision about it."""
        ...

    def decide(self, frame: Frame, estimate: Estimate, pipeline: Pipeline) -> Decision:
        """The next footstep and gaze; called once per footstep."""
        ...

    def distance_to_goal(self, estimate: Estimate) -> float:
        """From the estimated pose to the present goal, m; 0 when there is none."""
        ...

    def finished(self, estimate: Estimate) -> bool:
        """Whether the mission is over; called once per frame."""
        ...


def make(config: Config, goals: Sequence[tuple[float, float]]) -> Planner:
    """The planner that the mission asks for.

    Args:
        config: Of everything.
        goals: Where to walk, one after the other, map frame, m.
    """
    mission = config.mission
    module, name = PLANNERS[mission.planner].split(":")
    planner = cast(
        Planner, getattr(importlib.import_module(f".{module}", __package__), name)(config, goals)
    )
    if mission.wander or mission.planner not in BY_DEPTH:
        return planner
    if mission.planner == "search" and mission.look_about and config.robot.tof:
        from .look_about import LookAbout  # it builds on what is defined here

        planner = LookAbout(planner, config, goals)
    if config.depth_trust.fall_back and config.robot.colour:
        from .fallback import Fallback  # likewise

        planner = Fallback(planner, config, goals)
    return planner
