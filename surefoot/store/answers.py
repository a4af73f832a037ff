"""Answers to questions as a table for the terminal, as CSV, JSON and a plot."""

from __future__ import annotations

import csv
import json
from decimal import Decimal
from pathlib import Path
from typing import Any

from mapping.io.atomic_write import atomic_path
from perception.primitives.errors import InputError

from ..report.plots import style
from ..results.formats import cell, plain_json
from .query import Answer

WIDEST = 48  # letters of a cell on the terminal
MOST_BARS = 60
LARGEST = 1e100  # ours: of a drawn number; Matplotlib fails near the end of the floats
ENDINGS = (".svg", ".png")


def lines(answer: Answer, most: int) -> list[str]:
    """The answer as a table for the terminal, its first rows only."""
    shown = [[_shown(value) for value in row] for row in answer.rows[:most]]
    right = [
        all(
            isinstance(row[column], (int, float, Decimal, type(None))) for row in answer.rows[:most]
        )
        for column in range(len(answer.columns))
    ]
    widths = [
        max([len(name), *(len(row[column]) for row in shown)])
        for column, name in enumerate(answer.columns)
    ]
    table = [
        "  ".join(
            text.rjust(width) if numbers else text.ljust(width)
            for text, width, numbers in zip(row, widths, right, strict=True)
        ).rstrip()
        for row in [list(answer.columns), *shown]
    ]
    left = len(answer.rows) - len(shown)
    more = f", {left} more: --csv FILE writes all" if left else ""
    return [*table, f"{len(answer.rows)} row{'' if len(answer.rows) == 1 else 's'}{more}"]


def plain(answer: Answer) -> list[list[Any]]:
    """The rows as values of JSON."""
    return [[plain_json(_plain(value)) for value in row] for row in answer.rows]


def write_csv(answer: Answer, path: Path) -> None:
    """Write all rows; floats without loss, unknown values as empty cells, lists and maps as JSON.

    Raises:
        OutputError: The file cannot be written.
    """
    with (
        atomic_path(path) as part,
        part.open("w", encoding="utf-8", newline="") as file,
    ):
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(answer.columns)
        for row in plain(answer):
            writer.writerow(
                [json.dumps(one) if isinstance(one, (dict, list)) else cell(one) for one in row]
            )


def draw(answer: Answer, x: str, y: str, path: Path) -> None:
    """Draw one column over another: points over numbers, bars over words.

    Args:
        answer: What is drawn; rows without a value in either column are left out.
        x, y: Names of the columns; `y` holds numbers.
        path: The picture, .svg or .png.

    Raises:
        InputError: There is no such column, `y` holds no numbers, or the ending is another.
        OutputError: The file cannot be written.
    """
    if path.suffix not in ENDINGS:
        raise InputError(f"{path} must end in {' or '.join(ENDINGS)}")
    pairs = [
        (_plain(a), _plain(b))
        for a, b in zip(answer.column(x), answer.column(y), strict=True)
        if a is not None and b is not None
    ]
    if not pairs or not all(isinstance(value, (int, float)) for _, value in pairs):
        raise InputError(f"column {y!r} holds no numbers; give --plot X Y FILE")
    numbers = [one for pair in pairs for one in pair if isinstance(one, (int, float))]
    large = [one for one in numbers if abs(one) > LARGEST]
    if large:
        raise InputError(f"{large[0]:g} is too large to be drawn; leave it out with WHERE")
    across, up = [one for one, _ in pairs], [one for _, one in pairs]
    with style.styled():
        figure, axes = style.sheet(height_in=3.4)
        if all(isinstance(value, (int, float)) for value in across):
            axes.plot(across, up, ".", color=style.ESTIMATE, markersize=4.0)
        else:
            names = [str(value) for value in across[:MOST_BARS]]
            axes.bar(range(len(names)), up[:MOST_BARS], color=style.ESTIMATE)
            axes.set_xticks(range(len(names)), names, rotation=60, ha="right")
        axes.set_xlabel(x)
        axes.set_ylabel(y)
        data = style.svg(figure) if path.suffix == ".svg" else style.png(figure)
    with atomic_path(path) as part:
        part.write_bytes(data)


def _plain(value: Any) -> Any:
    """A value of the database as one of JSON; dates, UUIDs and the like as text."""
    if isinstance(value, dict):
        return {str(key): _plain(one) for key, one in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(one) for one in value]
    if isinstance(value, Decimal):
        return float(value)
    return value if value is None or isinstance(value, (bool, int, float, str)) else str(value)


def _shown(value: Any) -> str:
    value = _plain(value)
    if value is None:
        return "-"
    text = f"{value:.6g}" if isinstance(value, float) else str(value)
    text = " ".join(text.split())
    return text if len(text) <= WIDEST else f"{text[: WIDEST - 3]}..."
