"""Caution: what the status of a run makes of a planner's footstep.

A planner decides by what it is told of the world. When the sensors contradict each other, or show nothing, it is told
too little, whichever planner it is: then the robot makes shorter steps, or stands until they agree again. The gaze
stays the planner's, so that the cameras go on looking. Source: ours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from perception.monitoring.status import SLOW, STAND, Doubt

from ..commands import WalkCommand
from .planner import Decision

SHORTER = 0.5  # ours: half a step leads along the same curve, and stops in half the way


def cautious(decision: Decision, status: Sequence[Doubt]) -> Decision:
    """The decision with a shorter footstep, or none, if a doubt asks for it.

    Args:
        decision: The planner's.
        status: What is doubted.
    """
    stand = [one.words for one in status if one.asks == STAND]
    if stand:
        return replace(decision, walk=WalkCommand(), why=f"stand: {stand[0]}")
    slow = [one.words for one in status if one.asks == SLOW]
    if not slow:
        return decision
    walk = decision.walk
    shorter = replace(
        walk,
        forward_m=SHORTER * walk.forward_m,
        lateral_m=SHORTER * walk.lateral_m,
        turn_rad=SHORTER * walk.turn_rad,
    )
    return replace(decision, walk=shorter, why=f"slow: {slow[0]}, {decision.why}")
