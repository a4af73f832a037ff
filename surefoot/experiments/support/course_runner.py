"""One walk over a course, with geometric perception or from images, with every contact counted and classified.

Body, gait, slip and planner are those of every simulated walk. A contact begins when the disc of the robot (radius
S_r) touches another disc or a wall.

Source: Yoo and Kim 2010 (seed 001), section V-C.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from perception.primitives.pose import wrap_angle
from planning.planners.field_planner import FieldPlanner
from planning.planners.mission import MissionConfig
from planning.planners.planner import Decision
from planning.planners.search_planner import SearchPlanner
from planning.safety.step_filter import StepFilter
from planning.univector.fields import FieldConfig
from planning.world_model import WorldModel
from sim.robot import SimulatedRobot
from sim.scene import Scene
from sim.scenes.course import COLOURS
from sim.world import World

from ...config.schema import Config
from ...evaluation.metrics.contact_classes import Contact
from ...evaluation.metrics.contacts import BODY_RADIUS_M, Touch
from ...run.bodies import LiveBody
from ...run.loop import cycles
from ...run.perception_source import PerceptionSource
from ...run.pipeline import Pipeline
from ...run.simulate import known_beforehand, scene_of, true_start
from .geometric_perception import GeometricPerception

PASSED_M = 0.30  # navigation study: a via point counts as reached when passed within 0.3 m
TIME_LIMIT_S = 900.0  # ours: 1.6 times the paper's 560.2 s
CYCLE = ("tracks", "gaze", "field")  # stages of a decision that seed 001 times
APART_M = 0.02  # a contact ends at a gap of this size


@dataclass
class CourseWalk:
    """Result of a walk over a course.

    Args:
        contacts: All contacts.
        arrived: Whether all via points were passed within the time limit.
        fell: Whether the robot fell, which ends the walk.
        time_s: Duration.
        clearance_m: Least gap to any obstacle or wall.
        turning_rad: Sum of the absolute turns.
        guarded: Number of steps that the guard changed.
        cycle_ms: Time of tracking, gaze, field and footstep at every decision (the cycle of seed 001).
        decision_ms: Time of every decision, including path search and guard.
        trace: True (stamp, x, y, yaw) at every decision.
        pose_errors: Estimated minus true (x, y, yaw) at every decision.
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


def course_config(scene: str, seed: int) -> Config:
    """Configuration of a walk by geometric perception: all via points, passed within 0.3 m, no cameras."""
    base = Config()
    return replace(
        base,
        scene=scene,
        seed=seed,
        mission=MissionConfig(goals=99, tolerance_m=PASSED_M, time_limit_s=TIME_LIMIT_S),
        robot=replace(base.robot, tof=False, stereo=False, colour=False),
    )


def published(config: Config, mode: str = "seed") -> Config:
    """The same walked by seed 001 alone: its gaze, its field and its change of speed, without search and guard.

    Args:
        config: From `course_config` or `image_config`.
        mode: "seed", or "printed" for the printed weights.
    """
    return replace(
        config,
        mission=replace(config.mission, planner="field"),
        univector=FieldConfig(mode=mode),
        gaze=replace(config.gaze, mode="seed"),
    )


def image_config(scene: str, seed: int) -> Config:
    """Configuration of a walk from images: time of flight for the map, colour for obstacles and tags."""
    one = course_config(scene, seed)
    return replace(
        one,
        robot=replace(one.robot, tof=True, colour=True),
        coloured=replace(one.coloured, colours=COLOURS),
    )


def walk(config: Config, perfect: bool = False, stepper: StepFilter | None = None) -> CourseWalk:
    """Walk the course of `config.scene` and `config.seed`.

    Args:
        config: From `course_config`, or from `image_config` for perception from images; `mission.planner` may be "field".
        perfect: Error-free perception instead of simulated detections.
        stepper: Checks every step of the planner "search"; None: the guard.
    """
    config.robot.require()
    scene = scene_of(config)
    placed = replace(scene, start=true_start(scene, config))
    result, touch = CourseWalk(), Touch()
    images = config.robot.tof
    with (
        World(placed, config.renderer if images else "tiny", config.seed) as world,
        SimulatedRobot(world, config.robot, config.seed) as robot,
    ):
        info = known_beforehand(scene, robot, config)
        geometric = GeometricPerception(config, robot, info, perfect)
        perception: PerceptionSource = Pipeline(config, info) if images else geometric
        planner: FieldPlanner | SearchPlanner
        if config.mission.planner == "field":
            planner = FieldPlanner(config.planning, scene.goals)
        else:
            planner = SearchPlanner(config.planning, scene.goals, stepper)
        body = LiveBody(robot)
        limit_s = config.mission.time_limit_s
        for cycle in cycles(body, perception, planner, limit_s=limit_s):
            stamp_s, decision = cycle.frame.stamp_s, cycle.decision
            geometric.watch(stamp_s, cycle.world.tracks)
            _record_contacts(scene, geometric, touch, stamp_s, result)
            if decision is not None:
                _record_decision(result, cycle.world, decision, geometric)
                touch.step(decision.walk)
        result.fell = body.fell_at_s is not None
        result.arrived = planner.reached == len(scene.goals) and not result.fell
        result.time_s = world.stamp_s
    return result


def _record_decision(
    result: CourseWalk, world: WorldModel, decision: Decision, geometric: GeometricPerception
) -> None:
    """Record one decision."""
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


def _record_contacts(
    scene: Scene,
    geometric: GeometricPerception,
    touch: Touch,
    stamp_s: float,
    result: CourseWalk,
) -> None:
    """Record the gaps of this instant, and every new contact with its class."""
    true = geometric.truth.robot_pose()
    x0, y0, x1, y1 = scene.extent
    wall = min(true.x - x0, true.y - y0, x1 - true.x, y1 - true.y)
    away = np.hypot(geometric.discs[:, 0] - true.x, geometric.discs[:, 1] - true.y)
    gaps = dict(enumerate((away - geometric.discs[:, 2] - BODY_RADIUS_M).tolist()))
    gaps[-1] = wall - BODY_RADIUS_M
    result.clearance_m = min(result.clearance_m, *gaps.values())
    for index in touch.begun(gaps, APART_M):
        record = geometric.followed.get(index)
        turned = geometric.since_turned(index)
        result.contacts.append(
            Contact(
                stamp_s,
                "wall" if index < 0 else obstacle_name(scene, index),
                0 <= index < len(scene.moving_objects),
                np.inf if record is None else stamp_s - record.seen_s,
                0.0 if record is None else stamp_s - record.since_s,
                turned,
                touch.standing,
            )
        )


def obstacle_name(scene: Scene, index: int) -> str:
    """Name of the obstacle with this index in the list of true obstacles."""
    movers = len(scene.moving_objects)
    return (
        scene.moving_objects[index].name if index < movers else scene.obstacles[index - movers].name
    )
