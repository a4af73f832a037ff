"""A long run put aside now and then, so that one that was killed goes on where it was.

Everything that lives from frame to frame is kept: whereabouts, tracks, maps, the state of the random numbers, and how far
each table had come. What comes after is the same to the bit as if nothing had happened.
"""

from __future__ import annotations

import importlib.metadata
import pickle
import time
from dataclasses import dataclass
from pathlib import Path

from mapping.io.atomic_write import atomic_path
from perception.primitives.errors import InputError

from ..config.schema import Config
from .pipeline import Pipeline
from .run_recorder import RunRecorder

NAME = ".checkpoint.pickle"
EVERY_S = 20.0  # ours: writing takes some ten milliseconds


@dataclass(frozen=True)
class Checkpoint:
    """A run as it was after some frames.

    Args:
        frames: Read from the recording so far, those that were skipped not counted.
        pipeline, recorder: As they were.
        config: Of the run.
        version: Of the program.
    """

    frames: int
    pipeline: Pipeline
    recorder: RunRecorder
    config: Config
    version: str


class Keeper:
    """Writes a checkpoint every so often."""

    def __init__(self, root: Path, config: Config) -> None:
        """Begin.

        Args:
            root: Run folder.
            config: Of the run.
        """
        self._path = root / NAME
        self._config = config
        self._last_s = time.monotonic()

    def __call__(self, pipeline: Pipeline, recorder: RunRecorder) -> None:
        """After every frame; writes when it is time.

        Raises:
            OutputError: The disk is full.
        """
        if time.monotonic() - self._last_s < EVERY_S:
            return
        version = importlib.metadata.version("surefoot")
        kept = Checkpoint(recorder.frames, pipeline, recorder, self._config, version)
        with atomic_path(self._path) as part:
            part.write_bytes(pickle.dumps(kept, protocol=pickle.HIGHEST_PROTOCOL))
        self._last_s = time.monotonic()

    def done(self) -> None:
        """The run came to its end."""
        self._path.unlink(missing_ok=True)


def load(root: Path, config: Config) -> Checkpoint | None:
    """The latest checkpoint of a run folder; None if there is none, or the run came to its end.

    Only a folder that one's own program wrote should be taken up: a checkpoint is a pickle.

    Raises:
        InputError: It was made by another version or with another configuration, or is damaged.
    """
    path = root / NAME
    if not path.is_file():
        return None
    try:
        kept = pickle.loads(path.read_bytes())
    except Exception as error:  # a pickle of another program can raise anything
        raise InputError(
            f"{path}: the checkpoint cannot be read ({type(error).__name__}: {error}); run without --resume"
        ) from error
    if not isinstance(kept, Checkpoint) or kept.version != importlib.metadata.version("surefoot"):
        raise InputError(f"{path}: made by another version of surefoot; run without --resume")
    if kept.config != config:
        raise InputError(
            f"{path}: made with another configuration; give the same, or run without --resume"
        )
    return kept
