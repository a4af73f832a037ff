"""The status of a run shortens or forbids the step of any planner; a robot that is lost looks around."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mapping.grid.egocentric_grid import EgocentricGrid, GridConfig
from perception.estimate import Estimate
from perception.monitoring.status import LOST, SLOW, STAND, Doubt
from perception.primitives.gaussian import Gaussian
from perception.primitives.robot_model import DARWIN_OP
from planning.commands import GazeCommand, WalkCommand
from planning.gaze.sweep import SURVEY_PANS_DEG
from planning.planners.caution import GOES_ON, Caution
from planning.planners.planner import Decision
from planning.world_model import WorldModel

DECISION = Decision(WalkCommand(0.08, 0.01, 0.2), GazeCommand(0.5, 0.3), "walk")
VIEW_RAD = math.radians(44.0)  # seed 004: of the narrowest depth camera


WHOLE_LOOK = len(SURVEY_PANS_DEG) + math.ceil(2.0 * math.pi / DARWIN_OP.gait.max_turn_rad)


def told(*status: Doubt, box_at_m: float = math.inf) -> WorldModel:
    """A robot at the origin with this status, and a box ahead at this distance."""
    grid = EgocentricGrid(GridConfig(), np.zeros(2))
    if box_at_m < math.inf:
        face = np.column_stack(
            [np.full(40, box_at_m), np.linspace(-0.1, 0.1, 40), np.full(40, 0.1)]
        )
        for k in range(5):
            grid.update(face, np.ones(40, bool), 0.1 * k, np.zeros(2))
    pose = Gaussian(np.zeros(3), np.eye(3))
    return WorldModel(Estimate(1.0, pose, status=tuple(status)), grid)


def decided(*status: Doubt) -> Decision:
    """The first decision with this status."""
    return Caution(DARWIN_OP).apply(DECISION, told(*status))


def test_without_doubt_the_decision_is_the_planners():
    assert decided() is DECISION
    assert decided(Doubt("clock set back")) is DECISION


def test_a_doubt_that_asks_for_it_shortens_the_step_along_the_same_curve():
    slow = decided(Doubt("tof half blind", SLOW))
    assert slow.walk == WalkCommand(0.04, 0.005, 0.1)
    assert slow.gaze == DECISION.gaze
    assert slow.why == "slow: tof half blind, walk"


@pytest.mark.parametrize("doubts", [["no pictures"], ["no pictures", LOST], ["no odometry", LOST]])
def test_a_robot_that_sees_or_feels_nothing_stands_with_the_planners_gaze(doubts):
    caution = Caution(DARWIN_OP)
    world = told(Doubt("gap in stamps", SLOW), *(Doubt(words, STAND) for words in doubts))
    for _ in range(40):
        stands = caution.apply(DECISION, world)
        assert stands.walk == WalkCommand()
        assert stands.gaze == DECISION.gaze
        assert stands.why == f"stand: {doubts[0]}"


def test_a_robot_that_is_lost_sees_all_round_without_leaving_its_place():
    caution, heading, seen = Caution(DARWIN_OP), 0.0, []
    for _ in range(WHOLE_LOOK):
        decision = caution.apply(DECISION, told(Doubt(LOST, STAND)))
        assert (decision.walk.forward_m, decision.walk.lateral_m) == (0.0, 0.0)
        assert abs(decision.walk.turn_rad) <= DARWIN_OP.gait.max_turn_rad
        assert abs(decision.gaze.pan_rad) <= math.radians(DARWIN_OP.head.pan_deg)
        heading += decision.walk.turn_rad
        seen.append(heading + decision.gaze.pan_rad)
    gaps = np.diff(np.sort(np.mod(seen, 2.0 * math.pi)))
    assert gaps.max() < VIEW_RAD
    assert max(seen) - min(seen) > 2.0 * math.pi - VIEW_RAD


def test_a_robot_that_is_lost_beside_something_turns_its_head_alone():
    caution = Caution(DARWIN_OP)
    for box_at_m, turns in ((0.12, False), (0.6, True)):
        world = told(Doubt(LOST, STAND), box_at_m=box_at_m)
        made = [caution.apply(DECISION, world).walk.turn_rad for _ in range(WHOLE_LOOK)]
        assert any(made) == turns


def test_a_robot_that_nothing_tells_where_it_is_goes_on_by_half_steps_and_looks_again():
    caution = Caution(DARWIN_OP)
    made = [
        caution.apply(DECISION, told(Doubt(LOST, STAND))) for _ in range(2 * (WHOLE_LOOK + GOES_ON))
    ]
    half = [one.walk == WalkCommand(0.04, 0.005, 0.1) for one in made]
    assert half == 2 * ([False] * WHOLE_LOOK + [True] * GOES_ON)
    assert {one.gaze for one, goes in zip(made, half, strict=True) if goes} == {DECISION.gaze}
    assert made[WHOLE_LOOK].why == "slow: lost, walk"


def test_a_robot_that_is_found_walks_on():
    caution = Caution(DARWIN_OP)
    for _ in range(12):
        caution.apply(DECISION, told(Doubt(LOST, STAND)))
    assert caution.apply(DECISION, told()) is DECISION
