"""Simulate a walk through a scene and write its run folder."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from perception.primitives.pose import Pose2, wrap_angle
from planning.planners.factory import make
from planning.planners.mission import ON_LEVELS
from planning.planners.planner import Planner

from ..config.schema import Config
from ..progress import Say
from ..recordings.mcap_format import RecordingWriter
from ..recordings.recording import RecordingInfo
from ..results.run_folder import RunFolder
from . import level_walk
from .bodies import LiveBody
from .interrupt import stop_requested
from .level_pipeline import make_pipeline
from .loop import Cycle, cycles
from .run_recorder import RunRecorder
from .summary import Decided, Summary, why_unfinished

if TYPE_CHECKING:
    from sim.robot import SimulatedRobot
    from sim.robot_config import RobotConfig
    from sim.scene import Scene

    from ..report.live_view import LivePage


TRIES = 100  # ours: samples of the start pose
START_COVARIANCE = np.diag(np.square([0.01, 0.01, np.radians(1.0)]))
"""Ours: covariance of the start pose (x, y, yaw) of a robot that somebody puts on its mark, m^2 and rad^2."""
SETTLING = np.diag(np.square([0.005, 0.005, np.radians(3.0)]))
"""Ours: added for a dynamic body, which rotates by some degrees while its soles settle."""


def scene_of(config: Config) -> Scene:
    """The scene of a walk, with its walls, objects and movers.

    Raises:
        InputError: Unknown scene, or a scene file that cannot be read.
    """
    from sim.scenes import catalogue  # loaded only for simulation

    return catalogue.load(
        config.scene, config.seed, config.difficulty, config.movers, config.robot.walker
    )


def start_covariance(robot: RobotConfig) -> Float[np.ndarray, "3 3"]:
    """Covariance of the start pose (x, y, yaw) about its mark, m^2 and rad^2."""
    return START_COVARIANCE + SETTLING if robot.body == "dynamic" else START_COVARIANCE


def true_start(scene: Scene, config: Config) -> Pose2:
    """The true start pose: sampled around its mark with `START_COVARIANCE`, free of collision.

    If no sample is free, it is the mark itself.
    """
    from sim.shapes import distance

    rng = np.random.default_rng([config.seed, 34])
    radius = math.hypot(*config.robot.measures.trunk_m[:2]) / 2
    top_m = config.robot.walker.top_m
    parts = [
        part for static in scene.static_objects for part in static.parts if part.bottom_m < top_m
    ]
    x0, y0, x1, y1 = scene.extent
    for _ in range(TRIES):
        x, y, yaw = rng.multivariate_normal(scene.start.vector, START_COVARIANCE)
        gaps = [x - x0, y - y0, x1 - x, y1 - y]
        gaps += [float(distance(part, np.array([[x, y]]))[0]) for part in parts]
        if min(gaps) >= radius:
            return Pose2(float(x), float(y), wrap_angle(float(yaw)))
    return scene.start


def simulate(
    config: Config,
    out: Path | None,
    record: bool,
    say: Say,
    page: LivePage | None = None,
    report: bool = True,
    watch: Callable[[Cycle], object] = lambda cycle: None,
) -> Summary:
    """Walk through a simulated scene until its goals are reached or the time limit ends the walk.

    After Ctrl-C the run folder holds the walk up to the last frame.

    Args:
        config: Settings; `config.scene` and `config.seed` define the world.
        out: Run folder; None for the next free one below runs/.
        record: Write the sensor data to recording.mcap.
        say: Receives lines of progress.
        page: Shows the walk while it goes on, and may make it wait between two frames.
        report: Write report.html, replay.html and the tables, which takes seconds.
        watch: Is given every cycle, for studies.

    Raises:
        InputError, ConfigError: Unknown scene or planner, or one that does not go with the other settings.
        OutputError: The folder cannot be written.
        SurefootError: PyBullet or MuJoCo, which the robot needs, is not installed.
    """
    from sim.faults.injection import FaultInjector
    from sim.robot import SimulatedRobot
    from sim.world import World

    from ..results.ground_truth_log import TruthLog
    from ..results.level_truth import LevelTruth

    config.robot.require()
    scene = scene_of(config)
    config = level_walk.planned(config, scene)
    goals = () if config.mission.wander else scene.goals[: config.mission.goals]
    folder = RunFolder.create(out, name=f"{scene.name}-{config.seed}")
    placed = replace(scene, start=true_start(scene, config))
    with contextlib.ExitStack() as stack:
        world = stack.enter_context(World(placed, config.renderer, config.seed))
        begin = stack.enter_context(_recorder(folder, record))
        robot = stack.enter_context(SimulatedRobot(world, config.robot, config.seed))
        info = known_beforehand(scene, robot, config)
        truth = (LevelTruth if info.levels else TruthLog)(robot, scene, folder)
        faults = FaultInjector(config.faults, config.seed)
        body = LiveBody(robot, begin(info), faults, lambda: truth.note(world.stamp_s))
        pipeline = make_pipeline(config, info)
        planner = make_planner(config, goals)
        recorder = RunRecorder(folder, config.resolved(renderer=world.renderer), info, goals)
        if page is not None:
            page.watch(folder)
        stopped = stack.enter_context(stop_requested())
        interrupted, decided = False, list[Decided]()
        limit_s = config.mission.time_limit_s
        for cycle in cycles(body, pipeline, planner, config.planning.robot, limit_s):
            truth.note(cycle.world.stamp_s, faults.touched(), cycle.world.estimate.views)
            moment = recorder.note(cycle)
            watch(cycle)
            if cycle.decision is not None:
                here = cycle.world.pose2
                decided.append(Decided(cycle.world.stamp_s, cycle.decision.why, (here.x, here.y)))
            if page is not None and moment is not None:
                page.show(moment, stopped)
            say(recorder.progress(cycle.world, planner))
            if interrupted := stopped():
                break
        if body.fell_at_s is not None:
            truth.note(body.fell_at_s)
        truth.finish()
    reached = (planner.reached, len(goals)) if goals else None
    ended: tuple[str, ...] = ()
    if planner.reached < len(goals) and body.fell_at_s is None and not interrupted:
        left_m = planner.distance_to_goal(cycle.world)
        ended = why_unfinished(decided, cycle.world.stamp_s, limit_s, left_m)
    summary = _summary(folder, recorder, config, reached, body.fell_at_s, interrupted, ended)
    _keep_looks(planner, recorder)
    recorder.finish(pipeline, summary.as_dict(), report)
    if page is not None:
        page.finish()
    return summary


def make_planner(config: Config, goals: Sequence[tuple[float, float]]) -> Planner:
    """The planner of a run, with recovery and fall-back if the robot's cameras allow them."""
    robot = config.robot
    fall_back = config.depth_health.fall_back and robot.colour
    return make(config.planning, goals, robot.tof or robot.depth, fall_back)


