"""Motion primitives as footsteps: side steps, forward, rotate, turn and stop, and the passages made of them.

A passage is a list of legs, each with a target position and heading. Before each footstep the leg is compared with the
pose of the robot, so that foot slip does not accumulate.

Source: Kang 2013 (seed 004), section 2.4 (primitives and combinations); legs are ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from perception.primitives.pose import Pose2, wrap_angle
from perception.primitives.robot_model import GaitLimits, RobotModel

from ..commands import WalkCommand
from ..footsteps import half_a_step_on, limited_step
from .pivot import Pivot

# all ours
NEAR_M = 0.02  # tolerance of a position, about the slip of one step
STRAIGHT_RAD = math.radians(3.0)  # tolerance of a heading
CALM = 0.6  # share of the deviation that one step corrects; 1 oscillates, since the pose lags
LEARN = 0.02  # share of the deviation that each step adds to the systematic correction ...
LEARN_M, LEARN_RAD = 0.01, math.radians(2.0)  # ... for deviations up to these
# single and double support in a gap: 30 mm of sway instead of 50 (dynamic body of seed 004), within 40 mm of clearance
QUICK_S = (0.25, 0.15)
AHEAD_M = (
    0.10  # distance along a leg that is checked for obstacles, at least one step; five side steps
)


@dataclass(frozen=True)
class Leg:
    """One primitive.

    Args:
        primitive: "S" side steps, "F" forward, "B" backward, "R" rotate, "T" turn by a right angle, "ST" stop.
        target: Final position, and the heading to keep (S, F, B) or to reach (R, T).
        gap_m: Width of the gap that it passes in the middle; 0 without a gap.
    """

    primitive: str
    target: Pose2
    gap_m: float = 0.0


@dataclass
class Trim:
    """Learnt correction of systematic foot slip.

    Args:
        forward_m, left_m, turn_rad: Added to each step.
    """

    forward_m: float = 0.0
    left_m: float = 0.0
    turn_rad: float = 0.0

    def learn(self, off_m: float, turn_rad: float, sideways: bool) -> None:
        """Update from the deviation from the line and the heading of a leg; `sideways`: of side steps."""
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
        found: The pivot, relative to the robot.
        start: Pose of the robot, heading along the passage.
        beyond_m: Distance of the end of the passage ahead of the start, m.
        gap_m: Width of the gap if the pivot lies before its middle; else 0.

    The first letter leads to the pivot, the second through the gap: F walks through it, S turns by a right angle and
    passes it with side steps, narrow side ahead. R and T turn to the pivot, walk there, and turn back; the pivot of T
    lies beside the robot.
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
    aside = math.copysign(math.pi / 2, -y)  # faces the obstacle
    return [
        *legs,
        Leg("R", at(x, y, aside)),
        Leg("S", at(beyond_m, y, aside), gap_m),
        Leg("R", at(beyond_m, y, 0.0)),
    ]


def retreat(leg: Leg, robot: Pose2, length_m: float) -> list[Leg]:
    """The legs back out of a blocked passage, on the line of the present leg.

    Args:
        leg: Present leg.
        robot: Pose of the robot.
        length_m: Distance to go back.
    """
    if leg.primitive not in ("F", "S"):
        return []
    here = leg.target.inverse() @ robot
    if leg.primitive == "F":
        return [Leg("B", leg.target @ Pose2(here.x - length_m, 0.0, 0.0))]
    back = here.y + math.copysign(length_m, here.y)
    return [Leg("S", leg.target @ Pose2(0.0, back, 0.0))]


def on_line(leg: Leg, robot: Pose2, places: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
    """Points in the frame of a leg: ahead of the robot along its line, and left of the line, m.

    Args:
        leg: Present leg.
        robot: Pose of the robot.
        places: World frame, m.
    """
    here, there = leg.target.inverse() @ robot, leg.target.inverse().apply(places)
    if leg.primitive != "S":
        return np.asarray(there - [here.x, 0.0])
    side = _side(leg, robot)
    return np.column_stack([side * (there[:, 1] - here.y), -side * there[:, 0]])


def beside(leg: Leg, robot: Pose2, left_m: float) -> Leg:
    """The leg on a parallel line, to the left in its direction, m."""
    move = Pose2(0.0, left_m, 0.0)
    if leg.primitive == "S":
        move = Pose2(-_side(leg, robot) * left_m, 0.0, 0.0)
    return replace(leg, target=leg.target @ move)


def _side(leg: Leg, robot: Pose2) -> float:
    """Direction of side steps: 1 left, -1 right."""
    return math.copysign(1.0, -(leg.target.inverse() @ robot).y)


def in_the_way(
    leg: Leg,
    robot: Pose2,
    cells: Float[np.ndarray, "n 2"],
    cell_m: float,
    model: RobotModel,
) -> Bool[np.ndarray, "n"]:
    """Which occupied cells the body reaches within the next steps of a leg, one at least.

    Args:
        leg: Present leg; only F and S lead to new ground.
        robot: Pose of the robot.
        cells: Middles of occupied cells, world frame, m.
        cell_m: Side of a cell. An obstacle may be half a side off the middle of its cell; in a passage hardly wider
            than the body only cells entirely within the body count.
        model: Width, depth and gait of the robot.
    """
    if leg.primitive not in ("F", "S"):
        return np.zeros(len(cells), dtype=np.bool_)
    ahead, across = on_line(leg, robot, cells).T
    long, half = model.depth_m / 2, model.width_m / 2
    speed = model.gait.cruise_mps
    if leg.primitive == "S":
        long, half, speed = half, long, model.gait.max_side_mps
    next_m = max(AHEAD_M, speed * model.gait.step_s)
    inside = (ahead > 0.0) & (ahead < long + next_m) & (np.abs(across) < half - cell_m / 2)
    return np.asarray(inside)


def reached(leg: Leg, robot: Pose2) -> bool:
    """Whether a leg is done: the heading is reached, or the robot is abreast of its end."""
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

    Along the leg the robot walks at full speed, at most to its end, and each step corrects a share of the deviation from
    the line and the heading. Forward steps are short and quick, which reduces the sway of the body in a gap.

    Args:
        leg: Present leg.
        robot: Pose of the robot.
        gait: Limits of a step.
        trim: Learnt correction, updated by this step; None: none.
        last: Last step, which the body has yet to complete; None: the robot stands.
    """
    if leg.primitive == "ST":
        return limited_step(gait, 0.0, 0.0, 0.0)
    trim = Trim() if trim is None else trim
    here = leg.target.inverse() @ half_a_step_on(robot, last or WalkCommand())
    turn = wrap_angle(-here.yaw)
    if leg.primitive in ("R", "T"):
        return limited_step(gait, 0.0, 0.0, CALM * turn)
    # in the frame of the leg: aiming at its end would turn a small heading error into a large lateral one
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
