"""A recording processed, ending in a run folder."""

from __future__ import annotations

from pathlib import Path

from perception.primitives.errors import RecordingError

from ..config.schema import Config
from ..recordings.open import open_recording
from ..results.run_folder import RunFolder
from . import checkpoint
from .bodies import Playback
from .loop import cycles
from .pipeline import Pipeline
from .run_recorder import RunRecorder
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
        recorder = RunRecorder(folder, config, recording.info, (), str(path))
    else:
        folder, pipeline, recorder = RunFolder(out), kept.pipeline, kept.recorder
        say(f"going on after frame {recorder.frames}")
    keeper = checkpoint.Keeper(folder.root, config)
    body = Playback(recording, skip=recorder.frames)
    for cycle in cycles(body, pipeline, None):
        recorder.note(cycle)
        keeper(pipeline, recorder)
        say(recorder.progress(cycle.world, None))
    if recorder.frames == 0:
        raise RecordingError(
            f"{path}: none of its frames could be used ({_reasons(recording)}); "
            "check that this is the right folder and that its depth images open"
        )
    folder.adopt_truth(path)
    summary = Summary(
        folder.root,
        recorder.frames,
        recorder.seconds,
        skipped=_count(recording),
        notes=(*recorder.notes(), *recording.remarks),
    )
    recorder.finish(pipeline, summary.as_dict())
    keeper.done()
    return summary
