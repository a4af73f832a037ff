"""Checkpoints: a run that was killed or interrupted resumes at the last one and gives the same bits.

A checkpoint holds the state that each frame hands to the next: pose source, tracks, maps, random generators, and the
length of each table. Before the tables are closed, at the end of a run or after an interrupt, they are copied, so that
a run resumes from there too. A checkpoint holds values only (`results.object_file`); reading one runs no code of it.
"""

from __future__ import annotations

import logging
import os
import shutil
import time
from dataclasses import dataclass
from pathlib import Path

from mapping.io.atomic_write import PART
from perception.obstacles.tracker import ObstacleTracker
from perception.primitives import safe_input
from perception.primitives.errors import InputError
from perception.primitives.safe_input import UnreadableError

from ..config import toml
from ..config.schema import Config
from ..results import object_file
from ..results.camera_trajectory import CameraTrajectory
from ..results.formats import refuse
from ..results.run_folder import RunFolder
from ..results.version import version
from .level_pipeline import LevelPipeline
from .pipeline import Pipeline
from .run_recorder import RunRecorder

_LOG = logging.getLogger(__name__)

NAME = ".checkpoint"
TABLES = ".checkpoint-tables"  # folder with the tables as they were when the run began to close
EVERY_S = 20.0  # ours: writing takes some ten milliseconds
STALE = ("trajectory.txt", "summary.json", "metrics.json", "report.html")
"""Results of an interrupted run that do not hold for the resumed one."""


@dataclass(frozen=True)
class State:
    """What lives from frame to frame.

    Args:
        pipeline: Pose source and maps.
        recorder: Tables of the run.
        camera: Trajectory of a freely moving camera.
    """

    pipeline: Pipeline | LevelPipeline
    recorder: RunRecorder
    camera: CameraTrajectory


class Keeper:
    """Writes checkpoints into a run folder."""

    def __init__(self, folder: RunFolder, config: Config, recording: str) -> None:
        """`recording` is the identity of the recording."""
        self._folder = folder
        self._made_by = _made_by(config, recording)
        self._last_s = time.monotonic()
        self._able = True  # False if a plug-in holds what cannot be saved

    def __call__(self, state: State) -> None:
        """After each frame: write a checkpoint every `EVERY_S` seconds.

        Raises:
            OutputError: The disk is full.
        """
        if time.monotonic() - self._last_s >= EVERY_S:
            self._write(state)
            self._last_s = time.monotonic()

    def before_closing(self, state: State) -> None:
        """Write a checkpoint from which the run can resume although its tables are closed next.

        Raises:
            OutputError: The disk is full.
        """
        self._write(state)
        if not self._able:
            return
        with self._folder.staged() as stage:
            for part in filter(Path.is_file, self._folder.root.glob(f"{PART}*")):
                target = stage / TABLES / part.name
                target.parent.mkdir(exist_ok=True)
                shutil.copyfile(part, target)

    def done(self) -> None:
        """Delete the checkpoint of a complete run."""
        (self._folder.root / NAME).unlink(missing_ok=True)
        shutil.rmtree(self._folder.root / TABLES, ignore_errors=True)
        self._folder.sweep()

    def _write(self, state: State) -> None:
        if not self._able:
            return
        try:
            content = object_file.dumps(state, {"folder": self._folder})
        except InputError as error:  # a plug-in holds something that is not plain data
            _LOG.warning("this run cannot be resumed: %s", error)
            self._able = False
            return
        kept = {"made_by": self._made_by, "state": content}
        self._folder.write_bytes(NAME, object_file.dumps(kept))


def load(folder: RunFolder, config: Config, recording: str) -> State | None:
    """The latest checkpoint of a run folder; None if there is none or the run is complete.

    Args:
        folder: Of the run.
        config: Configuration of the run.
        recording: Identity of its recording.

    Raises:
        InputError: It was made by another version, with another configuration or of another recording, or is damaged.
        OutputError: The tables cannot be written.
    """
    path = folder.root / NAME
    if not path.is_file():
        return None
    try:
        _refuse_links(folder)
        kept = object_file.loads(safe_input.data(path))
        for name, value in _made_by(config, recording).items():
            if kept["made_by"][name] != value:
                raise InputError(f"it was made {_OTHERS[name]}")
        _restore_tables(folder)
        ObstacleTracker(
            config.tracker
        )  # loads the user's motion model, whose tracks the state may hold
        state = object_file.loads(kept["state"], {"folder": folder})
    except (InputError, UnreadableError, KeyError, TypeError) as error:
        raise InputError(f"{path}: cannot resume: {error}; run without --resume") from error
    if not isinstance(state, State):
        raise InputError(f"{path}: cannot resume: it holds no state; run without --resume")
    shutil.rmtree(folder.root / TABLES, ignore_errors=True)
    return state


def _refuse_links(folder: RunFolder) -> None:
    """Raise an InputError if writing into the folder would write elsewhere."""
    links = sorted(one.name for one in folder.root.iterdir() if one.is_symlink())
    if links:
        raise InputError(f"{links[0]} is a link, and a run writes into its own folder only")


_OTHERS = {
    "version": "by another version of surefoot",
    "config": "with another configuration",
    "recording": "of another recording",
}


def _made_by(config: Config, recording: str) -> dict[str, str]:
    """What a checkpoint must agree with."""
    return {"version": version(), "config": toml.dumps(config), "recording": recording}


def _restore_tables(folder: RunFolder) -> None:
    """Put back the tables that were copied before closing, and delete what the resumed run writes anew."""
    for copy in sorted((folder.root / TABLES).glob("*")):
        try:
            part = folder.root / f"{copy.name}-copy"
            shutil.copyfile(copy, part)
            os.replace(part, folder.root / copy.name)
        except OSError as error:
            refuse(error, folder.root)
    for name in STALE:
        (folder.root / name).unlink(missing_ok=True)
