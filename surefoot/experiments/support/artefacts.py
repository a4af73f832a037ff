"""The folder that an experiment leaves: result, figures, pictures, LaTeX table, settings and report page.

Everything is written when the experiment has ended, under temporary names, and then moved into place; result.json comes
last. A killed experiment therefore leaves an earlier result as it was, and a folder with a result.json is complete.

Source: ours.
"""

from __future__ import annotations

import contextlib
import csv
import io
import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from perception.primitives import safe_input
from perception.primitives.errors import OutputError
from perception.primitives.safe_input import UnreadableError

from ...config import toml
from ...config.schema import Config
from ...progress import Say, silent
from ...report import experiment_page
from ...report.plots import figures as figure_plot
from ...report.plots import style
from ...results import latex, run_json
from ...results.formats import cell, plain_json, refuse
from ...results.run_folder import RunFolder
from ...results.run_json import Maybe, Some, Values
from ...results.version import commit, version
from . import experiment as experiments
from .experiment import Experiment, Outcome, Target
from .papers import HEADINGS, origin, room_of
from .resampling import Record, intervals
from .trials import ResultCache, cached, code_hash, heard_by

RESULT = "result.json"
MAIN = "figure"
TRIALS = "trials"
CODE_LETTERS = 16  # of the hash of all source files
SHAPE = {
    "title": str, "seeds": int, "figures": Values(Maybe(Some((float, bool)))), "targets": Values([Some((str, float)), 2]),
    "code?": str, "body?": Maybe(str), "smaller?": Values(Some((float, bool))), "files?": [str],
}  # fmt: skip
"""What is read of an earlier result.json."""
HEADER = ("figure", "value", "low", "high", "relation", "bound", "met", "published")


@dataclass(frozen=True)
class Order:
    """How to run an experiment.

    Args:
        experiment: Which.
        seeds: Number of seeds; None: its default.
        body: Body, or "both"; None: its default.
        command: The command that repeats it.
        resume: Whether to use trials that an interrupted study has stored.
        smaller: Arguments of the experiment that make it smaller than it is meant.
    """

    experiment: Experiment
    seeds: int | None
    body: str | None
    command: str
    resume: bool = False
    smaller: Mapping[str, float | int] = field(default_factory=dict)

    def run(self, say: Say) -> tuple[Experiment, Outcome]:
        """The experiment as ordered."""
        one = self.experiment
        if self.smaller:
            one = replace(one, run=partial(one.run, **self.smaller))
        return experiments.measure(one, say, self.seeds, self.body)


def default_folder(identity: str) -> Path:
    """runs/experiments/ID in the working directory."""
    return Path("runs") / "experiments" / identity


def perform(order: Order, out: Path | None, say: Say) -> dict[str, Any]:
    """Run an experiment and write its folder.

    Args:
        order: What to run.
        out: Folder; None: `default_folder`.
        say: Takes lines of progress.

    Returns:
        The content of result.json.

    Raises:
        OutputError: The folder holds other files, another process writes into it, or it cannot be written; told before
            anything runs.
        InputError: Of the experiment, such as recordings that are absent.
    """
    folder = _opened(default_folder(order.experiment.id) if out is None else out, out is not None)
    record, began_s = Record(), time.monotonic()
    try:
        with cached(ResultCache(folder.path(TRIALS), order.resume)), heard_by(record):
            chosen, outcome = order.run(say)
    except BaseException:
        with contextlib.suppress(OSError):
            folder.root.rmdir()  # only if nothing is in it
        raise
    seconds = time.monotonic() - began_s
    say("confidence intervals")
    spans, said = intervals(
        lambda: order.run(silent)[1].figures,
        record,
        outcome.figures,
        seconds,
    )
    result = plain_json(
        {
            **experiments.judge(chosen, outcome),
            "intervals": spans,
            "intervals_said": said,
            "trials": record.trials,
            "seeds": order.seeds or chosen.seeds,
            "body": order.body or chosen.body,
            "smaller": dict(order.smaller),
            "seconds": round(seconds, 1),
            "version": version(),
            "commit": commit(),
            "code": code_hash()[:CODE_LETTERS],
            "command": order.command,
            **_about(chosen),
        }
    )
    say("pictures and report")
    return _write(folder, result, outcome, _config(record))


