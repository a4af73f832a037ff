"""Encounters with a single moving obstacle that crosses the robot's path: the benefit of uncertainty to the field.

Courses contain other situations as well (obstacles behind the robot, reversals, narrow passages). An encounter has only
the case that the collision test is made for: the obstacle moves at constant velocity, the head follows it, and its
velocity is estimated by the tracker. Paths, sizes and meeting times are random; a few pairs would not meet at all.

Source: Yoo and Kim 2010 (seed 001), section 4, and its open problem (uncertain velocities); the encounters are ours.
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

PATH_M = 3.0
ARRIVED_M = 0.15
LIMIT_S = 120.0
MEETS_S = 8.0, 16.0  # time of the closest approach without avoidance
MISS_M = 0.4  # greatest offset of the obstacle from the meeting point
SPEED_MPS = 0.03, 0.06  # slow moving obstacles of the courses
CROSSES_DEG = 40.0, 140.0  # angle between both paths, from either side
RADIUS_M = 0.08, 0.14
TILT_RAD = 0.5  # of the head, which pans to the obstacle
MAX_PAN_RAD = 1.5
PARTS = 5  # of a step; distances are measured after each
POSE_COVARIANCE = np.eye(3) * 1e-8  # the robot's pose is known


@dataclass(frozen=True)
class Encounter:
    """Result of one encounter.

    Args:
        clearance_m: Least gap between robot and obstacle; negative: a contact.
        time_s: Time to the goal, at most `LIMIT_S`.
        turning_rad: Sum of the absolute turns.
    """

    clearance_m: float
    time_s: float
    turning_rad: float


def encounter(seed: int, field: FieldConfig) -> Encounter:
    """Simulate one encounter; obstacle and detection errors depend on the seed alone."""
    rng, detection_rng = (
        np.random.default_rng(s) for s in np.random.SeedSequence([seed, 50]).spawn(2)
    )
    gait, sensor = DARWIN_OP.gait, GeometricSensor(detection_rng)
    place, velocity, radius = _moving_obstacle(rng, gait.cruise_mps)
    tracker, robot, goal = ObstacleTracker(), Pose2(0.0, 0.0, 0.0), np.array([PATH_M, 0.0])
    speed, stamp, turning, clearance = gait.cruise_mps, 0.0, 0.0, math.inf
    while stamp < LIMIT_S and math.hypot(goal[0] - robot.x, goal[1] - robot.y) > ARRIVED_M:
        pose = Gaussian(robot.vector, POSE_COVARIANCE)
        seen = robot.inverse().apply(place[None])[0]
        pan = min(max(math.atan2(seen[1], seen[0]), -MAX_PAN_RAD), MAX_PAN_RAD)
        detections = [
            Detection(one.position, one.covariance, one.radius_m, 0.4)
            for one in sensor.look(np.array([[*seen, radius]]), pan, TILT_RAD, True)
            if one.whole
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
    return Encounter(clearance, stamp, turning)


def encounters(seeds: Sequence[int], field: FieldConfig) -> list[Encounter]:
    """Simulate one encounter per seed, in order."""
    return [encounter(seed, field) for seed in seeds]


def _moving_obstacle(
    rng: np.random.Generator, cruise_mps: float
) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"], float]:
    """Initial position, velocity and radius of an obstacle that crosses the x axis, the robot's path."""
    along = math.radians(rng.uniform(*CROSSES_DEG)) * rng.choice([-1.0, 1.0])
    velocity = rng.uniform(*SPEED_MPS) * np.array([math.cos(along), math.sin(along)])
    meets = rng.uniform(*MEETS_S)
    meeting_point = np.array([cruise_mps * meets + rng.uniform(-MISS_M, MISS_M), 0.0])
    return meeting_point - velocity * meets, velocity, float(rng.uniform(*RADIUS_M))
