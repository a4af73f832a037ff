"""Verbs that ask many runs at once: query, compare."""

from __future__ import annotations

import json
from pathlib import Path

import click

from ..progress import silent
from .options import PATH, Number, json_option

MOST_ROWS = 100  # ours: of an answer, on the terminal


@click.command()
@click.argument("question", metavar="SELECT|NAME", required=False)
@click.argument("runs", type=PATH, nargs=-1)
@click.option("--examples", is_flag=True, help="List the examples, which have a NAME, and end.")
@click.option("--csv", "csv_file", type=PATH, metavar="FILE", help="Write all rows as CSV.")
@click.option(
    "--plot",
    nargs=3,
    metavar="X Y FILE",
    help="Draw column Y over column X into a .svg or .png file.",
)
@click.option(
    "--timeout",
    type=Number(min=0.0, max=86400.0, min_open=True),
    metavar="SECONDS",
    help="Longest time for the answer; default 60.",
)
@json_option
def query(
    question: str | None,
    runs: tuple[Path, ...],
    examples: bool,
    csv_file: Path | None,
    plot: tuple[str, str, str] | None,
    timeout: float | None,
    as_json: bool,
) -> None:
    """Ask the tables of RUNS in SQL (DuckDB): one run folder, or folders with thousands of runs.

    \b
    Tables: runs, frames, tracks, floors, steps, decisions, metrics, config, each with the column run
    (docs/outputs.md). The first question to a folder copies the tables of its runs into RUNS/.store; later ones
    add new runs only. Nothing can be changed, and no other file be opened.
    Examples:
      surefoot query overview runs/all
      surefoot query "SELECT run, ate_m FROM metrics ORDER BY ate_m DESC LIMIT 5" runs/all
      surefoot query "SELECT stamp_s, error_m FROM frames" runs/home-1 --plot stamp_s error_m error.svg
    """
    from ..store.examples import EXAMPLES

    if examples:
        for name, example in EXAMPLES.items():
            click.echo(f"{name}: {example.words}\n{example.sql.rstrip()}\n")
        return
    if question is None or not runs:
        raise click.UsageError("give a SELECT, or the NAME of an example, and RUNS; or --examples")
    from ..store import answers
    from ..store.query import LONGEST_S, asker

    with asker(runs, _notice) as tables:
        answer = tables.ask(question, longest_s=LONGEST_S if timeout is None else timeout)
    if csv_file is not None:
        answers.write_csv(answer, csv_file)
    if plot is not None:
        answers.draw(answer, plot[0], plot[1], Path(plot[2]))
    if as_json:
        rows = [dict(zip(answer.columns, row, strict=True)) for row in answers.plain(answer)]
        click.echo(json.dumps(rows, indent=1))
    else:
        click.echo("\n".join(answers.lines(answer, MOST_ROWS)))


@click.command()
@click.argument("first", type=PATH)
@click.argument("others", type=PATH, nargs=-1, required=True, metavar="OTHER...")
@click.option("--out", type=PATH, metavar="FILE.html", help="The page; default runs/compare.html.")
@click.option(
    "--alarm",
    type=Number(min=0.0, max=0.5, min_open=True),
    help="Rate of false alarms, over all figures of a comparison; default 0.0025.",
)
@json_option
def compare(
    first: Path, others: tuple[Path, ...], out: Path | None, alarm: float | None, as_json: bool
) -> None:
    """Compare the runs in every OTHER folder with those in FIRST: over the same recordings, or scenes and seeds.

    \b
    Folders of runs, batches, or single runs, made by two versions or with two settings. Figures are compared pair by
    pair, with intervals; the page shows the worst cases side by side.
    Examples:
      surefoot compare runs/before runs/after
      surefoot compare runs/default runs/far runs/near --out reach.html
    """
    from ..results.formats import plain_json
    from ..store import compare_page
    from ..store.comparison import ALARM
    from ..store.comparison import compare as measure

    found = measure((first, *others), _notice, ALARM if alarm is None else alarm)
    path = Path("runs") / "compare.html" if out is None else out
    path.parent.mkdir(parents=True, exist_ok=True)
    compare_page.write_page(found, path, silent)
    if as_json:
        click.echo(json.dumps([plain_json(one.content()) for one in found], indent=1))
        return
    for one in found:
        click.echo("\n".join(compare_page.lines(one)))
    click.echo(f"page: {path}")


def _notice(text: str) -> None:
    click.echo(text, err=True)