def known_beforehand(scene: Scene, robot: SimulatedRobot, config: Config) -> RecordingInfo:
    """Prior knowledge of the robot: its start pose, the landmarks, and the direction of gravity."""
    return RecordingInfo(
        name=f"{scene.name}-{config.seed}",
        kind="simulation",
        landmarks=scene.landmarks,
        start=scene.start,
        scene=config.scene,
        start_covariance=start_covariance(config.robot),
        floor_height_world_m=0.0,
        gravity_up_world=robot.up,
        calibrated=True,
        own_body=robot.own_body,
        levels=config.mission.planner == ON_LEVELS,
    )


def _summary(
    folder: RunFolder,
    recorder: RunRecorder,
    config: Config,
    reached: tuple[int, int] | None,
    fell_at_s: float | None,
    interrupted: bool,
    ended: tuple[str, ...],
) -> Summary:
    """How the walk ended: goals reached and of how many, fall, and what the status noted."""
    fall = () if fell_at_s is None else (f"the robot fell after {fell_at_s:.1f} s",)
    return Summary(
        folder.root,
        recorder.frames,
        recorder.seconds,
        reached=reached,
        notes=(*ended, *fall, *recorder.status_notes()),
        fell_at_s=fell_at_s,
        body=config.robot.body,
        interrupted=interrupted,
    )


def _keep_looks(planner: Planner, recorder: RunRecorder) -> None:
    """Store the panoramic scans of a planner as pictures with the four panes of seed 004."""
    if not hasattr(planner, "looks"):
        return
    from ..report.plots import avoidance  # loaded only for these pictures

    for look in planner.looks:
        recorder.keep_picture(look.stamp_s, "panoramic scan", avoidance.png_of(look))


@contextlib.contextmanager
def _recorder(
    folder: RunFolder, wanted: bool
) -> Iterator[Callable[[RecordingInfo], RecordingWriter | None]]:
    """A function that starts the recording; the recording is closed on exit."""
    with contextlib.ExitStack() as stack:

        def begin(info: RecordingInfo) -> RecordingWriter | None:
            if not wanted:
                return None
            return stack.enter_context(RecordingWriter(folder.path("recording.mcap"), info))

        yield begin
