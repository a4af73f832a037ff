"""One walk over a course by geometry alone, every contact counted and classed.

The body, its gait and its slip are those of the simulated robot, the planner is the real one; only pictures
are left out (`course_senses`). A contact is the study's: the disc of seed 001's robot (S_r) touches
another.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from perception.primitives.pose import wrap_angle
from planning.planners.mission import MissionConfig
from planning.safety.step_filter import Stepper
from sim.robot import RobotConfig, SimulatedRobot
from sim.scene import Scene
from sim.scenes import catalogue
from sim.scenes.course import COLOURS
from sim.world import World

from ...config.schema import Config
from ...evaluation.metrics.contacts import BODY_RADIUS_M, Contact, Touch, class_of
from ...navigator import Navigator
from ...recordings.recording import RecordingInfo
from ...run.pipeline import Pipeline
from ...run.simulate import start_covariance
from .geometric_perception import CourseSenses

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


def walk(config: Config, truly: bool = False, stepper: Stepper | None = None) -> Walk:
    """Walk the course of `config.scene` and `config.seed`.

    Args:
        config: As from `course_config`, or `pictures_config`: then the whole pipeline sees.
        truly: With true perception instead of the sensors'.
        stepper: Who checks and makes the steps; None: the guard.
    """
    scene = catalogue.load(config.scene, config.seed, config.difficulty)
    robot_config: RobotConfig = config.robot
    result, touching = Walk(), Touch()
    pictures = robot_config.tof
    with (
        World(scene, config.renderer if pictures else "tiny", config.seed) as world,
        SimulatedRobot(world, robot_config, config.seed) as robot,
    ):
        senses = CourseSenses(config, robot, config.seed, truly)
        pipeline = Pipeline(config, _told(scene, robot)) if pictures else senses
        planner = Navigator(config, scene.goals, stepper)
        while True:
            frame = robot.read()
            if robot.fallen:
                result.fell = True
                break
            estimate = pipeline.cycle(frame)
            if pictures:
                senses.watch(frame.stamp_s, estimate.obstacles)
            _judge(scene, senses, touching, frame.stamp_s, result)
            if frame.footstep_due:
                decision = planner.decide(frame, estimate, pipeline)
                spent = decision.timing_ms | {"tracks": senses.tracking_ms}
                result.decision_ms.append(sum(spent.values()))
                result.cycle_ms.append(sum(spent.get(stage, 0.0) for stage in CYCLE))
                robot.walk(decision.walk)
                robot.look(decision.gaze)
                true = senses.truth.robot_pose()
                result.trace.append((frame.stamp_s, true.x, true.y, true.yaw))
                if estimate.pose is not None:
                    x, y, yaw = (estimate.pose.mean - true.vector).tolist()
                    result.pose_errors.append((x, y, wrap_angle(yaw)))
                result.turning_rad += abs(decision.walk.turn_rad)
                result.guarded += decision.why == "guard"
                touching.step(decision.walk)
            if planner.finished(estimate):
                break
        result.arrived = planner.reached == len(scene.goals) and not result.fell
        result.time_s = world.stamp_s
    return result


def _judge(
    scene: Scene, senses: CourseSenses, touching: Touch, stamp_s: float, result: Walk
) -> None:
    """Gaps of this instant; a new contact is noted with its class."""
    true = senses.truth.robot_pose()
    x0, y0, x1, y1 = scene.extent
    wall = min(true.x - x0, true.y - y0, x1 - true.x, y1 - true.y)
    away = np.hypot(senses.discs[:, 0] - true.x, senses.discs[:, 1] - true.y)
    gaps = dict(enumerate((away - senses.discs[:, 2] - BODY_RADIUS_M).tolist()))
    gaps[-1] = wall - BODY_RADIUS_M
    result.clearance_m = min(result.clearance_m, *gaps.values())
    for index in touching.begun(gaps, APART_M):
        record = senses.followed.get(index)
        turned = senses.since_turned(index)
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


def _told(scene: Scene, robot: SimulatedRobot) -> RecordingInfo:
    """What the robot is told beforehand: its start, the tags, and what is up."""
    return RecordingInfo(
        name=f"{scene.name}-{scene.seed}",
        kind="simulation",
        landmarks=scene.landmarks,
        start=scene.start,
        scene=scene.name,
        start_covariance=start_covariance(robot.config),
        floor_height_world_m=0.0,
        gravity_up_world=robot.up,
    )


def scene_name(scene: Scene, index: int) -> str:
    """Of the obstacle of that place in the list of the truth."""
    movers = len(scene.moving_objects)
    return (
        scene.moving_objects[index].name if index < movers else scene.obstacles[index - movers].name
    )
