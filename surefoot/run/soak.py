"""Soak test: walks through random scenes with random faults for hours; memory and latency must not grow.

Every walk has its number as seed, which chooses scene, body and fault; so a soak that was stopped goes on with the next
number. Its figures are appended to soak.csv when it ends. The folder of a walk with a contact or a fall is kept. Source: ours.
"""

from __future__ import annotations

import csv
import shutil
import time
from collections.abc import Iterable
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from perception.monitoring.status import LOST
from perception.primitives.errors import OutputError
from sim.faults.injection import KINDS

from ..config.presets import on_body
from ..config.schema import Config
from ..evaluation.evaluate import evaluate
from ..progress import Say, silent
from ..results.formats import refuse
from ..results.run_folder import RunFolder
from ..results.tables import read_table
from .interrupt import stop_requested
from .memory import give_back, memory_mb
from .simulate import simulate

TABLE = "soak.csv"
SCENES = ("home", "flat", "hall", "office")
BODIES = ("kinematic", "dynamic")
FAULTLESS = 0.2  # ours: share of walks without a fault
WARM_UP = 2  # ours: walks of a process that are left out of the trends: libraries load


@dataclass(frozen=True)
class Walk:
    """One walk of a soak.

    Args:
        number: Number of the walk, which is its seed.
        process: Number of the process that walked it.
        scene, body, fault: Settings of the walk; fault is empty without one.
        walked_s: Length by the clock of the run, s.
        wall_s: Wall time with the evaluation, s.
        rss_mb: Memory of the process after it, MB.
        cycle_p99_ms: 99th percentile of the wall time of a cycle, ms.
        contacts, falls, lost: Contacts; whether it fell; whether it was lost at any time.
        nees: Mean NEES of the pose.
    """

    number: int
    process: int
    scene: str
    body: str
    fault: str
    walked_s: float
    wall_s: float
    rss_mb: float
    cycle_p99_ms: float
    contacts: int
    falls: int
    lost: int
    nees: float


def soak(hours: float, out: Path, config: Config, say: Say) -> list[Walk]:
    """Walk until the hours are over, at least once; a soak in the same folder goes on.

    Args:
        hours: Wall time of all walks together, those of an earlier soak in this folder too.
        out: Folder of soak.csv.
        config: Settings of every walk but scene, seed, body and fault.
        say: Progress.

    Returns:
        All walks in the folder.

    Raises:
        OutputError: The folder cannot be written.
    """
    table = out / TABLE
    walks = read(table)
    process = 1 + max((one.process for one in walks), default=0)
    with stop_requested() as stopped:
        while not stopped():
            walk = _walk(len(walks), process, out, config)
            _append(table, walk)
            walks.append(walk)
            spent_h = sum(one.wall_s for one in walks) / 3600.0
            say(f"walk {walk.number}, {spent_h:.2f} of {hours:g} h, {walk.rss_mb:.0f} MB")
            if spent_h >= hours:
                break
    return walks


def drawn(number: int, config: Config) -> Config:
    """Settings of the walk with a number."""
    rng = np.random.default_rng([number, 77])
    scene, body = str(rng.choice(SCENES)), str(rng.choice(BODIES))
    fault = "" if rng.random() < FAULTLESS else str(rng.choice(list(KINDS)))
    faults = replace(config.faults, inject=(fault,) if fault else ())
    return on_body(replace(config, scene=scene, seed=number, faults=faults), body)


def _walk(number: int, process: int, out: Path, config: Config) -> Walk:
    config = drawn(number, config)
    began_s = time.monotonic()
    place = out / f"walk-{number}"
    summary = simulate(config, place, False, silent, report=False)
    folder = RunFolder.open(place)
    metrics = evaluate(folder)
    timing = folder.read_csv("timing.csv")
    assert timing is not None
    stages = [name for name in timing.columns if name != "stamp_s"]
    cycles = np.nansum(timing.matrix(*stages), axis=1)
    status = (folder.read_json("summary.json") or {}).get("status", [])
    walk = Walk(
        number,
        process,
        config.scene,
        config.robot.body,
        "".join(config.faults.inject),
        summary.seconds,
        0.0,
        0.0,
        float(np.percentile(cycles[1:], 99)) if len(cycles) > 1 else float("nan"),
        int(metrics.get("contacts", 0)),
        int(summary.fell_at_s is not None),
        int(any(one["status"] == LOST for one in status)),
        float(metrics.get("pose_anees", float("nan"))),
    )
    if not (walk.contacts or walk.falls):
        shutil.rmtree(place)
    del folder, metrics, timing, cycles
    give_back()
    return replace(walk, wall_s=time.monotonic() - began_s, rss_mb=memory_mb())


