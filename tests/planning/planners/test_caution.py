"""The status of a run shortens or forbids the step of any planner, and leaves the gaze."""

from __future__ import annotations

from perception.monitoring.status import LOST, SLOW, STAND, Doubt
from planning.commands import GazeCommand, WalkCommand
from planning.planners.caution import cautious
from planning.planners.planner import Decision

DECISION = Decision(WalkCommand(0.08, 0.01, 0.2), GazeCommand(0.5, 0.3), "walk")


def test_without_doubt_the_decision_is_the_planners():
    assert cautious(DECISION, ()) is DECISION
    assert cautious(DECISION, [Doubt("clock set back")]) is DECISION


def test_a_doubt_that_asks_for_it_shortens_the_step_along_the_same_curve():
    slow = cautious(DECISION, [Doubt("tof half blind", SLOW)])
    assert slow.walk == WalkCommand(0.04, 0.005, 0.1)
    assert slow.gaze == DECISION.gaze
    assert slow.why == "slow: tof half blind, walk"


def test_a_robot_that_is_lost_stands_and_goes_on_looking():
    stands = cautious(DECISION, [Doubt("gap in stamps", SLOW), Doubt(LOST, STAND)])
    assert stands.walk == WalkCommand()
    assert stands.gaze == DECISION.gaze
    assert stands.why == "stand: lost"
