"""Open-loop walks of the described robots in the physics engine: falls, errors of the step odometry, speed of computing.

A mission of fixed commands: ahead at the usual and at the greatest speed, a turn on the spot, sideways, a curve, a stop. Every seed has
other joint offsets, noise and floor. The gaze moves at random all the while, since a waist moves much of the mass.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from perception.primitives.pose import Pose2
from perception.primitives.robot_model import GaitLimits
from planning.commands import GazeCommand, WalkCommand

BUMPS_M = (0.0, 0.002, 0.005)
AHEAD_M = (5.0, 5.0)  # at the usual and at the greatest speed
TURN_DEG, ASIDE_M, CURVE_STEPS, STILL_STEPS = 90.0, 1.0, 12, 3
GAZE_STEPS = 3  # between two directions of the gaze
EXTENT = (-4.0, -7.0, 14.0, 9.0)


@dataclass(frozen=True, eq=False)
class HumanoidWalk:
    """Result of one mission.

    Args:
        fallen: Whether the robot fell.
        true, told: Motion of every step, from body pose to body pose, in truth and by odometry, (n, 3): m, m, rad.
        realtime_factor: Simulated time divided by computing time.
    """

    fallen: bool
    true: Float[np.ndarray, "n 3"]
    told: Float[np.ndarray, "n 3"]
    realtime_factor: float

    @property
    def errors(self) -> Float[np.ndarray, "n 3"]:
        """True motion of each step relative to what odometry tells, m, m, rad."""
        return step_errors(self.told, self.true)


def step_errors(
    told: Float[np.ndarray, "n 3"], true: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 3"]:
    """Each true step relative to the told one, m, m, rad."""
    pairs = zip(told.tolist(), true.tolist(), strict=True)
    return np.array([(Pose2(*a).inverse() @ Pose2(*b)).vector for a, b in pairs]).reshape(-1, 3)


def mission(gait: GaitLimits, ahead_m: tuple[float, float] = AHEAD_M) -> list[WalkCommand]:
    """The commands for a robot with these limits."""
    slow_m, fast_m = gait.cruise_mps * gait.step_s, gait.max_speed_mps * gait.step_s
    side_m, turn = gait.max_side_mps * gait.step_s, math.radians(gait.max_turn_deg)
    moves = [(slow_m, 0.0, 0.0)] * round(ahead_m[0] / slow_m)
    moves += [(fast_m, 0.0, 0.0)] * round(ahead_m[1] / fast_m)
    moves += [(0.0, 0.0, turn)] * round(TURN_DEG / gait.max_turn_deg)
    moves += [(0.0, side_m, 0.0)] * round(ASIDE_M / side_m)
    moves += [(slow_m, 0.0, -turn)] * CURVE_STEPS + [(0.0, 0.0, 0.0)] * STILL_STEPS
    return [
        WalkCommand(
            *move,
            single_support_s=gait.single_support_s,
            double_support_s=gait.double_support_s,
        )
        for move in moves
    ]


def walk(
    model: str, bump_m: float, seed: int, ahead_m: tuple[float, float] = AHEAD_M
) -> HumanoidWalk:
    """One mission of a described robot over a floor with bumps."""
    from sim.body.dynamic.config import DynamicConfig
    from sim.robot import SimulatedRobot
    from sim.robot_config import RobotConfig
    from sim.robots import catalogue
    from sim.scene import FloorArea, Scene
    from sim.world import World

    floor = (FloorArea("plaster/white", EXTENT),)
    scene = Scene("floor", seed, EXTENT, floor, (), (), (), Pose2(), ())
    config = RobotConfig(
        model=model, body="dynamic", tof=False, stereo=False, colour=False,
        dynamic=DynamicConfig(bump_m=bump_m),
    )  # fmt: skip
    rng = np.random.default_rng([seed, 62])
    description = catalogue.load(model)
    commands = mission(description.model.gait, ahead_m)
    true, told = [], []
    with World(scene, "tiny", seed) as world, SimulatedRobot(world, config, seed) as robot:
        body = robot.body
        body.advance(body.ticks_left)
        began, ticks = time.process_time(), body.ticks
        for number, command in enumerate(commands):
            if number % GAZE_STEPS == 0:
                robot.look(_gaze(description.model.head.tilt_deg, rng))
            before = body.true_pose
            body.walk(command)
            body.start_due_step()
            moved = Pose2()
            while body.ticks_left > 0 and not body.fallen:
                moved = moved @ body.advance(min(20, body.ticks_left)).motion
            if body.fallen:
                break
            true.append((before.inverse() @ body.true_pose).vector)
            told.append(moved.vector)
        seconds = (body.ticks - ticks) * robot.config.gait.tick_s
        factor = seconds / max(time.process_time() - began, 1e-9)
        fallen = body.fallen
    return HumanoidWalk(
        fallen,
        np.array(true).reshape(-1, 3),
        np.array(told).reshape(-1, 3),
        factor,
    )


def _gaze(tilt_deg: tuple[float, float], rng: np.random.Generator) -> GazeCommand:
    high, low = (math.radians(v) for v in tilt_deg)
    return GazeCommand(float(rng.uniform(-1.0, 1.0)), float(rng.uniform(high, low)))
