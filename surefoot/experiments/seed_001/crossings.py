"""One mover crosses the robot's way: what doubt of its place and velocity is worth to the field.

A course mixes this with everything else (movers behind the robot, reversals, narrow ways). Here is nothing but
the case that the collision test is made for: the mover goes straight on, the head follows it, its velocity is
known as the tracker knows it after a few looks. Ways, sizes and instants are drawn; a few of them would not
meet at all.

Source: seed 001, section 4, and its open problem (uncertain velocities); the encounters are ours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from perception.obstacles.track import Detection
from perception.obstacles.tracker import ObstacleTracker
from perception.primitives.gaussian import Gaussian
from perception.primitives.pose import Pose2
from perception.primitives.robot_model import DARWIN_OP
from planning import footsteps
from planning.univector import motion
from planning.univector.fields import FieldConfig
from sim.sensors.geometric_sensor import GeometricSensor

from ...evaluation.metrics.contacts import BODY_RADIUS_M

WAY_M = 3.0
ARRIVED_M = 0.15
LIMIT_S = 120.0
MEETS_S = 8.0, 16.0  # when both would be nearest, if neither cared
MISS_M = 0.4  # before or behind the meeting point, at most
SPEED_MPS = 0.03, 0.06  # the slow movers of the courses
CROSSES_DEG = 40.0, 140.0  # from the robot's way, from either side
RADIUS_M = 0.08, 0.14
TILT_RAD = 0.5  # of the head, which pans to the mover
MAX_PAN_RAD = 1.5
PARTS = 5  # of a step, between which distances are taken
SURE = np.eye(3) * 1e-8  # the robot knows where it is


@dataclass(frozen=True)
class Crossing:
    """What came of one encounter.

    Args:
        clearance_m: Least gap between the surfaces; below 0: a contact.
        time_s: Until the goal was reached, or the limit.
        turning_rad: Sum of all turns.
    """

    clearance_m: float
    time_s: float
    turning_rad: float


def cross(seed: int, field: FieldConfig) -> Crossing:
    """One encounter; the same mover and the same errors of each look for every field."""
    draw, looks = (np.random.default_rng(s) for s in np.random.SeedSequence([seed, 50]).spawn(2))
    gait, sensor = DARWIN_OP.gait, GeometricSensor(looks)
    place, velocity, radius = _mover(draw, gait.cruise_mps)
    tracker, robot, goal = ObstacleTracker(), Pose2(0.0, 0.0, 0.0), np.array([WAY_M, 0.0])
    speed, stamp, turning, clearance = gait.cruise_mps, 0.0, 0.0, math.inf
    while stamp < LIMIT_S and math.hypot(goal[0] - robot.x, goal[1] - robot.y) > ARRIVED_M:
        pose = Gaussian(robot.vector, SURE)
        seen = robot.inverse().apply(place[None])[0]
        pan = min(max(math.atan2(seen[1], seen[0]), -MAX_PAN_RAD), MAX_PAN_RAD)
        detections = [
            Detection(one.position, one.covariance, one.radius_m, 0.4)
            for one in sensor.look(np.array([[*seen, radius]]), pan, TILT_RAD, True)
        ]
        tracker.update(stamp, detections, pose)
        advice = motion.advise(pose, speed, tracker.obstacles, goal, None, field)
        wanted = advice.speed_mps if field.velocity_change else gait.cruise_mps
        step = footsteps.footstep(advice.heading_rad, wanted, robot, gait)
        speed = step.forward_m / gait.step_s
        turning += abs(step.turn_rad)
        for _ in range(PARTS):
            robot = robot @ Pose2(step.forward_m / PARTS, 0.0, step.turn_rad / PARTS)
            place = place + velocity * gait.step_s / PARTS
            away = math.hypot(place[0] - robot.x, place[1] - robot.y)
            clearance = min(clearance, away - radius - BODY_RADIUS_M)
        stamp += gait.step_s
    return Crossing(clearance, stamp, turning)


def cross_all(seeds: Sequence[int], field: FieldConfig) -> list[Crossing]:
    """Many encounters, in order."""
    return [cross(seed, field) for seed in seeds]


def _mover(
    draw: np.random.Generator, cruise_mps: float
) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"], float]:
    """Place at the beginning, velocity and radius of what crosses the x axis, which the robot walks along."""
    along = math.radians(draw.uniform(*CROSSES_DEG)) * draw.choice([-1.0, 1.0])
    velocity = draw.uniform(*SPEED_MPS) * np.array([math.cos(along), math.sin(along)])
    meets = draw.uniform(*MEETS_S)
    there = np.array([cruise_mps * meets + draw.uniform(-MISS_M, MISS_M), 0.0])
    return there - velocity * meets, velocity, float(draw.uniform(*RADIUS_M))
