"""The walking loop: it ends a walk at its time limit, whatever the planner says."""

from __future__ import annotations

from itertools import islice
from typing import Any

import numpy as np
import pytest

from perception.estimate import Estimate
from perception.primitives.errors import InputError
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


def holding(made: Any = None, **values: Any) -> Any:
    """A decision, or what is given, with values of other types, as they are without the checks of types."""
    made = Decision(WalkCommand(), GazeCommand(), "walk") if made is None else made
    vars(made).update(values)
    return made


@pytest.mark.parametrize(
    ("found", "words"),
    [
        (
            None,
            r"Endless: decide\(\) returned NoneType; expected surefoot.Decision\(walk, gaze, why\)",
        ),
        (WalkCommand(), "returned WalkCommand"),
        (holding(walk=GazeCommand()), "whose walk is GazeCommand"),
        (holding(why=7), "whose why is int"),
        (Decision(WalkCommand(np.nan), GazeCommand(), "walk"), "forward_m=nan"),
        (Decision(WalkCommand(), GazeCommand(tilt_rad=-np.inf), "walk"), "tilt_rad=-inf"),
        (holding(walk=holding(WalkCommand(), forward_m="0.1")), "forward_m='0.1'"),
    ],
)
def test_a_planner_that_returns_no_decision_that_a_body_can_execute_is_named(found, words):
    one = Endless()
    one.decide = lambda world: found
    with pytest.raises(InputError, match=words):
        next(cycles(one, one, one))


@pytest.mark.parametrize("member", ["observe", "decide", "finished"])
def test_a_planner_with_other_arguments_is_named(member):
    one = Endless()
    setattr(one, member, lambda: None)
    with pytest.raises(InputError, match=r"planner .*test_loop:Endless: .*0 positional arguments"):
        list(islice(cycles(one, one, one), 3))


def test_an_error_inside_a_planner_stays_what_it_is():
    one = Endless()
    one.decide = lambda world: len(7)
    with pytest.raises(TypeError, match="has no len"):
        next(cycles(one, one, one))
