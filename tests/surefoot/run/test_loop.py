"""The walking loop: it ends a walk at its time limit, whatever the planner says."""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest

from perception.estimate import Estimate
from perception.primitives.frame import Frame
from perception.primitives.gaussian import Gaussian
from planning.commands import GazeCommand, WalkCommand
from planning.planners.planner import Decision
from planning.world_model import WorldModel
from surefoot.run.loop import cycles

PERIOD_S = 0.5


class Endless:
    """A body that never stops, its perception, and a planner that never finishes, like some plug-ins."""

    reached = 0

    def __init__(self) -> None:
        self.stamp_s = 0.0

    def read(self) -> Frame:
        self.stamp_s += PERIOD_S
        return Frame(self.stamp_s, footstep_due=True)

    def walk(self, command: WalkCommand) -> None:
        """Nothing."""

    def look(self, gaze: GazeCommand) -> None:
        """Nothing."""

    def cycle(self, frame: Frame) -> WorldModel:
        return WorldModel(Estimate(frame.stamp_s, Gaussian(np.zeros(3), 1e-4 * np.eye(3))))

    def observe(self, world: WorldModel) -> None:
        """Nothing."""

    def decide(self, world: WorldModel) -> Decision:
        return Decision(WalkCommand(), GazeCommand(), "walk")

    def distance_to_goal(self, world: WorldModel) -> float:
        return 1.0

    def finished(self, world: WorldModel) -> bool:
        return False


@pytest.mark.parametrize("limit_s", [0.5, 3.0, 3.2])
def test_a_planner_that_never_finishes_is_stopped_by_the_first_frame_at_the_time_limit(limit_s):
    one = Endless()
    walked = list(islice(cycles(one, one, one, limit_s=limit_s), 100))
    assert walked[-1].frame.stamp_s - PERIOD_S < limit_s <= walked[-1].frame.stamp_s
