"""Verbs that ask many runs at once: query, compare."""

from __future__ import annotations

import json
from pathlib import Path

import click

from .options import PATH, json_option

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
@json_option
def query(
    question: str | None,
    runs: tuple[Path, ...],
    examples: bool,
    csv_file: Path | None,
    plot: tuple[str, str, str] | None,
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
    from ..store.query import asker

    with asker(runs, _notice) as tables:
        answer = tables.ask(question)
    if csv_file is not None:
        answers.write_csv(answer, csv_file)
    if plot is not None:
        answers.draw(answer, plot[0], plot[1], Path(plot[2]))
    if as_json:
        rows = [dict(zip(answer.columns, row, strict=True)) for row in answers.plain(answer)]
        click.echo(json.dumps(rows, indent=1))
    else:
        click.echo("\n".join(answers.lines(answer, MOST_ROWS)))


def _notice(text: str) -> None:
    click.echo(text, err=True)
