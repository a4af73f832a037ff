"""The planner protocol: from the world model to the next footstep and gaze.

Five planners implement it: `search_planner` (grid search and univector field), `field_planner` (univector field
to the goal), `swarm_planner` (seed 000, by one colour camera), `avoidance_planner` (seed 004), `foothold_planner`
(ground of several levels). A planner of your own needs the five members below and a constructor that takes
`PlanningConfig` and the goals.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, UInt8

from perception.primitives.errors import InputError

from ..commands import GazeCommand, WalkCommand
from ..footholds.foothold import Foothold
from ..gaze.selection import DirectionMap
from ..plugin_calls import call, check_finite
from ..world_model import WorldModel


@dataclass(frozen=True, eq=False)
class ImageTarget:
    """The pixel that an image-based planner chose, for the report.

    Args:
        movable: (h, w), 255 where the planner would step.
        pixel: (u, v) that it walks to; None if it found none.
    """

    movable: UInt8[np.ndarray, "h w"]
    pixel: tuple[int, int] | None


@dataclass(frozen=True, eq=False)
class Plan:
    """What a planner intends beyond the next step, for viewers; nothing walks by it. World frame, m and rad.

    Args:
        goal: The present goal; None without one.
        route: Way points to it, the robot first; empty without a search.
        steps: Next poses of the body, x, y, yaw, one a step; on several levels those of the feet.
        risk: Probability of contact with what may move, on the next steps, as the guard claims it; None without a guard.
        gaze_map: Worth of the directions, by which the gaze was chosen; None if it was not.
        foothold: Where the next foot is to land on several levels, frame of the standing foot; None on flat ground.
    """

    goal: Float[np.ndarray, "2"] | None = None
    route: Float[np.ndarray, "m 2"] = field(default_factory=lambda: np.zeros((0, 2)))
    steps: Float[np.ndarray, "n 3"] = field(default_factory=lambda: np.zeros((0, 3)))
    risk: float | None = None
    gaze_map: DirectionMap | None = None
    foothold: Foothold | None = None


@dataclass(frozen=True)
class Decision:
    """What the body is asked to do, and why.

    Args:
        walk: The next footstep.
        gaze: Where to look meanwhile.
        why: One or two words: "survey", "walk", "guard", "blocked", or a planner's own.
        timing_ms: Wall time of each stage, ms, of planners that measure it.
        image_target: Of planners that choose a pixel.
        plan: What it intends beyond this step, for viewers; None if it does not say.
    """

    walk: WalkCommand
    gaze: GazeCommand
    why: str
    timing_ms: dict[str, float] = field(default_factory=dict, compare=False)
    image_target: ImageTarget | None = field(default=None, compare=False)
    plan: Plan | None = field(default=None, compare=False)


@runtime_checkable
class Planner(Protocol):
    """From the world model to the next footstep."""

    @property
    def reached(self) -> int:
        """Goals reached so far; for an exploring planner, places visited."""
        ...

    def observe(self, world: WorldModel) -> None:
        """Take in one frame; called for every frame, before any decision about it."""
        ...

    def decide(self, world: WorldModel) -> Decision:
        """The next footstep and gaze; called once per footstep."""
        ...

    def distance_to_goal(self, world: WorldModel) -> float:
        """Distance from the estimated pose to the present goal, m; 0 without one."""
        ...

    def finished(self, world: WorldModel) -> bool:
        """Whether the mission is over; called once per frame."""
        ...


def reference(planner: Planner) -> str:
    """Kind and name of a planner, for messages."""
    return f"planner {type(planner).__module__}:{type(planner).__name__}"


def decide(planner: Planner, world: WorldModel) -> Decision:
    """The decision of a planner, a user's own too.

    Raises:
        InputError: It is something else, or holds a value that no body can execute.
    """
    name = reference(planner)
    found = call(name, planner.decide, world)
    expected = "expected surefoot.Decision(walk, gaze, why)"
    if not isinstance(found, Decision):
        raise InputError(f"{name}: decide() returned {type(found).__name__}; {expected}")
    fields = (("walk", WalkCommand), ("gaze", GazeCommand), ("why", str))
    for key, wanted in fields:
        if not isinstance(getattr(found, key), wanted):
            held = type(getattr(found, key)).__name__
            raise InputError(
                f"{name}: decide() returned a Decision whose {key} is {held}; {expected}"
            )
    check_finite(f"{name}: decide()", found.walk)
    check_finite(f"{name}: decide()", found.gaze)
    return found
