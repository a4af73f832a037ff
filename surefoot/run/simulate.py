"""Whole runs: a walk through a simulated scene, a recording processed; both end in a run folder."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from perception.estimate import Estimate
from perception.primitives.frame import Frame
from perception.primitives.pose import Pose2, wrap_angle

from ..config.schema import Config
from ..planners import Planner, make
from ..recordings.mcap_format import RecordingWriter
from ..recordings.recording import RecordingInfo
from ..results.run_folder import RunFolder
from .bodies import LiveBody
from .loop import walk_loop
from .pipeline import Pipeline
from .run_recorder import Journal
from .summary import Say, Summary

if TYPE_CHECKING:
    from sim.robot import RobotConfig
    from sim.scene import Scene


DRAWS = 100  # ours: more means that there is no room
START_COVARIANCE = np.diag(np.square([0.01, 0.01, np.radians(1.0)]))  # put down on its mark by hand
SETTLING = np.diag(np.square([0.005, 0.005, np.radians(3.0)]))
"""Ours: a body with dynamics twists on its soles until they are at rest, one of four by some degrees."""


def start_covariance(robot: RobotConfig) -> Float[np.ndarray, "3 3"]:
    """How far from its mark (x, y, yaw) the robot may stand when time begins, m and rad."""
    return START_COVARIANCE + SETTLING if robot.body == "dynamic" else START_COVARIANCE


def put_down(scene: Scene, config: Config) -> Pose2:
    """Where the robot really stands: drawn about its mark as `START_COVARIANCE` has it, clear of all things.

    A mark that has no such place about it is met exactly.
    """
    from sim.scenes.free_space import ROBOT_TOP_M
    from sim.shapes import distance

    rng = np.random.default_rng([config.seed, 34])
    radius = math.hypot(*config.robot.dynamic.body.trunk_m[:2]) / 2
    parts = [
        part
        for thing in scene.static_objects
        for part in thing.parts
        if part.bottom_m < ROBOT_TOP_M
    ]
    x0, y0, x1, y1 = scene.extent
    for _ in range(DRAWS):
        x, y, yaw = rng.multivariate_normal(scene.start.vector, START_COVARIANCE)
        gaps = [x - x0, y - y0, x1 - x, y1 - y]
        gaps += [float(distance(part, np.array([[x, y]]))[0]) for part in parts]
        if min(gaps) >= radius:
            return Pose2(float(x), float(y), wrap_angle(float(yaw)))
    return scene.start


def simulate(
    config: Config, out: Path | None, record: bool, say: Say, watch: bool = False
) -> Summary:
    """Walk through a simulated scene until its goals are reached or the time is up.

    Args:
        config: Everything; `config.scene` and `config.seed` choose the world.
        out: Run folder; None takes the next free one below runs/.
        record: Keep what the sensors said in recording.mcap.
        say: Progress.
        watch: Follow on a live page.

    Raises:
        InputError: Unknown scene.
        OutputError: The folder cannot be written.
    """
    from sim.robot import SimulatedRobot
    from sim.scenes import catalogue  # the simulation is loaded only by those who simulate
    from sim.world import World

    from ..results.ground_truth_log import TruthLog

    scene = catalogue.load(config.scene, config.seed, config.difficulty)
    goals = () if config.mission.wander else scene.goals[: config.mission.goals]
    folder = RunFolder.create(out, name=f"{scene.name}-{config.seed}")
    with contextlib.ExitStack() as stack:
        placed = replace(scene, start=put_down(scene, config))
        world = stack.enter_context(World(placed, config.renderer, config.seed))
        begin = stack.enter_context(_recorder(folder, record))
        robot = stack.enter_context(SimulatedRobot(world, config.robot, config.seed))
        info = RecordingInfo(
            name=f"{scene.name}-{config.seed}",
            kind="simulation",
            landmarks=scene.landmarks,
            start=scene.start,
            scene=config.scene,
            start_covariance=start_covariance(config.robot),
            floor_height_world_m=0.0,
            gravity_up_world=robot.up,
        )
        body = LiveBody(robot, begin(info))
        pipeline = Pipeline(config, info)
        planner = make(config, goals)
        truth = TruthLog(robot, scene)
        journal = Journal(folder, config.resolved(renderer=world.renderer), info, goals)
        page = _page(watch, say)
        walk_loop(body, pipeline, planner, journal, say, truth.note, page)
        fell = body.fell_at_s
        if fell is not None:
            truth.note(fell)
        truth.write(folder)
    summary = Summary(
        folder.root,
        journal.frames,
        journal.seconds,
        reached=(planner.reached, len(goals)) if goals else None,
        notes=() if fell is None else (f"the robot fell after {fell:.1f} s",),
        fell_at_s=fell,
        body=config.robot.body,
    )
    _keep_looks(planner, journal)
    journal.finish(pipeline, summary.as_dict())
    return summary


def _keep_looks(planner: Planner, journal: Journal) -> None:
    """What a planner looked about for, as pictures: the four panes of seed 004."""
    if not hasattr(planner, "looks"):
        return
    from ..report.plots import avoidance  # only this planner's pictures need it

    for look in planner.looks:
        journal.keep_picture(look.stamp_s, "look about", avoidance.png_of(look))


@contextlib.contextmanager
def _recorder(
    folder: RunFolder, wanted: bool
) -> Iterator[Callable[[RecordingInfo], RecordingWriter | None]]:
    """A way to start the recording once it is known what it is of; closed in any case."""
    with contextlib.ExitStack() as stack:

        def begin(info: RecordingInfo) -> RecordingWriter | None:
            if not wanted:
                return None
            return stack.enter_context(RecordingWriter(folder.path("recording.mcap"), info))

        yield begin


def _page(
    watch: bool, say: Say
) -> Callable[[Frame, Pipeline, Estimate, Planner | None], None] | None:
    if not watch:
        return None
    from ..report.live_view import LivePage

    page = LivePage()
    say(f"live page: {page.address}")
    return page.show
