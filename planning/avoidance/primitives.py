"""Motion primitives as footsteps: slip, forward, rotate, turn and stop, and the passages made of them.

A passage is a list of legs, each a place to be and a heading to have there. A leg is walked by looking at where
the robot is before each footstep, so slips of the feet do not add up.

Source: seed 004, section 2.4 (primitives and combinations); legs are ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from perception.primitives.pose import Pose2, wrap_angle
from perception.primitives.robot_model import DARWIN_OP, GaitLimits, RobotModel

from ..commands import WalkCommand
from ..footsteps import half_a_step_on, limited_step
from .pivot import Pivot

NEAR_M = 0.02  # ours: about the slip of one step
STRAIGHT_RAD = math.radians(3.0)  # ours
# ours: share of the drift taken back by one step; a whole share of a pose that lags swings
CALM = 0.6
LEARN = 0.02  # ours: share of what is left of it that each step adds to what all have to make up for ...
LEARN_M, LEARN_RAD = 0.01, math.radians(2.0)  # ours: ... while it is on its line but for this
# ours: single and double support where it is narrow: who steps as quickly sways by 30 mm to each side, not by
# 50 (body of seed 004, dynamic), and a gap may leave 40
QUICK_S = (0.25, 0.15)
AHEAD_M = 0.10  # ours: looked ahead along a leg; five side steps


@dataclass(frozen=True)
class Leg:
    """One primitive.

    Args:
        primitive: "S" slip sideways, "F" forward, "B" backward, "R" rotate, "T" turn by a right angle, "ST" stop.
        target: Where it ends, and the heading kept (S, F, B) or reached (R, T).
        gap_m: Width of the gap through whose middle it leads; 0 if it leads through none.
    """

    primitive: str
    target: Pose2
    gap_m: float = 0.0


@dataclass
class Trim:
    """What every step makes up for, as far as learnt: feet that slip, or turn, slip alike with every step.

    Args:
        forward_m, left_m, turn_rad: Added to each step.
    """

    forward_m: float = 0.0
    left_m: float = 0.0
    turn_rad: float = 0.0

    def learn(self, off_m: float, turn_rad: float, sideways: bool) -> None:
        """Take in how far off its line, and its heading, a leg is; sideways: what it walks, so that it drifts ahead."""
        if abs(off_m) > LEARN_M or abs(turn_rad) > LEARN_RAD:
            return
        self.turn_rad += LEARN * turn_rad
        if sideways:
            self.forward_m -= LEARN * off_m
        else:
            self.left_m -= LEARN * off_m


def passage(
    motion: str, found: Pivot, start: Pose2, beyond_m: float, gap_m: float = 0.0
) -> list[Leg]:
    """The legs of a motion.

    Args:
        motion: One of `fams.MOTIONS`.
        found: The pivot, from where the robot stands.
        start: Where the robot stands, heading along the way.
        beyond_m: How far ahead of the start the passage ends, m.
        gap_m: Width of the gap if the pivot lies before its middle; else 0.

    The first letter leads to the pivot, the second through the gap: F walks through it, S turns a right angle and
    slips through it, narrow side ahead. R and T turn to the pivot, walk there, and turn back; T's lies across the
    way.
    """
    if motion == "ST":
        return [Leg("ST", start)]

    def at(x: float, y: float, turn: float) -> Pose2:
        return start @ Pose2(x, y, turn)

    x, y = found.x_m, found.y_m
    if motion[0] == "S":
        legs = [Leg("S", at(0.0, y, 0.0))]
    else:
        way = math.atan2(y, x)
        legs = [
            Leg(motion[0], at(0.0, 0.0, way)),
            Leg("F", at(x, y, way)),
            Leg(motion[0], at(x, y, 0.0)),
        ]
    if motion[1] == "F":
        return [*legs, Leg("F", at(beyond_m, y, 0.0), gap_m)]
    aside = math.copysign(math.pi / 2, -y)  # faces the obstacle that is being passed
    return [
        *legs,
        Leg("R", at(x, y, aside)),
        Leg("S", at(beyond_m, y, aside), gap_m),
        Leg("R", at(beyond_m, y, 0.0)),
    ]


def retreat(leg: Leg, robot: Pose2, length_m: float) -> list[Leg]:
    """The legs back out of a passage that proved closed: against the leg being walked, on its own line.

    Args:
        leg: What was being walked.
        robot: Where the robot is.
        length_m: How far back.
    """
    if leg.primitive not in ("F", "S"):
        return []
    here = leg.target.inverse() @ robot
    if leg.primitive == "F":
        return [Leg("B", leg.target @ Pose2(here.x - length_m, 0.0, 0.0))]
    back = here.y + math.copysign(length_m, here.y)
    return [Leg("S", leg.target @ Pose2(0.0, back, 0.0))]


def on_line(leg: Leg, robot: Pose2, places: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
    """How far ahead of the robot, along a leg's line, places lie, and how far to the left of this line.

    Args:
        leg: What is being walked.
        robot: Where the robot is.
        places: World frame, m.

    Returns:
        Ahead of the robot as the leg goes, and left of its line, m.
    """
    here, there = leg.target.inverse() @ robot, leg.target.inverse().apply(places)
    if leg.primitive != "S":
        return np.asarray(there - [here.x, 0.0])
    way = _way(leg, robot)
    return np.column_stack([way * (there[:, 1] - here.y), -way * there[:, 0]])


def beside(leg: Leg, robot: Pose2, left_m: float) -> Leg:
    """The same leg on a line so far to the left of its own as it goes, m."""
    move = Pose2(0.0, left_m, 0.0)
    if leg.primitive == "S":
        move = Pose2(-_way(leg, robot) * left_m, 0.0, 0.0)
    return replace(leg, target=leg.target @ move)


def _way(leg: Leg, robot: Pose2) -> float:
    """To which side a slip leads: 1 left, -1 right."""
    return math.copysign(1.0, -(leg.target.inverse() @ robot).y)


def in_the_way(
    leg: Leg,
    robot: Pose2,
    cells: Float[np.ndarray, "n 2"],
    cell_m: float,
    model: RobotModel = DARWIN_OP,
) -> Bool[np.ndarray, "n"]:
    """Which occupied cells lie where the body comes within the next steps of a leg.

    Args:
        leg: What is being walked; only F and S go anywhere new.
        robot: Where the robot is.
        cells: Middles of occupied cells, world frame, m.
        cell_m: Their side: what a cell holds may stand half a side nearer, or farther, than its middle, and
            where a passage is hardly wider than the body only the sure ones close it.
    """
    if leg.primitive not in ("F", "S"):
        return np.zeros(len(cells), dtype=np.bool_)
    ahead, across = on_line(leg, robot, cells).T
    long, half = model.depth_m / 2, model.width_m / 2
    if leg.primitive == "S":
        long, half = half, long
    inside = (ahead > 0.0) & (ahead < long + AHEAD_M) & (np.abs(across) < half - cell_m / 2)
    return np.asarray(inside)


def reached(leg: Leg, robot: Pose2) -> bool:
    """Whether a leg is done: turned far enough, or abreast of its end."""
    error = robot.inverse() @ leg.target
    if leg.primitive in ("R", "T"):
        return abs(error.yaw) <= STRAIGHT_RAD
    if leg.primitive == "F":
        return (leg.target.inverse() @ robot).x >= -NEAR_M
    if leg.primitive == "B":
        return (leg.target.inverse() @ robot).x <= NEAR_M
    if leg.primitive == "S":
        return abs((leg.target.inverse() @ robot).y) <= NEAR_M
    return False


def step(
    leg: Leg,
    robot: Pose2,
    gait: GaitLimits,
    trim: Trim | None = None,
    last: WalkCommand | None = None,
) -> WalkCommand:
    """The next footstep of a leg, within the gait's limits.

    Along the leg the robot goes as fast as the gait lets it and no farther than its end; of what it has drifted
    off its line and its heading each step takes a share back. Ahead it goes in short quick steps: a body that
    sways less needs less room, which what is passed may not leave.

    Args:
        leg: What is being walked.
        robot: Where the robot is.
        gait: Limits.
        trim: What was learnt of its steps, which this step adds to; None: nothing.
        last: The step before, which the body is still about to follow; None: it stands.
    """
    if leg.primitive == "ST":
        return limited_step(gait, 0.0, 0.0, 0.0)
    trim = Trim() if trim is None else trim
    here = leg.target.inverse() @ half_a_step_on(robot, last or WalkCommand())
    turn = wrap_angle(-here.yaw)
    if leg.primitive in ("R", "T"):
        return limited_step(gait, 0.0, 0.0, CALM * turn)
    # In the leg's own frame: to aim at its end instead would make of a little turn a long way off its line.
    if leg.primitive == "S":
        trim.learn(here.x, turn, sideways=True)
        fastest = gait.max_side_mps * gait.step_s
        wish = (trim.forward_m - CALM * here.x, min(max(-here.y, -fastest), fastest))
    else:
        trim.learn(here.y, turn, sideways=False)
        single, double = QUICK_S
        gait = replace(
            gait,
            single_support_s=min(single, gait.single_support_s),
            double_support_s=min(double, gait.double_support_s),
        )
        wish = (min(-here.x, gait.cruise_mps * gait.step_s), trim.left_m - CALM * here.y)
    ahead, aside = Pose2(0.0, 0.0, turn).apply(np.array(wish)) / gait.step_s
    return limited_step(gait, float(ahead), float(aside), CALM * turn + trim.turn_rad)
