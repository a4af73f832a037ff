"""The moments of a run, as estimates.mcap holds them: writer and reader.

The run writes one stream. The replay page, the moving picture, the export to rerun and Foxglove read it; there is no
second format. Foxglove's schemas carry what is drawn, one JSON message a moment carries every number (topics and
schemas: docs/outputs.md).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from mapping.objects.footprints import Footprint
from perception.primitives import safe_input
from perception.primitives.errors import InputError, RecordingError
from perception.primitives.robot_model import RobotModel
from perception.primitives.safe_input import UnreadableError

from ..mcap_file import DAMAGE, MAGIC, WRONG, TopicWriter, messages, nanoseconds
from .moment import Moment as Moment
from .moment_drawings import STATIC, draw_footprints, drawings
from .moment_messages import (
    FOOTPRINTS,
    JSON_TOPICS,
    MOMENT,
    READ,
    footprints_message,
    footprints_of,
    moment_from_messages,
    moment_to_messages,
)
from .run_folder import RunFolder

ESTIMATES = "estimates.mcap"
CHUNK_S = 1.0  # ours: a killed run loses this much at most; smaller chunks compress less
PLAN = ("steps", "route", "goal", "gaze", "gaze_map", "why", "risk")


class MomentWriter:
    """Writes estimates.mcap; it can be kept in a checkpoint, and goes on in the file.

    Args:
        folder: Of the run.
        robot: Sizes of the body that is drawn; None draws only where it is.

    Raises:
        OutputError: The file cannot be written; every method may raise it.
    """

    def __init__(self, folder: RunFolder, robot: RobotModel | None = None) -> None:
        self._folder, self._robot = folder, robot
        self._drawn: set[int] = set()  # tracks that viewers show
        self._topics = TopicWriter(folder.path(ESTIMATES), JSON_TOPICS, "estimates")
        self._group = 0
        self._stamp_s = self._flushed_s = 0.0

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_topics": self._topics.length()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        path = self._folder.path(ESTIMATES)
        if path.stat().st_size < state["_topics"]:
            raise InputError(f"its {ESTIMATES} has lost its last moments")
        self._topics = TopicWriter(path, JSON_TOPICS, "estimates", keep=state["_topics"])

    def write(self, moment: Moment) -> None:
        """Append a moment."""
        self._group += 1
        self._stamp_s = moment.stamp_s
        for topic, drawing in drawings(moment, self._robot, self._drawn):
            self._add(topic, drawing)
        for topic, message in moment_to_messages(moment):
            self._add(topic, message)
        if self._group == 1 or moment.stamp_s - self._flushed_s >= CHUNK_S:
            self._topics.flush()
            self._flushed_s = moment.stamp_s

    def close(self, footprints: tuple[Footprint, ...]) -> None:
        """Append the footprints to the last moment, write the index and close the file."""
        if self._group:
            self._add(STATIC, draw_footprints(footprints, self._stamp_s))
            self._add(FOOTPRINTS, footprints_message(footprints))
        self._topics.close()

    def _add(self, topic: str, message: Any) -> None:
        self._topics.add(topic, message, nanoseconds(self._stamp_s), self._group)


def read_moments(run: RunFolder | str | Path) -> Iterator[Moment]:
    """The moments of a run in their order; those of a killed run as far as they were written.

    Args:
        run: The run, or the path of its folder.

    Raises:
        RecordingError: The run has no estimates.mcap, or the file is damaged.
    """
    folder = run if isinstance(run, RunFolder) else RunFolder(Path(run))
    return moments_of(folder.path(ESTIMATES))


def moments_of(path: Path, grows: Callable[[], bool] | None = None) -> Iterator[Moment]:
    """The moments of an estimates.mcap.

    Args:
        path: The file.
        grows: Asked at the end of what is written; waits, and returns whether more may come. None: nothing may.

    Raises:
        RecordingError: There is no such file, or it is damaged.
    """
    while (head := _head(path)) == b"" and grows is not None and grows():
        pass  # its writer has just begun
    if head != MAGIC:
        raise RecordingError(f"{path}: not an MCAP file; make the run again")
    group: dict[str, bytes] = {}
    number, last = 0, None
    for topic, message in messages(path, grows=grows):
        if topic not in READ:
            continue
        if message.sequence != number:
            group, number = {}, message.sequence
        group[topic] = message.data
        try:
            if topic == FOOTPRINTS and last is not None:
                last = replace(last, footprints=footprints_of(message.data))
            now = moment_from_messages(group) if topic == MOMENT else None
        except (*DAMAGE, *WRONG) as error:
            raise RecordingError(
                f"{path}: moment {number} is damaged ({error!r}); make the run again"
            ) from error
        if now is not None:
            if last is not None:
                yield last
            last = now
    if last is not None:
        yield last


def _head(path: Path) -> bytes:
    try:
        return safe_input.head(path, len(MAGIC))
    except UnreadableError as error:
        raise RecordingError(f"{path} {error}; make the run again to have its estimates") from error


def held(moments: Iterable[Moment]) -> Iterator[Moment]:
    """The moments, with the last known value wherever one brings nothing new."""
    last: Moment | None = None
    for moment in moments:
        if last is not None:
            names: tuple[str, ...] = () if moment.why else PLAN
            names += ("grid",) if moment.grid is None else ()
            names += ("surfaces",) if moment.surfaces is None else ()
            names += ("colour", "colour_sensor") if moment.colour is None else ()
            names += ("depth", "depth_step_m", "depth_sensor") if moment.depth is None else ()
            moment = replace(moment, **{name: getattr(last, name) for name in names})
        yield moment
        last = moment