def verdicts(result: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Every target with its figure, whether it is met, and in words how a miss misses.

    Args:
        result: Content of result.json.
    """
    found = []
    for name, (relation, bound) in result["targets"].items():
        value = result["figures"].get(name)
        met = value is not None and Target(relation, bound).met_by(value)
        words = "met" if met else experiment_page.UNMEASURED
        if not met and value is not None:
            words = f"too {'high' if value > bound else 'low'} by {abs(value - bound):.3g}"
            words = "at the bound" if value == bound else words
        found.append({"name": name, "relation": relation, "bound": bound, "met": met, "words": words})  # fmt: skip
    return found


def read(folder: Path) -> dict[str, Any] | None:
    """The content of result.json; None if there is none or it cannot be read."""
    try:
        found = safe_input.json(safe_input.text(folder / RESULT))
        run_json.check(found, SHAPE)
    except UnreadableError:
        return None
    known = all(relation in experiments.COMPARE for relation, _ in found["targets"].values())
    return dict(found) if known else None


def figures_csv(result: Mapping[str, Any]) -> str:
    """Every figure of a result with its interval, target and published number, as CSV."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(HEADER)
    judged = {one["name"]: one for one in verdicts(result)}
    for name in dict.fromkeys([*result["figures"], *result["targets"]]):
        low, high = result["intervals"].get(name, (None, None))
        one = judged.get(name, {})
        row = (
            name, result["figures"].get(name), low, high, one.get("relation"), one.get("bound"), one.get("met"),
            result["published"].get(name),
        )  # fmt: skip
        writer.writerow([cell(value) for value in row])
    return text.getvalue()


def _about(experiment: Experiment) -> dict[str, Any]:
    """Description, paper and source of an experiment."""
    found = origin(experiment)
    return {
        "heading": HEADINGS[room_of(experiment.id)],
        "about": found.about,
        "source": found.source,
        "papers": [paper.words() for paper in found.papers],
    }


def _config(record: Record) -> Config | None:
    """The settings of the first walk; None if no trial has any."""
    found = (v for todo, _ in record.studies for task in todo for v in task if type(v) is Config)
    return next(found, None)


def _opened(place: Path, asked_for: bool) -> RunFolder:
    """The folder, created if absent and proven to be writable.

    A folder that was asked for must be empty or hold an experiment; the default one belongs to it.
    """
    if place.exists() and not place.is_dir():
        raise OutputError(f"output folder {place} is a file; choose another --out")
    folder = RunFolder(place)
    try:
        mine = not place.is_dir() or folder.has(RESULT) or folder.path(TRIALS).is_dir()
        if asked_for and not mine and any(place.iterdir()):
            raise OutputError(
                f"output folder {place} is not empty and not that of an experiment; choose another --out"
            )
        place.mkdir(parents=True, exist_ok=True)
        folder.hold()
        folder.sweep()
        folder.sweep(TRIALS)
    except OSError as error:
        refuse(error, place)
    with folder.staged():  # refused now if nothing can be written
        pass
    return folder


def _write(
    folder: RunFolder, result: dict[str, Any], outcome: Outcome, config: Config | None
) -> dict[str, Any]:
    """Write everything, result.json last; delete pictures of the earlier result that the new one does not have."""
    earlier = set((read(folder.root) or {}).get("files", ()))
    drawings = _named([*outcome.drawings, figure_plot.drawing(result)])
    result["pictures"] = [{"name": one.name, "sentence": one.sentence} for one in drawings]
    texts = {
        "figures.csv": figures_csv(result),
        "table.tex": latex.table(result),
        **({} if config is None else {"config.toml": toml.dumps(config)}),
    }
    names = [f"{one.name}.{kind}" for one in drawings for kind in ("svg", "png")]
    result["files"] = ["report.html", *names, *texts, RESULT]
    with folder.staged() as stage:
        for one in drawings:
            with style.styled():
                figure = one.draw()
                (stage / f"{one.name}.svg").write_bytes(style.svg(figure))
                (stage / f"{one.name}.png").write_bytes(style.png(figure))
        for name, text in texts.items():
            (stage / name).write_text(text, encoding="utf-8")
        page = experiment_page.page(result, verdicts(result), stage)
        (stage / "report.html").write_text(page, encoding="utf-8")
        folder.path(RESULT).unlink(missing_ok=True)  # from here on the earlier result is replaced
    for name in earlier.difference(result["files"]):
        if os.path.basename(name) == name:
            folder.path(name).unlink(missing_ok=True)
    folder.write_json(RESULT, result)
    return result


def _named(drawings: Sequence[style.Drawing]) -> list[style.Drawing]:
    """The drawings with the first one named as the main picture."""
    return [replace(one, name=MAIN) if k == 0 else one for k, one in enumerate(drawings)]
