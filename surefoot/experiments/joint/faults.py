"""Faults of sensors, clock and feet in the furnished home, on the dynamic body: are they noticed, and is nobody hurt?

Each walk has one fault from 8 to 14 s, and goes on for ten seconds. Noticed is a fault that is named in the status within
2 s of the first frame that it touched. A walk is honest if the mean NEES of its poses from then on lies below the 95 % band
of one walk, or if the robot says within 3 s that it is lost. It has recovered if at its end the status asks for nothing.
Contacts and falls count in the whole walk, in frames that got lost too. A drifting clock cannot be noticed: the stamps
are the only clock there is, and steps and turns of a walk fit any.

Source: ours.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from perception.filtering.consistency import band
from perception.monitoring.status import LOST, NOTE
from sim.faults.injection import KINDS, FaultConfig

from ...config.presets import on_body
from ...config.schema import Config
from ...evaluation.evaluate import pose_errors
from ...evaluation.metrics.consistency import squared
from ...results.run_folder import RunFolder
from ...results.status_log import BEGINS, ENDS, STATUS
from ..support.experiment import Experiment, Outcome, Say, Target
from ..support.walks import column, falls_and_contacts, total_falls, walk_all

NOTICED_S, LOST_S, AFTER_S = 2.0, 3.0, 10.0
NAMED: Mapping[str, tuple[str, ...]] = {
    "frozen": ("frozen",),
    "late": ("landmarks disagree", "camera and joints disagree"),
    "half-blind": ("half blind",),
    "blackout": ("empty",),
    "miscalibrated": ("landmarks disagree", "camera and joints disagree"),
    "encoder-offset": ("landmarks disagree", "camera and joints disagree"),
    "lost-odometry": ("no odometry",),
    "slipping-foot": ("gyro and steps disagree", "landmarks disagree"),
    "gyro-bias": ("gyro and steps disagree",),
    "clock-jump": ("gap in stamps", "clock set back"),
    "dropped": ("gap in stamps",),
}
"""How the status names each fault that can be seen."""


def config_of(fault: str, seed: int, body: str) -> Config:
    """Configuration of the walk with a fault."""
    faults = FaultConfig((fault,))
    config = on_body(Config(scene="home", seed=seed, faults=faults), body)
    limit_s = faults.begin_s + faults.last_s + AFTER_S
    return replace(config, mission=replace(config.mission, time_limit_s=limit_s))


def judged(folder: RunFolder, config: Config) -> dict[str, float]:
    """Falls and contacts, and what the status says of the fault.

    Returns:
        Beside the figures of `falls_and_contacts`: noticed_s (from the first frame with the fault; NaN if it was not
        noticed or cannot be), lost_s (likewise), touched (0 or 1), nees (mean from then on), recovered (0 or 1).
    """
    figures = falls_and_contacts(folder, config)
    touched = folder.read_csv("truth/faults.csv")
    figures["touched"] = float(touched is not None)
    begin_s = np.inf if touched is None else float(touched.numbers("stamp_s").min())
    name = config.faults.inject[0].partition(":")[0]
    rows = _status(folder)
    figures["noticed_s"] = _first(rows, begin_s, NAMED.get(name, ()))
    figures["lost_s"] = _first(rows, begin_s, (LOST,))
    asking = {words for _, words, asks, _ in rows if asks != NOTE}
    last = {words: event for _, words, _, event in rows}
    figures["recovered"] = float(all(last[words] == ENDS for words in asking))
    true = folder.read_trajectory("truth/trajectory.txt")
    errors = None if true is None else pose_errors(folder, true)
    if errors is not None:
        later = errors[0] >= begin_s
        figures["nees"] = float(np.mean(squared(errors[1][later]))) if later.any() else np.nan
    return figures


def _status(folder: RunFolder) -> list[tuple[float, str, str, str]]:
    """The rows of status.csv: stamp, words, what they ask, and whether they begin or end."""
    table = folder.read_csv(STATUS)
    if table is None:
        return []
    stamps = table.numbers("stamp_s").tolist()
    words = [table.words(name) for name in ("status", "asks", "event")]
    return list(zip(stamps, *words, strict=True))


def _first(
    rows: list[tuple[float, str, str, str]], begin_s: float, names: tuple[str, ...]
) -> float:
    """Time from the fault to the first row that names it, s; NaN without one."""
    found = [
        stamp - begin_s
        for stamp, words, _, event in rows
        if event == BEGINS and stamp >= begin_s and any(name in words for name in names)
    ]
    return min(found, default=float("nan"))


def run(seeds: int, say: Say, body: str = "dynamic", faults: int = len(KINDS)) -> Outcome:
    """Seeds 0 to n - 1 of every fault, or of the first few."""
    names = list(KINDS)[:faults]
    todo = [(fault, seed) for fault in names for seed in range(seeds)]
    found = walk_all([config_of(fault, seed, body) for fault, seed in todo], say, judged)
    all_of = partial(column, found)
    happened = all_of("touched") > 0.0
    seen = happened & np.array([fault in NAMED for fault, _ in todo])
    noticed = all_of("noticed_s") <= NOTICED_S
    said = all_of("lost_s") <= LOST_S
    high = band(3)[1]
    honest = (all_of("nees") <= high) | said
    figures = {
        "walks": float(len(todo)),
        "contacts": float(np.sum(all_of("contacts"))),
        "falls": total_falls(found),
        "noticed_share": float(np.mean(noticed[seen])) if seen.any() else np.nan,
        "honest_share": float(np.mean(honest)),
        "recovered_share": float(np.mean(all_of("recovered"))),
        "anees": float(np.mean(all_of("nees")[~said])) if not said.all() else np.nan,
    }
    table = [
        "fault             noticed after s   of walks   lost  NEES   contacts  falls  recovered"
    ]
    for fault in names:
        own = np.array([name == fault for name, _ in todo])
        delays = all_of("noticed_s")[own & noticed]
        delay = f"{delays.mean():15.2f}" if len(delays) else f"{'-':>15}"
        share = f"{np.sum(own & noticed)} of {np.sum(own & happened)}"
        table.append(
            f"{fault:16}  {delay if fault in NAMED else 'cannot be seen':>15}  {share:>9}"
            f"  {np.sum(said[own]):5.0f}  {np.mean(all_of('nees')[own]):4.1f}"
            f"  {np.sum(all_of('contacts')[own]):9.0f}  {np.sum(all_of('falls')[own]):5.0f}"
            f"  {np.mean(all_of('recovered')[own]):9.2f}"
        )
        figures[f"nees_{fault.replace('-', '_')}"] = float(np.mean(all_of("nees")[own]))
    return Outcome(figures, table)


EXPERIMENT = Experiment(
    id="faults",
    title="Faults of sensors, clock and feet: noticed, honest, without contact or fall",
    run=run,
    body="dynamic",
    targets={
        "contacts": Target("==", 0.0),
        "falls": Target("==", 0.0),
        "noticed_share": Target(">=", 0.95),
        "honest_share": Target(">=", 0.95),
        "recovered_share": Target(">=", 0.95),
    },
)
