"""The failure alarm of our odometry on recordings broken on purpose: recall, and false alarms on unbroken ones.

A pose fails if it is lost, or if the motion since one of the ten images before is wrong by more than 10 cm or 5 deg. A
failure is caught if the alarm rings between the start of the break and the failing image, that one included. An alarm in
an unbroken recording is false unless the pose fails.

Source: ours.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from perception.odometry.odometry import LOST, RESTARTED
from perception.odometry.rgbd_odometry import Odometer, OdometerConfig
from perception.primitives.frame import Frame
from perception.primitives.pose import Pose3

from ...evaluation.metrics.averages import mean
from ..support.experiment import Part, Say
from .broken_recordings import BREAKS

SLIP_M, SLIP_DEG = 0.10, 5.0
WINDOW = 10  # images over which a slip may build up
AFTER = 5  # images after the break that still belong to it
DROPPED_TIMES = 4  # a gap is this much longer than another break


@dataclass(frozen=True)
class Broken:
    """One recording to break.

    Args:
        name: Of the recording.
        frames: With true poses, depth and colour.
        lead: Images before the first break.
        every: Images from one break to the next.
        longest: Images of the longest break; the shortest has half of them.
    """

    name: str
    frames: Sequence[Frame]
    lead: int
    every: int
    longest: int


@dataclass(frozen=True)
class Shot:
    """What the odometry says of an image, and the truth."""

    found: Pose3
    true: Pose3
    state: str
    alarm: bool


@dataclass(frozen=True)
class Event:
    """A break: when the alarm rang and the pose failed, counted from its first image; None: never.

    Args:
        kind: Which break.
        alarm, failure: Numbers of the images.
        silent: Whether the odometry kept a pose when it failed.
    """

    kind: str
    alarm: int | None
    failure: int | None
    silent: bool

    @property
    def caught(self) -> bool:
        """Whether the alarm rang no later than the pose failed."""
        return self.alarm is not None and self.failure is not None and self.alarm <= self.failure


def watch(odometer: Odometer, frames: Sequence[Frame]) -> list[Shot]:
    """Track some frames."""
    shots = []
    for frame in frames:
        assert frame.T_world_camera is not None
        step = odometer.track(replace(frame, T_world_camera=None))
        alarm = odometer.failures[-1] >= odometer.config.alarm.threshold
        shots.append(Shot(step.T_start_camera, frame.T_world_camera, step.state, alarm))
    return shots


def fails(shots: Sequence[Shot], number: int) -> bool:
    """Whether the pose of an image fails."""
    here = shots[number]
    if here.state in (LOST, RESTARTED):
        return True
    for before in shots[max(0, number - WINDOW) : number]:
        true = before.true.inverse() @ here.true
        off = true.inverse() @ before.found.inverse() @ here.found
        turned = float(np.degrees(Rotation.from_matrix(off.rotation).magnitude()))
        if float(np.linalg.norm(off.position)) > SLIP_M or turned > SLIP_DEG:
            return True
    return False


def broken(one: Broken, rng: np.random.Generator) -> tuple[list[Event], list[Shot]]:
    """All breaks at several places of a recording, and the unbroken recording."""
    odometer = Odometer(np.random.default_rng(0), OdometerConfig(loops=False))
    events, clean = [], list[Shot]()
    frames = one.frames
    step_s = (frames[-1].stamp_s - frames[0].stamp_s) / (len(frames) - 1)
    for number, frame in enumerate(frames):
        if number >= one.lead and (number - one.lead) % one.every == 0:
            for kind, spoil in BREAKS.items():
                length = int(rng.integers(one.longest // 2, one.longest + 1))
                length *= DROPPED_TIMES if kind == "dropped" else 1
                if number + length + AFTER > len(frames):
                    continue
                given = spoil(frames[number : number + length], step_s, rng)
                after = list(frames[number + length : number + length + AFTER])
                shots = watch(copy.deepcopy(odometer), given + after)
                events.append(_event(kind, clean[-WINDOW:], shots))
        clean += watch(odometer, [frame])
    return events, clean


def _event(kind: str, before: list[Shot], shots: list[Shot]) -> Event:
    whole, start = before + shots, len(before)
    failing = [n for n in range(len(shots)) if fails(whole, start + n)]
    ringing = [n for n, shot in enumerate(shots) if shot.alarm]
    first = failing[0] if failing else None
    silent = first is not None and shots[first].state not in (LOST, RESTARTED)
    return Event(kind, ringing[0] if ringing else None, first, silent)


def alarms(sequences: Iterable[Broken], rng: np.random.Generator, say: Say) -> Part:
    """Recall and false alarms over all recordings."""
    events: list[Event] = []
    false = frames = 0
    table = []
    for one in sequences:
        say(f"alarm: {one.name} broken on purpose")
        found, clean = broken(one, rng)
        rang = [n for n, shot in enumerate(clean) if shot.alarm]
        wrong = sum(not fails(clean, n) for n in rang)
        events += found
        false, frames = false + wrong, frames + len(clean)
        table.append(
            f"{one.name:<16} {len(clean):5d} unbroken frames: {wrong} false alarms, "
            f"{sum(fails(clean, n) for n in range(len(clean)))} failing poses"
        )
    failed = [event for event in events if event.failure is not None]
    silent = [event for event in failed if event.silent]
    for kind in BREAKS:
        of = [event for event in events if event.kind == kind]
        bad = [event for event in of if event.failure is not None]
        table.append(
            f"{kind:<16} {len(of):3d} breaks, {len(bad):3d} failures, {sum(e.caught for e in bad):3d} caught "
            f"({sum(e.silent for e in bad)} silent, {sum(e.caught for e in bad if e.silent)} of them caught); "
            f"{sum(e.alarm is not None for e in of if e.failure is None)} alarms without failure"
        )
    leads = [event.failure - event.alarm for event in failed if event.caught]  # type: ignore[operator]
    figures = {
        "alarm_events": float(len(failed)),
        "alarm_recall": mean([event.caught for event in failed]),
        "alarm_silent_events": float(len(silent)),
        "alarm_silent_recall": mean([event.caught for event in silent]),
        "alarm_lead_frames_mean": mean(leads),
        "alarm_frames": float(frames),
        "alarm_false_per_1000": 1000.0 * false / frames,
    }
    return figures, table
