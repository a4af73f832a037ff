"""The pivot: the point before the gap from which the passage leads straight ahead.

Source: Kang 2013 (seed 004), eq. (28) to (30). The printed equations put the pivot within the width of the obstacle and
measure the angle from the lateral axis. Ours keep a clearance from its edge and its face. A printed pivot lies where the
printed turn and length lead.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from perception.primitives.errors import ConfigError, InputError
from perception.primitives.robot_model import DARWIN_OP
from perception.primitives.settings import setting


@dataclass(frozen=True)
class PivotConfig:
    """Clearance of the passage."""

    clearance_m: float = setting(
        0.10, "m", "c: distance kept from an obstacle while passing it", "ours"
    )
    literal: bool = setting(
        False, "", "pivots by the printed formulas, for comparison", "seed 004, eq. (28) to (30)"
    )

    def half_m(self, body_width_m: float) -> float:
        """Distance kept from the middle of the body to an obstacle beside it, m; less in a narrower gap."""
        return body_width_m / 2 + self.clearance_m

    def __post_init__(self) -> None:
        if self.clearance_m < 0.0:
            raise ConfigError(f"pivot: clearance_m={self.clearance_m} must not be negative")


@dataclass(frozen=True)
class Pivot:
    """The pivot relative to the robot.

    Args:
        x_m, y_m: The point, ahead and left.
        distance_m: d_pivot, the length to walk.
        turn_rad: theta_pivot, the turn before it, left positive; not for side steps.
    """

    x_m: float
    y_m: float
    distance_m: float
    turn_rad: float


def pivot(
    motion: str,
    side: int,
    edge_m: float,
    gap_m: float,
    width_m: float,
    distance_m: float,
    config: PivotConfig | None = None,
    body_width_m: float = DARWIN_OP.passage_width_m,
) -> Pivot:
    """The pivot of a motion.

    Args:
        motion: One of `fams.MOTIONS`.
        side: D, +1 left, -1 right.
        edge_m: Lateral position of the edge of the blocking group on that side, left positive.
        gap_m: Free width beside that edge.
        width_m: w_l of the group; used by the printed formulas only.
        distance_m: d_l, forward distance of the group.
        config: Clearance.
        body_width_m: w_r of the robot.

    Source: seed 004, eq. (28) to (30).
    """
    config = PivotConfig() if config is None else config
    if side not in (-1, 1):
        raise InputError(f"pivot: side={side} must be 1 (left) or -1 (right)")
    if motion == "ST":
        return Pivot(0.0, 0.0, 0.0, 0.0)
    if config.literal:
        return _printed(motion, side, gap_m, width_m, distance_m)
    half = config.half_m(body_width_m)
    y = edge_m + side * min(gap_m / 2, half)
    if motion[0] == "S":
        return Pivot(0.0, y, abs(y), 0.0)
    if motion[0] == "T":
        return Pivot(0.0, y, abs(y), math.copysign(math.pi / 2, y))
    x = max(distance_m - half, 0.0)
    return Pivot(x, y, math.hypot(x, y), math.atan2(y, x))


def _printed(motion: str, side: int, gap_m: float, width_m: float, distance_m: float) -> Pivot:
    """Eq. (28) to (30) as printed: the angle from the lateral axis, the turn of T by half a circle.

    Printed angles are positive to the right. A negative length leads the other way.
    """
    if motion[0] == "S":
        length = width_m / 2 - gap_m
        return Pivot(0.0, side * length, length, 0.0)
    if motion[0] == "T":
        length, turn = width_m / 2 - gap_m, math.copysign(math.pi, side)
    else:
        across, ahead = -side * width_m / 2 - gap_m, distance_m - gap_m
        length = math.hypot(across, ahead)
        theta = math.atan2(math.copysign(1.0, across) * ahead, abs(across))  # arctan of the two
        turn = -theta
    return Pivot(length * math.cos(turn), length * math.sin(turn), length, turn)
