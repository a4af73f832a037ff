"""A long walk with its time and memory: one row a cycle, in a table beside the files of the run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ...config.schema import Config
from ...progress import Say, silent
from ...results.row_stream import RowStream
from ...results.run_folder import RunFolder
from ...run.loop import Cycle
from ...run.memory import memory_mb
from ...run.simulate import simulate

LOG = "cycles.csv"
HEADER = ("stamp_s", "cycle_ms", "busy_ms", "rss_mb")
PARTS = 6  # ours: ten minutes of an hour
WARM_UP_S = 60.0  # ours; half a part of a walk shorter than twelve minutes


@dataclass(frozen=True)
class WalkLog:
    """What was measured in every cycle.

    Args:
        stamp_s: Time in the walk, s.
        cycle_ms: Wall time of perception and decision, ms.
        busy_ms: Their processor time, ms.
        rss_mb: Resident memory of the process after the cycle, MB.
    """

    stamp_s: Float[np.ndarray, "n"]
    cycle_ms: Float[np.ndarray, "n"]
    busy_ms: Float[np.ndarray, "n"]
    rss_mb: Float[np.ndarray, "n"]

    def part(self, number: int) -> slice:
        """The cycles of one of the `PARTS` of the walk, from 0; negative ones count from the end.

        Those of the warm-up belong to none: they load libraries and compiled code.
        """
        edges = np.linspace(self.stamp_s[0], self.stamp_s[-1], PARTS + 1)
        first = number % PARTS
        begin, end = np.searchsorted(self.stamp_s, edges[first : first + 2])
        warm_s = self.stamp_s[0] + min(WARM_UP_S, (edges[1] - edges[0]) / 2)
        warm = int(np.searchsorted(self.stamp_s, warm_s))
        return slice(max(int(begin), warm), int(end) + (first == PARTS - 1))


def long_walk(config: Config, out: Path, say: Say) -> RunFolder:
    """Walk, and write `LOG` into the run folder.

    Args:
        config: Of the walk; its time limit ends it.
        out: Run folder.
        say: Takes the minutes walked.

    Raises:
        OutputError: The folder cannot be written.
    """
    log: list[RowStream] = []
    last_min = -1

    def watch(cycle: Cycle) -> None:
        nonlocal last_min
        if not log:
            log.append(RowStream(RunFolder(out), LOG, HEADER))
        stamp, spent = cycle.world.stamp_s, cycle.world.estimate.timing_ms
        log[0].append((stamp, sum(spent.values()), cycle.busy_ms, memory_mb()))
        if int(stamp / 60.0) > last_min:
            last_min = int(stamp / 60.0)
            say(f"{last_min} min, {memory_mb():.0f} MB")

    simulate(config, out, False, silent, report=False, watch=watch)
    for table in log:
        table.close()
    return RunFolder.open(out)


def read_log(folder: RunFolder) -> WalkLog:
    """The table of a long walk."""
    table = folder.read_csv(LOG)
    assert table is not None
    return WalkLog(*table.matrix(*HEADER).T)
