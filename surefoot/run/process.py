"""A recording processed, ending in a run folder."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from perception.primitives.errors import RecordingError

from ..config.schema import Config
from ..recordings.open import open_recording
from ..results.run_folder import RunFolder
from . import checkpoint
from .bodies import Playback
from .pipeline import Pipeline
from .run_recorder import Journal

if TYPE_CHECKING:
    pass
from .loop import walk_loop
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
        journal = Journal(folder, config, recording.info, (), str(path))
    else:
        folder, pipeline, journal = RunFolder(out), kept.pipeline, kept.journal
        say(f"going on after frame {journal.frames}")
    keeper = checkpoint.Keeper(folder.root, config)
    body = Playback(recording, skip=journal.frames)
    walk_loop(body, pipeline, None, journal, say, aside=lambda: keeper(pipeline, journal))
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
