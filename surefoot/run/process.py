"""Process a recording with the pipeline and write a run folder."""

from __future__ import annotations

import shlex
from pathlib import Path

from perception.localisation.camera_pose import CameraPoseSource
from perception.primitives.errors import RecordingError

from ..config.schema import Config
from ..recordings.without_poses import WithoutPoses, open_input
from ..results.camera_trajectory import CameraTrajectory, write_poses
from ..results.run_folder import RunFolder
from . import checkpoint
from .bodies import Playback
from .checkpoint import State
from .interrupt import stop_requested
from .pipeline import Pipeline
from .run_recorder import Journal
from .summary import Say, Summary, _count, _reasons


def process(
    path: Path,
    description: Path | None,
    config: Config,
    out: Path | None,
    say: Say,
    resume: bool = False,
) -> Summary:
    """Process a recording.

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
    recording = open_input(path, description, config.ignore_poses)
    state = checkpoint.load(out, config) if resume and out is not None else None
    if state is None or out is None:
        folder = RunFolder.create(out, name=recording.info.name, reads=path)
        journal = Journal(folder, config, recording.info, (), str(path))
        state = State(Pipeline(config, recording.info), journal, CameraTrajectory())
    else:
        folder = RunFolder(out)
        say(f"resuming after frame {state.journal.frames}")
    pipeline, journal, camera = state.pipeline, state.journal, state.camera
    keeper = checkpoint.Keeper(folder.root, config)
    body = Playback(recording, skip=journal.frames)
    source = pipeline.whereabouts
    interrupted = False
    with stop_requested() as stopped:
        while not interrupted and (frame := body.read()) is not None:
            estimate = pipeline.cycle(frame)
            journal.note(frame, estimate, None)
            if isinstance(source, CameraPoseSource) and source.camera is not None:
                camera.append(frame.stamp_s, source.camera)
            keeper(state)
            say(journal.progress(estimate, None))
            interrupted = stopped()
    if journal.frames == 0:
        raise RecordingError(
            f"{path}: none of its frames could be used ({_reasons(recording)}); "
            "check that this is the right folder and that its depth images open"
        )
    if interrupted:
        keeper.interrupt(state)
    if isinstance(recording, WithoutPoses):
        write_poses(folder, "truth/trajectory.txt", recording.poses.items())
    else:
        folder.adopt_truth(path)
    in_space = isinstance(source, CameraPoseSource)
    if isinstance(source, CameraPoseSource):
        camera.write(folder, source.T_map_origin)
    summary = Summary(
        folder.root,
        journal.frames,
        journal.seconds,
        skipped=_count(recording),
        notes=(*journal.notes(pipeline), *recording.remarks),
        interrupted=interrupted,
    )
    words = ["surefoot", "process", str(path), "--config", str(folder.path("config.toml"))]
    if description is not None:
        words += ["--description", str(description)]
    entries = {"command": shlex.join(words), "trajectory": "camera" if in_space else "body"}
    journal.finish(pipeline, summary.as_dict() | entries)
    if not interrupted:
        keeper.done()
    return summary
