"""The walking loop, the only one: read a frame, perceive, decide, act.

Runs and studies iterate over it and record what they need. Over a recording there is no planner.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass

from perception.primitives.frame import Frame
from perception.primitives.robot_model import DARWIN_OP, RobotModel
from perception.primitives.stopwatch import Stopwatch
from planning.planners.caution import Caution
from planning.planners.planner import Decision, Planner, decide, reference
from planning.plugin_calls import call
from planning.world_model import WorldModel

from .bodies import Body
from .perception_source import PerceptionSource


@dataclass(frozen=True, eq=False)
class Cycle:
    """One pass of the loop.

    Args:
        frame: Sensor data.
        world: World model after this frame.
        decision: Commanded footstep and gaze; None between footsteps or without a planner.
        busy_ms: Processor time of perception and decision, which others on the machine hardly change.
    """

    frame: Frame
    world: WorldModel
    decision: Decision | None = None
    busy_ms: float = 0.0


def cycles(
    body: Body,
    perception: PerceptionSource,
    planner: Planner | None,
    robot: RobotModel = DARWIN_OP,
    limit_s: float = math.inf,
) -> Iterator[Cycle]:
    """The cycles of a walk or a recording, until the mission is finished, its time is up or the frames end.

    The body receives the command of a cycle before the cycle is yielded, and executes it with its next step.

    Args:
        body: A robot, or the playback of a recording.
        perception: Computes the world model.
        planner: Decides on footstep and gaze; None for a recording.
        robot: The body as the planner knows it.
        limit_s: Stamp at which a walk ends, whatever the planner says; a recording is read to its end.

    Raises:
        InputError: A planner of the user's returns what no body can execute.
    """
    caution = Caution(robot)
    while (frame := body.read()) is not None:
        began_s = time.thread_time()
        world = perception.cycle(frame)
        decision, watch = None, Stopwatch()
        if planner is not None:
            with watch.stage("decide"):
                call(reference(planner), planner.observe, world)
                if frame.footstep_due:
                    decision = caution.apply(decide(planner, world), world)
        busy_ms = 1e3 * (time.thread_time() - began_s)
        world.estimate.timing_ms.update(watch.milliseconds)
        if decision is not None:
            body.walk(decision.walk)
            body.look(decision.gaze)
        yield Cycle(frame, world, decision, busy_ms)
        if planner is not None:
            finished = call(reference(planner), planner.finished, world)
            if finished or world.stamp_s >= limit_s:
                break
