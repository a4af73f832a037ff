"""One walk over a course, by geometric perception or from images, with every contact counted and classified.

Body, gait, slip and planner are those of every simulated walk. A contact is that of the study: the disc of seed 001's
robot (S_r) touches another disc or a wall.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from perception.primitives.pose import wrap_angle
from planning.planners.mission import MissionConfig
from planning.planners.planner import Decision
from planning.planners.search_planner import SearchPlanner
from planning.safety.step_filter import StepFilter
from planning.world_model import WorldModel
from sim import bullet
from sim.robot import SimulatedRobot
from sim.scene import Scene
from sim.scenes import catalogue
from sim.scenes.course import COLOURS
from sim.world import World

from ...config.schema import Config
from ...evaluation.metrics.contacts import BODY_RADIUS_M, Contact, Touch, class_of
from ...run.bodies import LiveBody
from ...run.loop import cycles
from ...run.perception_source import PerceptionSource
from ...run.pipeline import Pipeline
from ...run.simulate import known_beforehand
from .geometric_perception import GeometricPerception

PASSED_M = 0.30  # navigation study: a via point counts as reached when passed within 0.3 m
TIME_LIMIT_S = 900.0  # ours: half as long again as the paper's 560.2 s
CYCLE = ("tracks", "gaze", "field")  # of the stages of a decision, those of seed 001
APART_M = 0.02  # a contact is over once there is a gap of so much


@dataclass
class Walk:
    """What came of a course.

    Args:
        contacts: Every one.
        arrived: Whether all via points were passed in time.
        fell: Whether the robot fell, which ends a walk.
        time_s: When it ended.
        clearance_m: Least gap to anything.
        turning_rad: Sum of all turns.
        guarded: Steps that were not the field's.
        cycle_ms: What seed 001 decides at every footstep: tracks (by geometry), gaze, field and footstep.
        decision_ms: The same with the search of the route and the guard.
        trace: (stamp, x, y, yaw) at every decision.
        pose_errors: Believed less true (x, y, yaw) at every decision.
    """

    contacts: list[Contact] = field(default_factory=list)
    arrived: bool = False
    fell: bool = False
    time_s: float = 0.0
    clearance_m: float = np.inf
    turning_rad: float = 0.0
    guarded: int = 0
    cycle_ms: list[float] = field(default_factory=list)
    decision_ms: list[float] = field(default_factory=list)
    trace: list[tuple[float, float, float, float]] = field(default_factory=list)
    pose_errors: list[tuple[float, float, float]] = field(default_factory=list)


def course_config(scene: str, seed: int, config: Config | None = None) -> Config:
    """The configuration of such a walk: all via points, passed within 0.3 m, and no cameras."""
    base = Config() if config is None else config
    return replace(
        base,
        scene=scene,
        seed=seed,
        mission=MissionConfig(goals=99, tolerance_m=PASSED_M, time_limit_s=TIME_LIMIT_S),
        robot=replace(base.robot, tof=False, stereo=False, colour=False),
    )


def pictures_config(scene: str, seed: int, config: Config | None = None) -> Config:
    """The same from pictures: the time-of-flight camera for the map, colour for obstacles and tags."""
    one = course_config(scene, seed, config)
    return replace(
        one,
        robot=replace(one.robot, tof=True, colour=True),
        coloured=replace(one.coloured, colours=COLOURS),
    )


def walk(config: Config, perfect: bool = False, stepper: StepFilter | None = None) -> Walk:
    """Walk the course of `config.scene` and `config.seed`.

    Args:
        config: From `course_config`, or from `pictures_config` to perceive from images.
        perfect: Perception without errors instead of simulated detections.
        stepper: Checks every step; None: the guard.
    """
    bullet.require(config.robot)
    scene = catalogue.load(config.scene, config.seed, config.difficulty)
    result, touching = Walk(), Touch()
    images = config.robot.tof
    with (
        World(scene, config.renderer if images else "tiny", config.seed) as world,
        SimulatedRobot(world, config.robot, config.seed) as robot,
    ):
        geometric = GeometricPerception(config, robot, config.seed, perfect)
        perception: PerceptionSource = geometric
        if images:
            perception = Pipeline(config, known_beforehand(scene, robot, config))
        planner = SearchPlanner(config.planning, scene.goals, stepper)
        body = LiveBody(robot)
        for cycle in cycles(body, perception, planner):
            stamp_s, decision = cycle.frame.stamp_s, cycle.decision
            if images:
                geometric.watch(stamp_s, cycle.world.tracks)
            _judge(scene, geometric, touching, stamp_s, result)
            if decision is not None:
                _note(result, cycle.world, decision, geometric)
                touching.step(decision.walk)
        result.fell = body.fell_at_s is not None
        result.arrived = planner.reached == len(scene.goals) and not result.fell
        result.time_s = world.stamp_s
    return result


def _note(
    result: Walk, world: WorldModel, decision: Decision, geometric: GeometricPerception
) -> None:
    """Take in one decision."""
    spent = decision.timing_ms | {"tracks": geometric.tracking_ms}
    result.decision_ms.append(sum(spent.values()))
    result.cycle_ms.append(sum(spent.get(stage, 0.0) for stage in CYCLE))
    true = geometric.truth.robot_pose()
    result.trace.append((world.stamp_s, true.x, true.y, true.yaw))
    if world.pose is not None:
        x, y, yaw = (world.pose.mean - true.vector).tolist()
        result.pose_errors.append((x, y, wrap_angle(yaw)))
    result.turning_rad += abs(decision.walk.turn_rad)
    result.guarded += decision.why == "guard"


def _judge(
    scene: Scene, geometric: GeometricPerception, touching: Touch, stamp_s: float, result: Walk
) -> None:
    """Gaps of this instant; a new contact is noted with its class."""
    true = geometric.truth.robot_pose()
    x0, y0, x1, y1 = scene.extent
    wall = min(true.x - x0, true.y - y0, x1 - true.x, y1 - true.y)
    away = np.hypot(geometric.discs[:, 0] - true.x, geometric.discs[:, 1] - true.y)
    gaps = dict(enumerate((away - geometric.discs[:, 2] - BODY_RADIUS_M).tolist()))
    gaps[-1] = wall - BODY_RADIUS_M
    result.clearance_m = min(result.clearance_m, *gaps.values())
    for index in touching.begun(gaps, APART_M):
        record = geometric.followed.get(index)
        turned = geometric.since_turned(index)
        contact = Contact(
            stamp_s,
            "wall" if index < 0 else scene_name(scene, index),
            0 <= index < len(scene.moving_objects),
            np.inf if record is None else stamp_s - record.seen_s,
            0.0 if record is None else stamp_s - record.since_s,
            turned,
            touching.standing,
        )
        result.contacts.append(replace(contact, kind=class_of(contact)))


def scene_name(scene: Scene, index: int) -> str:
    """Of the obstacle of that place in the list of the truth."""
    movers = len(scene.moving_objects)
    return (
        scene.moving_objects[index].name if index < movers else scene.obstacles[index - movers].name
    )
