"""Caution: what the status of a run makes of a planner's footstep.

A planner decides by what it is told of the world. When the sensors contradict each other, or show nothing, it is told
too little, whichever planner it is: then the robot makes shorter steps, or stands until they agree again. The gaze
stays the planner's, so that the cameras go on looking. A robot that only does not know where it is looks for what it
knows: first the head turns to both sides, then the body turns on the spot. On ground of several levels every foot has its
place, so a step cannot be shortened: the robot stands, and keeps its feet where they are. Source: ours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from mapping.grid.evidence import OCCUPIED
from perception.monitoring.status import LOST, SLOW, STAND, Doubt
from perception.primitives.robot_model import RobotModel

from ..commands import GazeCommand, WalkCommand
from ..gaze.sweep import SURVEY_PANS_DEG, TILT_DEG
from ..world_model import WorldModel
from .planner import Decision

SHORTER = 0.5  # ours: half a step leads along the same curve, and stops in half the way
LOOKS = "look around"
GOES_ON = 20
"""Ours: steps between two looks around while the robot is lost; half a metre for a DARwIn-OP."""
PAUSE = 3  # ours: steps left out between two on several levels, while the walk should be slower


class Caution:
    """Makes the decisions of a walk cautious; remembers how long the robot has looked around."""

    def __init__(self, robot: RobotModel) -> None:
        self._robot = robot
        self._looks = self._paused = 0
        self._whole_look = len(SURVEY_PANS_DEG) + math.ceil(2.0 * math.pi / robot.gait.max_turn_rad)

    def apply(self, decision: Decision, world: WorldModel) -> Decision:
        """The decision with a shorter footstep, or none, if a doubt asks for it.

        Args:
            decision: The planner's.
            world: With the status.
        """
        status = world.estimate.status
        if world.levels is not None:
            return self._on_levels(decision, status)
        stand = [one.words for one in status if one.asks == STAND]
        self._looks = self._looks + 1 if stand == [LOST] else 0
        if self._looks and (self._looks - 1) % (self._whole_look + GOES_ON) < self._whole_look:
            return self._look_around(decision, world)
        if stand and not self._looks:
            return replace(decision, walk=WalkCommand(), why=f"stand: {stand[0]}")
        slow = stand + [one.words for one in status if one.asks == SLOW]
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

    def _on_levels(self, decision: Decision, status: Sequence[Doubt]) -> Decision:
        """The decision, or to stay; only steps show that a doubt about them is over, so one is made now and then.

        A robot that is lost still knows the ground at its feet.
        """
        stand = [one.words for one in status if one.asks == STAND and one.words != LOST]
        slow = [one.words for one in status if one.asks == SLOW or one.words == LOST]
        self._paused = self._paused + 1 if slow and self._paused < PAUSE else 0
        if not stand and self._paused == 0:
            return decision
        return replace(decision, walk=WalkCommand(stay=True), why=f"stand: {(stand or slow)[0]}")

    def _look_around(self, decision: Decision, world: WorldModel) -> Decision:
        """The next look of a robot that is lost: by the head, then by turning the body where there is room."""
        limit, tilt = math.radians(self._robot.head.pan_deg), math.radians(TILT_DEG)
        look = (self._looks - 1) % (self._whole_look + GOES_ON)
        pan, turn = 0.0, self._robot.gait.max_turn_rad
        if look < len(SURVEY_PANS_DEG):
            pan, turn = math.radians(SURVEY_PANS_DEG[look]), 0.0
        elif not self._has_room(world):
            turn = 0.0
        gaze = GazeCommand(min(max(pan, -limit), limit), tilt)
        why = f"stand: {LOST}" if turn == 0.0 else f"{LOOKS}: {LOST}"
        return replace(decision, walk=WalkCommand(0.0, 0.0, turn), gaze=gaze, why=why)

    def _has_room(self, world: WorldModel) -> bool:
        """Whether nothing stands in the circle of the body."""
        if world.grid is None or world.pose is None:
            return False
        grid = world.grid
        places = grid.centres()[grid.known & (grid.probability >= OCCUPIED)] - world.pose.mean[:2]
        return not bool((places**2).sum(axis=1).min(initial=math.inf) < self._robot.radius_m**2)
