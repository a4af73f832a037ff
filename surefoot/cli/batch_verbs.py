"""The verb batch: process, map, panorama or evaluate many; and simulated walks over many seeds."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from perception.primitives.errors import InputError

from ..progress import Say
from .options import (
    PATH,
    Number,
    all_overrides,
    config_option,
    ignore_poses_option,
    json_option,
    reader_option,
    set_option,
)
from .terminal import FAILED, INTERRUPTED, progress

if TYPE_CHECKING:
    from ..batch.job import Executor, Job
    from ..batch.places import Order

MEMORY_GIB = 4.0  # ours: of a worker; a processed walk needs 0.5, its map 0.5, a simulated home 1.5


@dataclass(frozen=True)
class Workers:
    """Where a batch runs: processes of this machine, or the workers of a Dask scheduler."""

    count: int | None
    memory_gib: float
    scheduler: str | None
    again: bool

    def start(self, say: Say) -> Executor:
        """Start the workers; print how many, and the memory that each may take."""
        if self.scheduler is not None:
            from ..batch.dask_cluster import DaskCluster

            say(f"workers of {self.scheduler}, at most {self.memory_gib:g} GiB for a job")
            return DaskCluster(self.scheduler, self.memory_gib, say)
        from ..batch.pool import Pool, how_many

        count = how_many(self.count, self.memory_gib)
        say(f"workers: {count} of at most {self.memory_gib:g} GiB each")
        return Pool(count, self.memory_gib)


def workers_options(verb: Callable[..., None]) -> Callable[..., None]:
    """Add the options of a batch to a verb, which receives them as one argument `workers`."""

    @click.option("--workers", type=click.IntRange(min=1),
                  help="Of a batch: processes on this machine; default one per core, as far as memory allows.")  # fmt: skip
    @click.option("--memory", type=Number(min=0.5), default=MEMORY_GIB, show_default=True,
                  metavar="GIB", help="Of a batch: most memory of a worker.")  # fmt: skip
    @click.option("--scheduler", metavar="ADDRESS",
                  help="Of a batch: Dask scheduler whose workers to use, such as tcp://10.0.0.5:8786.")  # fmt: skip
    @click.option("--again", is_flag=True,
                  help="Of a batch: try again what is in quarantine.")  # fmt: skip
    @wraps(verb)
    def with_workers(
        *args: Any, workers: int | None, memory: float, scheduler: str | None, again: bool, **more: Any
    ) -> None:  # fmt: skip
        if workers is not None and scheduler is not None:
            raise InputError(
                "--workers is for this machine, --scheduler for a cluster; give one of them"
            )
        verb(*args, workers=Workers(workers, memory, scheduler, again), **more)

    return with_workers


def seeds_of(context: click.Context, parameter: click.Parameter, value: str | None) -> range | None:
    """The seeds from A to B - 1 of "A:B"; a usage error if there are none."""
    if value is None:
        return None
    first, _, end = value.partition(":")
    whole = all(one.isascii() and one.isdigit() and len(one) < 10 for one in (first, end))
    if not whole or int(first) >= int(end):
        raise click.BadParameter(
            f"{value} is no range of seeds; expected A:B with A < B, such as 1000:2000"
        )
    return range(int(first), int(end))


@click.command()
@click.argument("verb", type=click.Choice(["process", "map", "panorama", "evaluate"]))
@click.argument("places", nargs=-1, required=True, metavar="PLACE...")
@ignore_poses_option
@reader_option
@click.option("--out", type=PATH, required=True, help="Folder of the batch.")
@config_option
@set_option
@workers_options
@json_option
def batch(
    verb: str,
    places: tuple[str, ...],
    ignore_poses: bool,
    out: Path,
    config_path: Path | None,
    overrides: tuple[str, ...],
    workers: Workers,
    as_json: bool,
) -> None:
    """Do VERB with every recording of every PLACE, side by side; the same command goes on where it was stopped.

    \b
    PLACE is a recording, a folder of them at any depth, a .txt file with one of these in a line, or an address such
    as s3://bucket/walks (extra cloud); of `evaluate` a folder of runs. Writes into --out a run folder for each,
    summary.csv, index.html, and ledger.jsonl: what has happened so far.
    Examples:
      surefoot batch process ~/recordings --out runs/all
      surefoot batch map s3://lab/walks --out runs/maps --workers 4
      surefoot batch process ~/recordings --out runs/all --scheduler tcp://10.0.0.5:8786
      surefoot batch evaluate runs/all --out runs/judged
    """
    from ..batch.places import Order, jobs_of_places
    from ..config.load import load

    overrides = all_overrides(overrides, ignore_poses)
    load(config_path, overrides)  # what is wrong is said once
    order = Order(verb, "" if config_path is None else str(config_path), overrides)
    _run(order, jobs_of_places(order, places, out), out, workers, as_json)


def simulate_all(
    scene: str | None,
    seeds: range,
    out: Path,
    config_path: Path | None,
    overrides: tuple[str, ...],
    record: bool,
    workers: Workers,
    as_json: bool,
) -> None:
    """Walk through a scene once for every seed."""
    from ..batch.job import SIMULATE
    from ..batch.places import Order, jobs_of_seeds

    config = "" if config_path is None else str(config_path)
    order = Order(SIMULATE, config, overrides, record)
    _run(order, jobs_of_seeds(order, scene or "", seeds, out), out, workers, as_json)


def _run(
    order: Order, jobs: Sequence[Job], out: Path, workers: Workers, as_json: bool
) -> None:  # fmt: skip
    """Run a batch, and tell how it ended."""
    from ..batch import pages
    from ..batch.batch import run_batch
    from ..batch.job import SIMULATE
    from ..report.batch_page import INDEX

    try:
        with progress() as say:
            rows = run_batch(
                order, jobs, out, lambda: workers.start(say.notice), say, workers.again
            )
    except KeyboardInterrupt:
        click.echo("interrupted; the same command goes on", err=True)
        click.get_current_context().exit(INTERRUPTED)
    if as_json:
        click.echo(json.dumps([asdict(row) for row in rows], indent=2))
    else:
        click.echo("\n".join([*pages.lines(rows, order.verb == SIMULATE), f"page: {out / INDEX}"]))
    if any(row.status != "done" for row in rows):
        click.get_current_context().exit(FAILED)
