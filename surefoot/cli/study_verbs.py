"""Verbs that look at results or at the machine: evaluate, view, bench, doctor, completion."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path

import click

from perception.primitives.errors import InputError

from .options import PATH, Number, json_option
from .terminal import FAILED, open_in_browser

MOST_SIGMA = 1e3  # of a truth, m or deg; with more it is none


@click.command()
@click.argument("run", type=PATH, required=False)
@click.option(
    "--truth",
    type=PATH,
    help="True trajectory (TUM, KITTI, EuRoC, g2o; with --trajectory also stamp x y z); default the run's truth/.",
)
@click.option(
    "--trajectory",
    type=PATH,
    help="Judge this trajectory (TUM, KITTI, EuRoC, g2o) of any system, not a RUN.",
)
@click.option(
    "--covariance",
    type=PATH,
    help="With --trajectory: its covariances, CSV or g2o (docs/evaluate.md).",
)
@click.option(
    "--same-axes",
    is_flag=True,
    help="With --trajectory: its axes are those of the truth; do not align.",
)
@click.option(
    "--body-axes",
    is_flag=True,
    help="With --covariance: in the axes of each pose (GTSAM), not of the world (ROS).",
)
@click.option(
    "--rotation-first",
    is_flag=True,
    help="With --covariance: 6x6 over rotation, position (GTSAM), not position, rotation (ROS).",
)
@click.option(
    "--surface",
    type=PATH,
    help="Mesh or cloud of the true surface, in the frame of the run; with --truth, in the truth's frame.",
)
@click.option(
    "--truth-sigma",
    nargs=2,
    type=Number(min=0.0, max=MOST_SIGMA),
    default=(0.0, 0.0),
    metavar="M DEG",
    help="Standard deviations of the given truth: position in m, rotation in deg.",
)
@click.option("--out", type=PATH, help="With --trajectory: output folder; default runs/NAME-N.")
@json_option
def evaluate(
    run: Path | None,
    truth: Path | None,
    trajectory: Path | None,
    covariance: Path | None,
    same_axes: bool,
    body_axes: bool,
    rotation_first: bool,
    surface: Path | None,
    truth_sigma: tuple[float, float],
    out: Path | None,
    as_json: bool,
) -> None:
    """Compare RUN, or the trajectory of any system, with its ground truth.

    \b
    A RUN: errors, consistency, map, contacts; writes metrics.json and the report.
      surefoot evaluate runs/home-1
    Anybody's SLAM: ATE and RPE, and whether its covariances hold (docs/evaluate.md).
      surefoot evaluate --trajectory est.txt --covariance cov.csv --truth truth.txt
    """
    metres, degrees = truth_sigma
    sigma = (metres, math.radians(degrees))
    if trajectory is not None:
        if run is not None or surface is not None or truth is None:
            raise click.UsageError(
                "--trajectory needs --truth, and takes neither a RUN nor --surface"
            )
        _judge(
            trajectory, covariance, truth, same_axes, body_axes, rotation_first, sigma, out, as_json
        )
        return
    alone = same_axes or body_axes or rotation_first
    if run is None or covariance is not None or alone or out is not None:
        raise click.UsageError(
            "give the folder of a RUN, or --trajectory FILE --truth FILE; --covariance, --same-axes, --body-axes, "
            "--rotation-first and --out belong to --trajectory"
        )
    from ..evaluation.evaluate import evaluate as measure
    from ..evaluation.targets import closing_table
    from ..report.page import write_report
    from ..results.run_folder import RunFolder
    from ..store.run_tables import write_run_tables

    folder = RunFolder.open(run)
    metrics = measure(folder, truth, surface, sigma)
    report = write_report(folder)
    write_run_tables(folder)
    if as_json:
        click.echo(json.dumps(metrics, indent=2))
    else:
        click.echo(closing_table(metrics))
        click.echo(f"report: {report}")


def _judge(
    trajectory: Path,
    covariance: Path | None,
    truth: Path,
    same_axes: bool,
    body_axes: bool,
    rotation_first: bool,
    truth_sigma: tuple[float, float],
    out: Path | None,
    as_json: bool,
) -> None:
    """Judge a foreign trajectory and write its page."""
    from ..evaluation.referee import judge_files
    from ..report.referee_page import lines, write_page
    from ..results.formats import plain_json
    from ..results.run_folder import RunFolder

    verdict = judge_files(
        trajectory, covariance, truth, same_axes, body_axes, truth_sigma, rotation_first
    )
    folder = RunFolder.create(out, name=f"{trajectory.stem}-evaluate", reads=trajectory)
    page = write_page(folder, verdict, ["surefoot", *sys.argv[1:]])
    if as_json:
        click.echo(json.dumps(plain_json(verdict.metrics), indent=2))
    else:
        click.echo("\n".join([*lines(verdict.metrics), f"report: {page}"]))


@click.command()
@click.argument("run", type=PATH)
@click.option(
    "--live",
    is_flag=True,
    help="Follow RUN while another process writes it, or look through one that is over; until Ctrl-C.",
)
def view(run: Path, live: bool) -> None:
    """Open the report of RUN in the browser, or the page of a batch; with --live, the page of `simulate --view`.

    \b
    Examples:
      surefoot view runs/home
      surefoot view runs/home --live
    """
    from ..report.batch_page import INDEX
    from ..results.run_folder import BATCH, RunFolder

    folder = RunFolder.open(run)
    if live:
        from ..report.live_view import LivePage

        page = LivePage()
        page.follow(folder)
        click.echo(f"{page.address} shows {run} until Ctrl-C", err=True)
        open_in_browser(page.address)
        page.stay()
        return
    report = folder.path(INDEX if folder.kind == BATCH else "report.html")
    if not report.is_file():
        from ..report.page import write_report

        report = write_report(folder)
    click.echo(f"report: {report}")
    open_in_browser(report)


@click.command()
@click.argument("run", type=PATH)
def replay(run: Path) -> None:
    """Write the replay page of RUN again: one file; its slider shows pose, map, tracks and gaze at any time.

    \b
    Every run has one, linked from its report. Example:
      surefoot replay runs/home-1
    """
    from ..report.replay.page import write_replay
    from ..results.run_folder import RunFolder

    folder = RunFolder.open(run)
    page = write_replay(folder)
    if page is None:
        raise InputError(
            f"{run} holds no estimates.mcap: it is the folder of a batch, or of an older version; "
            "make the run again"
        )
    click.echo(f"replay: {page}")


@click.command()
@click.argument("name", required=False)
@json_option
def bench(name: str | None, as_json: bool) -> None:
    """Time our hot paths against those of other libraries; without NAME, all of them.

    \b
    Examples:
      surefoot bench
      surefoot bench ukf --json
    """
    from ..benchmarks import benchmark

    passed, results = True, []
    for one in [name] if name else benchmark.names():
        results.append(benchmark.measured(one))
        passed = passed and results[-1]["passed"]
        if not as_json:
            click.echo("\n".join(benchmark.lines(results[-1])))
    if as_json:
        click.echo(json.dumps(results[0] if name else results, indent=2))
    if not passed:
        click.get_current_context().exit(FAILED)


@click.command()
@json_option
def doctor(as_json: bool) -> None:
    """Check this machine, and say what each missing part is needed for.

    \b
    Examples:
      surefoot doctor
      surefoot doctor --json
    """
    from .doctor import examine, render

    findings = examine()
    if as_json:
        from dataclasses import asdict

        click.echo(json.dumps([asdict(finding) for finding in findings], indent=2))
    else:
        click.echo(render(findings))


@click.command()
@click.option("--markdown", is_flag=True, help="Print the page docs/settings.md.")
def settings(markdown: bool) -> None:
    """List every setting with its default, unit and effect.

    \b
    Examples:
      surefoot settings
      surefoot settings --markdown > settings.md
    """
    from ..config import reference

    if markdown:
        click.echo(reference.markdown(), nl=False)
        return
    for name, default, unit, effect, _ in reference.rows():
        click.echo(f"{name} = {default} {unit}".rstrip() + f"  # {effect}")


@click.command()
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def completion(shell: str) -> None:
    """Print the completion script of SHELL; source it in the shell's start-up file.

    \b
    Examples:
      surefoot completion bash > ~/.surefoot-complete.bash
      echo 'source ~/.surefoot-complete.bash' >> ~/.bashrc
      surefoot completion fish > ~/.config/fish/completions/surefoot.fish
    """
    from click.shell_completion import get_completion_class

    found = get_completion_class(shell)
    assert found is not None
    program = click.get_current_context().find_root().command
    click.echo(found(program, {}, "surefoot", "_SUREFOOT_COMPLETE").source())
