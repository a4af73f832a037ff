"""Process a recording with the pipeline and write a run folder."""

from __future__ import annotations

import shlex
from pathlib import Path

from perception.localisation.camera_pose import CameraPoseSource
from perception.localisation.pose_source import PoseSource
from perception.odometry.odometry_poses import OdometryPoses
from perception.primitives.errors import RecordingError

from ..config.schema import Config
from ..progress import Say
from ..recordings.identity import identity
from ..recordings.robot_log import robot_files
from ..recordings.without_poses import WithoutPoses, open_input
from ..results.camera_trajectory import CameraTrajectory, write_poses
from ..results.run_folder import RunFolder
from ..results.tracking import write_tracking
from . import checkpoint
from .bodies import Playback
from .checkpoint import State
from .interrupt import stop_requested
from .level_pipeline import make_pipeline
from .loop import cycles
from .pipeline import Pipeline
from .process_log import process_log
from .run_recorder import RunRecorder
from .summary import Summary, _count, _reasons


def process(
    path: Path,
    description: Path | None,
    config: Config,
    out: Path | None,
    say: Say,
    resume: bool = False,
) -> Summary:
    """Process a recording.

    The log of a wheeled robot goes to `process_log`.

    After Ctrl-C the run folder holds the results up to the last frame, and `resume` continues from there.

    Args:
        path: Folder or file of the recording.
        description: A recording.toml kept elsewhere; None looks beside the data.
        config: Everything the result depends on.
        out: Run folder; None takes the next free one below runs/.
        say: Progress.
        resume: Continue a run into the same folder that was interrupted or killed.

    Raises:
        InputError, RecordingError: The recording as a whole cannot be read, or its checkpoint cannot.
        OutputError: The folder cannot be written.
    """
    if not config.reader and description is None and robot_files(path):
        return process_log(path, config, out, say)
    recording = open_input(path, description, config.ignore_poses, config.reader)
    recorded = identity(path, description, out)
    found = _resumed(out, config, recorded) if resume and out is not None else None
    if found is None:
        if out is not None and (out / checkpoint.NAME).exists():
            say(f"{out}: the interrupted run is replaced; --resume would have continued it")
        folder = RunFolder.create(out, name=recording.info.name, reads=path)
        recorder = RunRecorder(folder, config, recording.info, (), str(path))
        state = State(make_pipeline(config, recording.info), recorder, CameraTrajectory())
    else:
        folder, state = found
        say(f"resuming after frame {state.recorder.frames}")
    pipeline, recorder, camera = state.pipeline, state.recorder, state.camera
    keeper = checkpoint.Keeper(folder, config, recorded)
    body = Playback(recording, skip=recorder.frames)
    source = pipeline.pose_source
    interrupted = False
    with stop_requested() as stopped:
        for cycle in cycles(body, pipeline, None):
            recorder.note(cycle)
            if isinstance(source, CameraPoseSource) and source.camera is not None:
                camera.append(cycle.world.stamp_s, source.camera)
            keeper(state)
            say(recorder.progress(cycle.world, None))
            if interrupted := stopped():
                break
    if recorder.frames == 0:
        raise RecordingError(
            f"{path}: none of its frames could be used ({_reasons(recording)}); "
            "check that this is the right folder and that its depth images open"
        )
    keeper.before_closing(state)
    if isinstance(recording, WithoutPoses):
        write_poses(folder, "truth/trajectory.txt", recording.poses.items())
    else:
        folder.adopt_truth(path)
    tracked = _write_camera(folder, source, camera)
    reached = pipeline.notes(recorder.frames) if isinstance(pipeline, Pipeline) else ()
    notes = (*recorder.notes(), *reached, *recording.remarks, tracked)
    summary = Summary(
        folder.root,
        recorder.frames,
        recorder.seconds,
        skipped=_count(recording),
        notes=tuple(note for note in notes if note),
        interrupted=interrupted,
    )
    words = ["surefoot", "process", str(path), "--config", str(folder.path("config.toml"))]
    if description is not None:
        words += ["--description", str(description)]
    moves = "camera" if isinstance(source, CameraPoseSource) else "body"
    entries = {"command": shlex.join(words), "trajectory": moves, "recording_identity": recorded}
    recorder.finish(pipeline, summary.as_dict() | entries)
    if not interrupted:
        keeper.done()
    return summary


def _resumed(out: Path, config: Config, recorded: str) -> tuple[RunFolder, State] | None:
    """The folder of a run that was interrupted, and its state; None if there is none to resume."""
    if not out.is_dir():
        return None
    folder = RunFolder.held(out)
    state = checkpoint.load(folder, config, recorded)
    return None if state is None else (folder, state)


def _write_camera(folder: RunFolder, source: PoseSource, camera: CameraTrajectory) -> str:
    """Write the trajectory of a freely moving camera, and how well its odometry held; a note on the latter."""
    if isinstance(source, CameraPoseSource):
        camera.write(folder, source.T_map_origin)
    if not isinstance(source, OdometryPoses):
        return ""
    odometer = source.odometer
    threshold = odometer.config.alarm.threshold
    bend, vergence = odometer.bend.solve(), odometer.vergence.solve()
    return write_tracking(
        folder, source.stamps, odometer.states, odometer.failures, threshold, bend, vergence
    )
