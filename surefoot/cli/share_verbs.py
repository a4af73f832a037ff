"""Verbs that turn the estimates of a run into something to show elsewhere: film, export."""

from __future__ import annotations

from pathlib import Path

import click

from perception.primitives.errors import InputError

from .options import PATH


@click.command()
@click.argument("run", type=PATH)
@click.option("--out", type=PATH, help="File to write; default film.webp in the run folder.")
def film(run: Path, out: Path | None) -> None:
    """Write an animation of RUN: camera, depth and the growing map, as a WebP below 3 MB.

    \b
    Example:
      surefoot film runs/home-1 --out walk.webp
    """
    from ..report.film import FILM
    from ..report.film import film as make
    from ..results.run_folder import RunFolder

    folder = RunFolder.open(run)
    made = make(folder, folder.path(FILM) if out is None else out)
    click.echo(f"film: {made} ({made.stat().st_size / 1e6:.1f} MB)")


@click.command()
@click.argument("runs", type=PATH, nargs=-1, required=True, metavar="RUN...")
@click.option("--rerun", type=PATH, metavar="FILE.rrd", help="For the Rerun viewer (extra rerun).")
@click.option("--layout", type=PATH, metavar="FILE.json", help="Layout of panels for Foxglove.")
@click.option(
    "--lerobot",
    type=PATH,
    metavar="FOLDER",
    help="LeRobotDataset v3.0, one episode per RUN: state, action, pictures, estimates with covariances.",
)
def export(
    runs: tuple[Path, ...], rerun: Path | None, layout: Path | None, lerobot: Path | None
) -> None:
    """Write the estimates of RUN for other viewers, or of many RUNs as a dataset for learning.

    \b
    Foxglove opens estimates.mcap of the run folder itself; the layout arranges its panels.
    Examples:
      surefoot export runs/home-1 --rerun home.rrd
      surefoot export runs/home-1 --layout foxglove.json
      surefoot export runs/home-1 runs/home-2 --lerobot datasets/home
    """
    from ..report import viewers
    from ..results.run_folder import RunFolder

    folder, *others = [RunFolder.open(run) for run in runs]
    if rerun is None and layout is None and lerobot is None:
        raise InputError(
            "nothing to export; give --rerun FILE.rrd, --layout FILE.json or --lerobot FOLDER"
        )
    if others and (rerun is not None or layout is not None):
        raise InputError("--rerun and --layout take one RUN; --lerobot takes many")
    if layout is not None:
        click.echo(f"layout: {viewers.write_layout(layout)}")
    if rerun is not None:
        click.echo(f"rerun: {viewers.write_rerun(folder, rerun)}")
    if lerobot is not None:
        from ..store.lerobot import export as write

        made = write([folder, *others], lerobot, lambda text: click.echo(text, err=True))
        click.echo(f"LeRobotDataset: {made}")
