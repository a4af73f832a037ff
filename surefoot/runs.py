"""Whole runs: a walk through a simulated scene, a recording processed; both end in a run folder."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from perception.primitives.errors import RecordingError
from perception.primitives.frame import Frame
from perception.primitives.pose import Pose2, wrap_angle

from . import checkpoint
from .bodies import Body, LiveBody, Playback
from .config import Config
from .journal import Journal
from .pipeline import Estimate, Pipeline
from .planners import Planner, make
from .recordings.mcap_format import RecordingWriter
from .recordings.open import open_recording
from .recordings.recording import Recording, RecordingInfo
from .run_folder import RunFolder
from .stopwatch import Stopwatch

if TYPE_CHECKING:
    from sim.robot import RobotConfig
    from sim.scenes import Scene

Say = Callable[[str], None]

DRAWS = 100  # ours: more means that there is no room
START_COVARIANCE = np.diag(np.square([0.01, 0.01, np.radians(1.0)]))  # put down on its mark by hand
SETTLING = np.diag(np.square([0.005, 0.005, np.radians(3.0)]))
"""Ours: a body with dynamics twists on its soles until they are at rest, one of four by some degrees."""


@dataclass(frozen=True)
class Summary:
    """How a run ended, for the closing lines.

    Args:
        folder: Where everything is.
        frames: Processed.
        skipped: Frames that could not be used, by reason.
        reached: Goals reached, and of how many; None for a recording.
        seconds: Length in the recording's clock.
        fell_at_s: When the robot fell, which ends a run; None if it stood to the end.
        body: Who walked, "kinematic" or "dynamic", which alone can fall; None for a recording.
        notes: Anything else the user should know.
    """

    folder: Path
    frames: int
    seconds: float
    skipped: dict[str, int] = field(default_factory=dict)
    reached: tuple[int, int] | None = None
    notes: tuple[str, ...] = ()
    fell_at_s: float | None = None
    body: str | None = None

    @property
    def succeeded(self) -> bool:
        """Every goal reached, if there were any, and never fallen."""
        arrived = self.reached is None or self.reached[0] == self.reached[1]
        return arrived and self.fell_at_s is None

    def as_dict(self) -> dict[str, Any]:
        """For machines."""
        return {
            "run": str(self.folder),
            "frames": self.frames,
            "seconds": self.seconds,
            "skipped": self.skipped,
            "goals_reached": None if self.reached is None else self.reached[0],
            "goals": None if self.reached is None else self.reached[1],
            "notes": list(self.notes),
            "fell_at_s": self.fell_at_s,
            "body": self.body,
        }

    def lines(self) -> list[str]:
        """For people."""
        shown = [f"{self.frames} frames, {self.seconds:.1f} s"]
        if self.reached is not None:
            shown.append(f"goals reached: {self.reached[0]} of {self.reached[1]}")
        shown += [f"skipped {count}: {reason}" for reason, count in self.skipped.items()]
        shown += list(self.notes)
        shown.append(f"run folder: {self.folder}   report: {self.folder / 'report.html'}")
        return shown


def start_covariance(robot: RobotConfig) -> Float[np.ndarray, "3 3"]:
    """How far from its mark (x, y, yaw) the robot may stand when time begins, m and rad."""
    return START_COVARIANCE + SETTLING if robot.body == "dynamic" else START_COVARIANCE


def put_down(scene: Scene, config: Config) -> Pose2:
    """Where the robot really stands: drawn about its mark as `START_COVARIANCE` has it, clear of all things.

    A mark that has no such place about it is met exactly.
    """
    from sim.free_space import ROBOT_TOP_M
    from sim.shapes import distance

    rng = np.random.default_rng([config.seed, 34])
    radius = math.hypot(*config.robot.dynamic.body.trunk_m[:2]) / 2
    parts = [part for thing in scene.things for part in thing.parts if part.bottom_m < ROBOT_TOP_M]
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
    from sim import scenes  # the simulation is loaded only by those who simulate
    from sim.robot import SimulatedRobot
    from sim.world import World

    from .truth_log import TruthLog

    scene = scenes.load(config.scene, config.seed, config.difficulty)
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
        _cycle(body, pipeline, planner, journal, say, truth.note, page)
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
    from . import plots_avoidance  # only this planner's pictures need it

    for look in planner.looks:
        journal.keep_picture(look.stamp_s, "look about", plots_avoidance.png_of(look))


def process(
    path: Path,
    description: Path | None,
    config: Config,
    out: Path | None,
    say: Say,
    resume: bool = False,
) -> Summary:
    """Process a recording.

    Args:
        path: Folder or file of the recording.
        description: A recording.toml kept elsewhere; None looks beside the data.
        config: Everything.
        out: Run folder; None takes the next free one below runs/.
        say: Progress.
        resume: Go on where a run into the same folder was killed, if one was.

    Raises:
        InputError, RecordingError: The recording as a whole cannot be read, or its checkpoint cannot.
        OutputError: The folder cannot be written.
    """
    recording = open_recording(path, description)
    kept = checkpoint.load(out, config) if resume and out is not None else None
    if kept is None or out is None:
        folder = RunFolder.create(out, name=recording.info.name, reads=path)
        pipeline = Pipeline(config, recording.info)
        journal = Journal(folder, config, recording.info, (), str(path))
    else:
        folder, pipeline, journal = RunFolder(out), kept.pipeline, kept.journal
        say(f"going on after frame {journal.frames}")
    keeper = checkpoint.Keeper(folder.root, config)
    body = Playback(recording, skip=journal.frames)
    _cycle(body, pipeline, None, journal, say, aside=lambda: keeper(pipeline, journal))
    if journal.frames == 0:
        raise RecordingError(
            f"{path}: none of its frames could be used ({_reasons(recording)}); "
            "check that this is the right folder and that its depth images open"
        )
    folder.adopt_truth(path)
    summary = Summary(
        folder.root,
        journal.frames,
        journal.seconds,
        skipped=_count(recording),
        notes=(*journal.notes(pipeline), *recording.remarks),
    )
    journal.finish(pipeline, summary.as_dict())
    keeper.done()
    return summary


def _cycle(
    body: Body,
    pipeline: Pipeline,
    planner: Planner | None,
    journal: Journal,
    say: Say,
    after: Callable[[float], None] = lambda stamp_s: None,
    page: Callable[[Frame, Pipeline, Estimate, Planner | None], None] | None = None,
    aside: Callable[[], None] = lambda: None,
) -> None:
    """Read, estimate, decide, act, write down; until the goals are reached or the frames end."""
    while (frame := body.read()) is not None:
        after(frame.stamp_s)
        estimate = pipeline.cycle(frame)
        decision, watch = None, Stopwatch()
        if planner is not None:
            with watch.stage("decide"):
                planner.notice(frame, estimate, pipeline)
                estimate = pipeline.told(estimate)
                if frame.footstep_due:
                    decision = planner.decide(frame, estimate, pipeline)
        estimate.timing_ms.update(watch.milliseconds)
        if decision is not None:
            body.walk(decision.walk)
            body.look(decision.gaze)
        journal.note(frame, estimate, decision)
        aside()
        if page is not None:
            page(frame, pipeline, estimate, planner)
        say(journal.progress(estimate, planner))
        if planner is not None and planner.finished(estimate):
            break


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
    from .live_view import LivePage

    page = LivePage()
    say(f"live page: {page.address}")
    return page.show


def _count(recording: Recording) -> dict[str, int]:
    reasons = [reason for _, reason in recording.skipped]
    return {str(reason): reasons.count(reason) for reason in np.unique(reasons)} if reasons else {}


def _reasons(recording: Recording) -> str:
    counted = _count(recording)
    return "; ".join(f"{count}: {reason}" for reason, count in counted.items()) or "it is empty"
