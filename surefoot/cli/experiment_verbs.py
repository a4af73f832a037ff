"""Verbs that measure published tables and figures again: experiment, reproduce."""

from __future__ import annotations

import json
import shlex
import sys
from dataclasses import asdict
from pathlib import Path

import click

from .. import cores
from .options import PATH, json_option
from .terminal import FAILED, progress


@click.command()
@click.argument("identity", metavar="[ID]", required=False)
@click.option("--seeds", type=click.IntRange(min=1), help="Number of random worlds.")
@click.option(
    "--body",
    type=click.Choice(["kinematic", "dynamic", "both"]),
    help="Body that walks, in experiments with walks; both: compare them.",
)
@click.option(
    "--planner", metavar="NAME", help="Your own package.module:Class beside ours (INT-4)."
)
@click.option("--gaze", metavar="NAME", help="Your own gaze policy beside ours (INT-2).")
@click.option(
    "--resume",
    is_flag=True,
    help="Continue the same study after it was killed: trials that are complete are not run again.",
)
@click.option("--out", type=PATH, help="Output folder; default runs/experiments/ID.")
@json_option
def experiment(
    identity: str | None,
    seeds: int | None,
    body: str | None,
    planner: str | None,
    gaze: str | None,
    resume: bool,
    out: Path | None,
    as_json: bool,
) -> None:
    """Reproduce a published table or figure; without ID, list them.

    \b
    Leaves a folder with report page, figures as CSV, pictures (SVG, PNG), LaTeX table and result.json.
    Examples:
      surefoot experiment 003-E2               results, targets and the published numbers
      surefoot experiment 001-E3 --seeds 20    with fewer random worlds
      surefoot experiment INT-4 --resume       walks that are complete are not repeated
    """
    from ..experiments.support import artefacts
    from ..experiments.support import experiment as experiments

    if identity is None:
        for name in experiments.names():
            click.echo(f"{name:<14} {experiments.load(name).title}")
        return
    identity = {name.lower(): name for name in experiments.names()}.get(identity.lower(), identity)
    chosen = experiments.load(identity)
    for kind, own in (("planner", planner), ("gaze", gaze)):
        if own is not None:
            chosen = experiments.with_own(chosen, kind, own)
    command = shlex.join(["surefoot", *sys.argv[1:]])
    order = artefacts.Order(chosen, seeds, body, command, resume)
    folder = artefacts.default_folder(identity) if out is None else out
    with progress() as say:
        result = artefacts.perform(order, out, say)
    shown = [*experiments.lines(result), f"report: {folder / 'report.html'}"]
    click.echo(json.dumps(result, indent=2) if as_json else "\n".join(shown))
    if not result["passed"]:
        click.get_current_context().exit(FAILED)


@click.command()
@click.argument(
    "paper",
    type=click.Choice(["000", "001", "003", "004", "joint", "real"]),
    metavar="[PAPER]",
    required=False,
)
@click.option("--quick", is_flag=True, help="With few seeds: a quarter of an hour for everything.")
@click.option("--out", type=PATH, default=Path("runs") / "experiments", show_default=True,
              help="Folder of the index and of all experiments.")  # fmt: skip
@json_option
def reproduce(paper: str | None, quick: bool, out: Path, as_json: bool) -> None:
    """Run all experiments, or those of PAPER, and build one page that shows them.

    PAPER is 000, 001, 003, 004, joint or real. Finished experiments of the same code and seeds are not run again; an
    interrupted one continues. Fails only if an experiment does; a missed target is shown as missed.

    \b
    Examples:
      surefoot reproduce --quick       every experiment with few seeds
      surefoot reproduce 001           everything of Yoo and Kim 2010, with all seeds
    """
    from ..experiments.support import reproduce as rounds

    with progress() as say:
        told = rounds.reproduce(
            paper, quick, out, say, say.notice, cores.available() if quick else 1
        )
    index = out / rounds.INDEX
    failed = [one.id for one in told if one.state == "failed"]
    absent = [one.id for one in told if one.state == "absent"]
    if as_json:
        click.echo(
            json.dumps(
                {"index": str(index), "experiments": [asdict(one) for one in told]}, indent=2
            )
        )
    else:
        click.echo(f"{len(told) - len(failed) - len(absent)} of {len(told)} experiments")
        if absent:
            click.echo(f"could not run, see the page: {', '.join(absent)}")
        click.echo(f"page: {index}")
    if failed:
        click.echo(f"surefoot: failed: {', '.join(failed)}", err=True)
        click.get_current_context().exit(FAILED)