def _append(table: Path, walk: Walk) -> None:
    try:
        table.parent.mkdir(parents=True, exist_ok=True)
        begins = not table.exists()
        with table.open("a", encoding="utf-8", newline="") as file:
            rows = csv.writer(file, lineterminator="\n")
            if begins:
                rows.writerow([item.name for item in fields(Walk)])
            rows.writerow(asdict(walk).values())
    except OSError as error:
        refuse(error, table)


def read(table: Path) -> list[Walk]:
    """The walks of a soak.csv; none if there is no such file.

    Raises:
        OutputError: The file is not one of a soak.
        RecordingError: It is damaged.
    """
    if not table.exists():
        return []
    found = read_table(table, unfinished=True)
    names = [item.name for item in fields(Walk)]
    if list(found.columns) != names:
        raise OutputError(f"{table} is no table of a soak; choose another --out")
    kinds: dict[str, Any] = {"int": int, "float": float, "str": str}
    return [
        Walk(*(kinds[str(item.type)](found.words(item.name)[row]) for item in fields(Walk)))
        for row in range(len(found))
    ]


def figures(walks: list[Walk]) -> dict[str, float]:
    """Figures of a soak: growth of memory and latency, and counts of contacts and falls.

    Returns:
        walks, hours, contacts, falls, anees; rss_mb_per_h (growth of memory, mean over processes, NaN with fewer than
        two walks after the warm-up) and cycle_p99_drift (median of the second half of the walks by that of the first, less 1).
    """
    growth = [_growth(own) for own in _by_process(walks)]
    known = [one for one in growth if np.isfinite(one)]
    times = np.array([one.cycle_p99_ms for one in walks])
    half = len(times) // 2
    drift = float(np.median(times[half:]) / np.median(times[:half]) - 1.0) if half else np.nan
    return {
        "walks": float(len(walks)),
        "hours": sum(one.wall_s for one in walks) / 3600.0,
        "contacts": float(sum(one.contacts for one in walks)),
        "falls": float(sum(one.falls for one in walks)),
        "anees": float(np.nanmean([one.nees for one in walks])) if walks else np.nan,
        "rss_mb_per_h": float(np.mean(known)) if known else np.nan,
        "cycle_p99_drift": drift,
    }


def _by_process(walks: list[Walk]) -> Iterable[list[Walk]]:
    for process in dict.fromkeys(one.process for one in walks):
        yield [one for one in walks if one.process == process]


def _growth(walks: list[Walk]) -> float:
    """Slope of the memory of one process over its time, MB/h."""
    hours = np.cumsum([one.wall_s for one in walks])[WARM_UP:] / 3600.0
    memory = np.array([one.rss_mb for one in walks])[WARM_UP:]
    return float(np.polyfit(hours, memory, 1)[0]) if len(hours) > 1 else np.nan


def lines(walks: list[Walk]) -> list[str]:
    """The table: a line for each fault, then the figures."""
    shown = [f"{'fault':16}  walks  contacts  falls  lost  NEES"]
    for fault in sorted({one.fault for one in walks}):
        own = [one for one in walks if one.fault == fault]
        sums = [sum(getattr(one, name) for one in own) for name in ("contacts", "falls", "lost")]
        mean = float(np.nanmean([one.nees for one in own]))
        shown.append(
            f"{fault or 'none':16}  {len(own):5d}  {sums[0]:8d}  {sums[1]:5d}  {sums[2]:4d}  {mean:4.1f}"
        )
    return [*shown, *(f"{name:16}  {value:10.4g}" for name, value in figures(walks).items())]
