"""All figures of an experiment against targets, published numbers and the published method, by unit.

One row per figure, one panel per unit. A panel has a logarithmic axis where its values span more than two decades.

Source: ours.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from . import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

UNITS = {
    "share": "share", "pct": "%", "m": "m", "mm": "mm", "cm": "cm", "deg": "deg", "s": "s", "ms": "ms", "px": "px",
    "mps": "m/s", "mb": "MB", "iou": "share", "recall": "share", "coverage": "share", "contacts": "number",
    "collisions": "number", "falls": "number", "steps": "number", "pixels": "number", "walks": "number",
    "scenes": "number", "runs": "number",
}  # fmt: skip
"""Word in the name of a figure to its unit; a share comes before all others, later words before earlier ones."""
OTHER = "without unit"
DECADES = 2.0
MOST = 60  # rows of an experiment without targets, published numbers and comparison
ROW_IN, PANEL_IN = 0.235, 0.55
MET_ALPHA = 0.16
DODGE = 0.22  # the paper above, its method below: equal values stay apart
ITS = style.SERIES[1]
GREY = style.SERIES[7]


@dataclass(frozen=True)
class _Row:
    """One line of a panel; values are None where there is nothing to draw."""

    words: str
    ours: float | None
    its: float | None
    paper: float | None
    span: tuple[float, float] | None
    target: tuple[str, float] | None
    met: bool

    def values(self) -> list[float]:
        """Everything that the axis must show."""
        bound = None if self.target is None else self.target[1]
        found = (self.ours, self.its, self.paper, bound, *(self.span or ()))
        return [value for value in found if value is not None and math.isfinite(value)]


def unit_of(name: str) -> str:
    """Unit of a figure by the words of its name."""
    words = name.split("_")
    if "share" in words:
        return "share"
    return next((UNITS[word] for word in reversed(words) if word in UNITS), OTHER)


def drawing(result: Mapping[str, Any]) -> style.Drawing:
    """The picture of a result.

    Args:
        result: Content of result.json.
    """
    sentence = (
        "Measured figures by unit. Green: where a target is met. Bars: 95 % intervals, where there are any. "
        "A logarithmic axis where values span more than two decades. Names with underscores are those of result.json."
    )
    return style.Drawing("figures", sentence, lambda: draw(result))


def draw(result: Mapping[str, Any]) -> Figure:
    """The figure of `drawing`."""
    from matplotlib.figure import Figure

    panels: dict[str, list[_Row]] = {}
    for name, row in _rows(result):
        if row.values():
            panels.setdefault(unit_of(name), []).append(row)
    counts = [len(rows) for rows in panels.values()] or [1]
    height = 0.5 + sum(ROW_IN * count + PANEL_IN for count in counts)
    figure = Figure(figsize=(style.WIDTH_IN, height), layout="constrained")
    axes = figure.subplots(
        len(counts), 1, squeeze=False, height_ratios=[ROW_IN * n + PANEL_IN for n in counts]
    )[:, 0]
    for panel, (unit, rows) in zip(axes, panels.items(), strict=False):
        _panel(panel, unit, rows)
    if not panels:
        axes[0].set_axis_off()
        axes[0].text(0.5, 0.5, "no figure was measured", ha="center")
    handles = {
        words: handle
        for panel in axes
        for handle, words in zip(*panel.get_legend_handles_labels(), strict=True)
    }
    if handles:
        figure.legend(handles.values(), handles.keys(), loc="outside upper left", ncols=5)
    return figure


def _rows(result: Mapping[str, Any]) -> list[tuple[str, _Row]]:
    """Rows by the name of a figure: the comparison with the paper, then targets and published numbers, or all."""
    figures, targets = result["figures"], result["targets"]
    published = result["published"]

    def row(words: str, name: str, its: str = "", paper: float | None = None) -> _Row:
        target = tuple(targets[name]) if name in targets else None
        paper = published.get(name) if paper is None else paper
        span = result["intervals"].get(name)
        value = figures.get(name)
        met = target is None or (value is not None and _met(value, *target))
        return _Row(words, value, figures.get(its), paper, span and tuple(span), target, met)

    found, shown = [], set()
    for words, paper, its, ours in result["columns"]:
        found.append((ours or its, row(words.strip(), ours, its, paper)))
        shown |= {ours} | {its}.difference(targets)  # a target of the published method has a row
    rest = [name for name in dict.fromkeys([*targets, *published]) if name not in shown]
    measured = any(figures.get(name) is not None for name in (*shown, *rest))
    rest = rest if measured else [*rest, *(name for name in figures if name not in rest)][:MOST]
    return found + [(name, row(name, name)) for name in rest]


def _met(value: float, relation: str, bound: float) -> bool:
    if relation == "==":
        return value == bound
    over, strict = relation[0] == ">", len(relation) == 1
    return (value > bound if over else value < bound) or (not strict and value == bound)


def _panel(axes: Axes, unit: str, rows: Sequence[_Row]) -> None:
    """Draw the rows of one unit, the first on top."""
    places = np.arange(len(rows))
    _scale(axes, unit, [value for row in rows for value in row.values()])
    low, high = axes.get_xlim()
    for place, row in zip(places, rows, strict=True):
        if row.target is not None:
            relation, bound = row.target
            ends = {"<": (low, bound), ">": (bound, high)}.get(relation[0])
            if ends is not None:
                axes.fill_betweenx(
                    (place - 0.38, place + 0.38), *ends, color=style.TARGET, alpha=MET_ALPHA, linewidth=0
                )  # fmt: skip
            axes.plot([bound] * 2, [place - 0.38, place + 0.38], color=style.TARGET, linewidth=1.8, label="target")  # fmt: skip
        if row.span is not None:
            axes.plot(row.span, [place] * 2, color=_colour(row), linewidth=2.2, alpha=0.55)
        if row.paper is not None:
            axes.plot(
                row.paper, place - DODGE, "D", color=style.TRUTH, markersize=4.5, label="the paper"
            )
        if row.its is not None:
            axes.plot(row.its, place + DODGE, "s", color=ITS, markersize=5, label="its method here")  # fmt: skip
        if row.ours is not None:
            words = "ours" if row.met else "ours, target missed"
            axes.plot(row.ours, place, "o", color=_colour(row), markersize=6.5, label=words)
        shown, colour = (row.ours, _colour(row)) if row.ours is not None else (row.its, ITS)
        colour = colour if shown is not None else GREY
        text = "not measured" if shown is None else f"{shown:.4g}"
        axes.annotate(
            text, (1.0, place), (4, 0), xycoords=("axes fraction", "data"), textcoords="offset points",
            va="center", fontsize=8, color=colour,
        )  # fmt: skip
    axes.set_yticks(places, [row.words for row in rows])
    axes.set_ylim(len(rows) - 0.45, -0.55)
    axes.set_xlim(low, high)
    axes.set_xlabel(unit)
    axes.grid(axis="y", visible=False)


def _colour(row: _Row) -> str:
    return style.ESTIMATE if row.met else style.WRONG


def _scale(axes: Axes, unit: str, values: Sequence[float]) -> None:
    """Limits, and a logarithmic axis (linear about zero) where the values need one."""
    sizes = sorted({abs(value) for value in values if value})
    if sizes and math.log10(sizes[-1] / sizes[0]) > DECADES:
        least = 10.0 ** math.floor(math.log10(sizes[0]))
        if min(values) > 0.0:
            axes.set_xscale("log")
            axes.set_xlim(0.7 * min(values), 1.4 * max(values))
        else:
            axes.set_xscale("symlog", linthresh=max(least, 1e-6 * sizes[-1]))
            low = 1.4 * min(values) if min(values) < 0.0 else -0.3 * least
            axes.set_xlim(low, 1.4 * max(max(values), least))
        return
    low, high = min([0.0, *values]), max([0.0, *values])
    if low == high or (unit == "share" and low >= 0.0 and high <= 1.0):
        high = 1.0
    room = 0.04 * (high - low)
    axes.set_xlim(low - room, high + room)
