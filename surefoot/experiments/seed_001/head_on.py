"""Meetings with a moving obstacle that comes along the robot's path: what the virtual obstacle is made for.

The obstacle is known exactly, the robot walks footsteps at the printed speed. `SPECIFIED` is the meeting of the
specification; drawn ones differ in speed, angle and offset.

Source: Yoo and Kim 2010 (seed 001), section 4, eq. (11) ("no sharp steering"); specification, E4.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import Obstacle
from perception.primitives.pose import Pose2, wrap_angle
from perception.primitives.robot_model import DARWIN_OP
from planning import footsteps
from planning.planners.settings import BESIDE_GUARD
from planning.safety.guard import Guard
from planning.safety.guard_settings import GuardConfig
from planning.safety.step_filter import StepFilter, Unfiltered
from planning.univector import motion
from planning.univector.fields import FieldConfig

from ...evaluation.metrics.contacts import BODY_RADIUS_M
from .course_trials import PRINTED_MPS

MODEL = replace(DARWIN_OP, gait=replace(DARWIN_OP.gait, cruise_mps=PRINTED_MPS))
GOAL = np.array([4.0, 0.0])
APART_M = 2.5  # at the begin
RADIUS_M = 0.10  # S_o
LIMIT_S = 120.0
ARRIVED_M = 0.1
TURNED_RAD = math.radians(3.0)  # a turn has begun
PARTS = 13  # of a step; distances are measured after each
SPEED_MPS, ANGLE_DEG, OFFSET_M = (0.03, 0.15), 30.0, 0.10  # of drawn meetings
NO_CELLS = np.zeros((0, 2))
WALKERS = {
    "without": (BESIDE_GUARD, False),
    "virtual": (replace(BESIDE_GUARD, virtual_obstacles=True), False),
    "seed": (FieldConfig(mode="seed").as_walked, False),
    "ours": (BESIDE_GUARD, True),
}
"""Name to field and whether the guard checks the steps: the field without and with the virtual obstacle, the whole motion
of seed 001, and ours."""


@dataclass(frozen=True)
class Meeting:
    """A moving obstacle that would meet the robot after it has walked straight on.

    Args:
        speed_mps: Of the obstacle.
        angle_rad: Of its path; 0: head-on.
        offset_m: Of its path to the left, where they meet.
    """

    speed_mps: float
    angle_rad: float
    offset_m: float


SPECIFIED = Meeting(0.06, 0.0, 0.02)


@dataclass(frozen=True)
class Passing:
    """Result of one meeting.

    Args:
        onset_m: Distance of both where the turn begins; NaN without a turn.
        turning_rad: Sum of the absolute turns.
        gap_m: Least gap; negative: a contact.
    """

    onset_m: float
    turning_rad: float
    gap_m: float


def drawn(seed: int) -> Meeting:
    """A meeting by its seed."""
    rng = np.random.default_rng([seed, 64])
    angle = math.radians(rng.uniform(-ANGLE_DEG, ANGLE_DEG))
    return Meeting(float(rng.uniform(*SPEED_MPS)), angle, float(rng.uniform(-OFFSET_M, OFFSET_M)))


def passing(meeting: Meeting, field: FieldConfig, guarded: bool) -> Passing:
    """Walk through one meeting."""
    gait, guard = MODEL.gait, Guard(GuardConfig(), MODEL)
    stepper: StepFilter = guard if guarded else Unfiltered()
    velocity = -meeting.speed_mps * np.array(
        [math.cos(meeting.angle_rad), math.sin(meeting.angle_rad)]
    )
    after_s = APART_M / (meeting.speed_mps + PRINTED_MPS)
    place = np.array([PRINTED_MPS * after_s, meeting.offset_m]) - velocity * after_s
    robot, speed, stamp = Pose2(0.0, 0.0, 0.0), PRINTED_MPS, 0.0
    onset, turning, gap = math.nan, 0.0, math.inf
    while stamp < LIMIT_S and math.hypot(GOAL[0] - robot.x, GOAL[1] - robot.y) > ARRIVED_M:
        pose = Gaussian(robot.vector, np.eye(3) * 1e-8)
        state = Gaussian(np.array([*place, *velocity]), np.eye(4) * 1e-8)
        obstacle = Obstacle(state, RADIUS_M, 0.4, 1, 1.0, stamp, 0.0)
        said = motion.advise(pose, speed, [obstacle], GOAL, None, field, MODEL)
        wanted = said.speed_mps if field.velocity_change else gait.cruise_mps
        step = footsteps.footstep(said.heading_rad, wanted, robot, gait)
        step = stepper.choose(step, pose, [obstacle], NO_CELLS, GOAL, stamp)
        if math.isnan(onset) and abs(wrap_angle(robot.yaw + step.turn_rad)) > TURNED_RAD:
            onset = float(math.hypot(place[0] - robot.x, place[1] - robot.y))
        speed, turning = step.forward_m / gait.step_s, turning + abs(step.turn_rad)
        for _ in range(PARTS):
            robot = robot @ Pose2(
                step.forward_m / PARTS, step.lateral_m / PARTS, step.turn_rad / PARTS
            )
            place = place + velocity * gait.step_s / PARTS
            away = math.hypot(place[0] - robot.x, place[1] - robot.y)
            gap = min(gap, away - RADIUS_M - BODY_RADIUS_M)
        stamp += gait.step_s
    return Passing(onset, turning, gap)


def figures(seeds: Sequence[int]) -> tuple[dict[str, float], list[str]]:
    """Figures and table of the specified and of drawn meetings, every walker on each."""
    found: dict[str, float] = {}
    lines = [
        f"meetings along the path            onset m  turning deg   gap m   {len(seeds)} drawn: onset m"
        "  turning deg   gap m  contacts"
    ]
    for name, (field, guarded) in WALKERS.items():
        one = passing(SPECIFIED, field, guarded)
        more = [passing(drawn(seed), field, guarded) for seed in seeds]
        found |= {
            f"specified_onset_m_{name}": one.onset_m,
            f"specified_turning_deg_{name}": math.degrees(one.turning_rad),
            f"specified_gap_m_{name}": one.gap_m,
            f"meeting_onset_m_{name}": float(np.nanmean([p.onset_m for p in more])),
            f"meeting_turning_deg_{name}": math.degrees(np.mean([p.turning_rad for p in more])),
            f"meeting_gap_m_{name}": float(np.mean([p.gap_m for p in more])),
            f"meeting_contacts_{name}": float(sum(p.gap_m < 0.0 for p in more)),
        }
        a, b = (
            [found[f"{kind}_{figure}_{name}"] for figure in ("onset_m", "turning_deg", "gap_m")]
            for kind in ("specified", "meeting")
        )
        lines.append(
            f"  {name:32} {a[0]:7.2f}  {a[1]:11.0f}  {a[2]:6.3f}   {b[0]:17.2f}  {b[1]:11.0f}  {b[2]:6.3f}"
            f"  {found[f'meeting_contacts_{name}']:8.0f}"
        )
    for gain, figure, sign in (
        ("meeting_earlier_m", "onset_m", 1.0),
        ("meeting_turning_saved_deg", "turning_deg", -1.0),
        ("meeting_gap_gained_m", "gap_m", 1.0),
    ):
        with_it, without = (found[f"meeting_{figure}_{name}"] for name in ("virtual", "without"))
        found[gain] = sign * (with_it - without)
    return found, lines
