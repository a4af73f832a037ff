"""Checkpoints: a run that was killed or interrupted resumes at the last one and gives the same bits.

A checkpoint holds everything that lives from frame to frame: pose source, tracks, maps, random generators, and the
length of each table. After an interrupt, which closes the tables, it holds their rows too.
"""

from __future__ import annotations

import importlib.metadata
import os
import pickle
import time
from dataclasses import dataclass, field
from pathlib import Path

from perception.primitives.errors import InputError, OutputError

from ..config.schema import Config
from ..results.camera_trajectory import CameraTrajectory
from .pipeline import Pipeline
from .run_recorder import RunRecorder

NAME = ".checkpoint.pickle"
EVERY_S = 20.0  # ours: writing takes some ten milliseconds
STALE = ("trajectory.txt", "summary.json", "metrics.json", "report.html")
"""Results of an interrupted run that do not hold for the resumed one."""


@dataclass(frozen=True)
class State:
    """What lives from frame to frame.

    Args:
        pipeline: Pose source, tracks and maps.
        recorder: Tables of the run.
        camera: Trajectory of a freely moving camera.
    """

    pipeline: Pipeline
    recorder: RunRecorder
    camera: CameraTrajectory


@dataclass(frozen=True)
class Checkpoint:
    """A run after some frames.

    Args:
        version: Of the program.
        config: Configuration of the run.
        state: The pickled `State`.
        tables: Content of the unfinished tables by file name, where they were closed afterwards.
    """

    version: str
    config: Config
    state: bytes
    tables: dict[str, bytes] = field(default_factory=dict)


class Keeper:
    """Writes checkpoints into a run folder."""

    def __init__(self, root: Path, config: Config) -> None:
        self._root = root
        self._config = config
        self._last_s = time.monotonic()

    def __call__(self, state: State) -> None:
        """After each frame: write a checkpoint every `EVERY_S` seconds.

        Raises:
            OutputError: The disk is full.
        """
        if time.monotonic() - self._last_s >= EVERY_S:
            self._write(state, {})
            self._last_s = time.monotonic()

    def interrupt(self, state: State) -> None:
        """Write a checkpoint from which the run can resume although its tables are closed next."""
        pickle.dumps(state)  # flushes the tables
        parts = (part for part in self._root.glob(".part-*") if part.is_file())
        self._write(state, {part.name: part.read_bytes() for part in parts})

    def done(self) -> None:
        """Delete the checkpoint of a complete run."""
        (self._root / NAME).unlink(missing_ok=True)

    def _write(self, state: State, tables: dict[str, bytes]) -> None:
        pickled = pickle.dumps(state, protocol=pickle.HIGHEST_PROTOCOL)
        kept = Checkpoint(_version(), self._config, pickled, tables)
        part = self._root / f"{NAME}-{os.getpid()}.pickle"
        try:
            part.write_bytes(pickle.dumps(kept, protocol=pickle.HIGHEST_PROTOCOL))
            os.replace(part, self._root / NAME)
        except OSError as error:
            part.unlink(missing_ok=True)
            raise OutputError(f"{part}: the checkpoint cannot be written: {error}") from error


def load(root: Path, config: Config) -> State | None:
    """The latest checkpoint of a run folder; None if there is none or the run is complete.

    Load only folders that this program wrote: a checkpoint is a pickle, which can execute code.

    Raises:
        InputError: It was made by another version or with another configuration, or is damaged.
    """
    path = root / NAME
    if not path.is_file():
        return None
    try:
        kept = pickle.loads(path.read_bytes())
        if not isinstance(kept, Checkpoint) or kept.version != _version():
            raise InputError(f"{path}: made by another version of surefoot; run without --resume")
        if kept.config != config:
            raise InputError(
                f"{path}: made with another configuration; give the same, or run without --resume"
            )
        for name, content in kept.tables.items():
            (root / name).write_bytes(content)
        for name in STALE:
            (root / name).unlink(missing_ok=True)
        state = pickle.loads(kept.state)
    except InputError:
        raise
    except Exception as error:  # a damaged pickle can raise anything
        raise InputError(
            f"{path}: the checkpoint cannot be read ({type(error).__name__}: {error}); run without --resume"
        ) from error
    assert isinstance(state, State)
    return state


def _version() -> str:
    return importlib.metadata.version("surefoot")
