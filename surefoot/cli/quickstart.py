"""The verb quickstart: a first result from the recording that ships in the package."""

from __future__ import annotations

import math
from collections.abc import Mapping
from importlib import resources
from pathlib import Path

import click

from .options import PATH
from .terminal import open_in_browser, progress

WALK = "quickstart"  # folder in the package: recording.mcap, truth/, and walk.toml, which makes them again


@click.command()
@click.option("--out", type=PATH, default=Path("runs") / "quickstart", show_default=True,
              help="Output folder; an older run there is replaced.")  # fmt: skip
def quickstart(out: Path) -> None:
    """See a first result: process the recording that ships in the package, and open its page.

    A robot in a furnished room looks round and makes its first steps. Its sensors give poses, floor, obstacles and a
    map, each with its uncertainty; the page compares them with the truth of the simulation.

    \b
    Examples:
      surefoot quickstart
      surefoot quickstart --out runs/first
    """
    from ..config.load import load
    from ..results.run_folder import RunFolder
    from ..run.process import process

    with resources.as_file(resources.files("surefoot") / WALK) as walk, progress() as say:
        summary = process(walk, None, load(None, ()), out, say)
    folder = RunFolder(summary.folder)
    page = folder.path("report.html")
    click.echo("\n".join([*summary.lines(), _errors(folder.read_json("metrics.json") or {})]))
    click.echo(f"\nopen {page.resolve()} in a browser")
    click.echo("replay.html beside it shows the run moment by moment")
    click.echo(
        "next: surefoot process YOUR_RECORDING, or surefoot simulate home (surefoot --help lists all)"
    )
    open_in_browser(page)


def _errors(metrics: Mapping[str, float]) -> str:
    """The errors of the run, as one line."""
    shares = [
        metrics.get(name, math.nan)
        for name in ("grid_correct_share", "moving_obstacle_tracked_share")
    ]
    return (
        f"against the truth: position {1e3 * metrics['position_rmse_m']:.0f} mm, heading "
        f"{metrics['heading_rmse_deg']:.1f} deg (RMS); floor {metrics['floor_tof_angle_deg_median']:.2f} deg, "
        f"{metrics['floor_tof_height_mm_median']:.1f} mm (median); {100 * shares[0]:.0f} % of the map right; movers "
        f"followed for {100 * shares[1]:.0f} % of the time, in sight or not"
    )
