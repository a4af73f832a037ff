"""Common style of all plots: a colour-blind safe palette, few lines, units on every axis.

The palette is that of Okabe and Ito. A colour has the same meaning in every plot: blue is the estimate, dark
grey the truth, vermilion an error or obstacle, green a target.

The global state of Matplotlib stays untouched: settings apply inside `styled` only, and no figure is registered
with pyplot.
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import UInt8

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ESTIMATE, TRUTH, WRONG, TARGET = "#0072B2", "#3A3F45", "#D55E00", "#009E73"
LANDMARK, FAINT, INK = "#AA4499", "#C9CFD6", "#22272D"
SERIES = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#8C6D31", "#7F7F7F")
WIDTH_IN = 8.4
MARGIN_IN = 0.04  # above and below a figure

_SETTINGS: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.edgecolor": "#8A929B",
    "axes.linewidth": 0.7,
    "axes.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.xmargin": 0.012,
    "grid.color": "#E7EAEE",
    "grid.linewidth": 0.7,
    "text.color": INK,
    "xtick.color": "#5B636C",
    "ytick.color": "#5B636C",
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "lines.linewidth": 1.4,
    "lines.solid_capstyle": "round",
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    "svg.fonttype": "path",
    "svg.hashsalt": "surefoot",  # the same run gives the same bytes
    "path.simplify": True,
}


class Drawn(NamedTuple):
    """A figure, and a sentence on what it shows."""

    figure: Figure
    sentence: str


@dataclass(frozen=True)
class Picture:
    """One plot of the report.

    Args:
        identity: Name of the file, and of the element in the page.
        title: Heading.
        sentence: What it shows.
        svg: The plot.
    """

    identity: str
    title: str
    sentence: str
    svg: bytes


@dataclass(frozen=True)
class Drawing:
    """One picture of an experiment; it is drawn when its files are written.

    Args:
        name: Name of its files, without ending.
        sentence: What it shows.
        draw: Makes the figure; called within `styled`.
    """

    name: str
    sentence: str
    draw: Callable[[], Figure]


@contextlib.contextmanager
def styled() -> Iterator[None]:
    """Context in which figures are drawn and saved in this style."""
    import matplotlib as mpl

    with mpl.rc_context(_SETTINGS):
        yield


def sheet(
    rows: int = 1, columns: int = 1, height_in: float = 2.6, **options: Any
) -> tuple[Figure, Any]:
    """A figure of the common width, with its axes."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH_IN, height_in), layout="constrained")
    return figure, figure.subplots(rows, columns, **options)


def svg(figure: Figure) -> bytes:
    """The figure as SVG, with text as outlines and without a date; as high as what is drawn."""
    from matplotlib.transforms import Bbox

    layout = figure.get_layout_engine()
    if layout is not None:
        layout.execute(figure)
        figure.set_layout_engine()  # what was found stays; saving would find it twice more
    drawn = figure.get_tightbbox()
    page = Bbox([[0.0, drawn.y0 - MARGIN_IN], [figure.get_figwidth(), drawn.y1 + MARGIN_IN]])
    data = io.BytesIO()
    figure.savefig(data, format="svg", metadata={"Date": None}, bbox_inches=page)
    return data.getvalue()


def png(figure: Figure) -> bytes:
    """The figure as PNG."""
    data = io.BytesIO()
    figure.savefig(data, format="png", dpi=160)
    return data.getvalue()


def image(pixels: UInt8[np.ndarray, "h w 3"]) -> Figure:
    """An RGB picture as a figure without axes, pixel for pixel at 100 dpi."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(pixels.shape[1] / 100, pixels.shape[0] / 100))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.imshow(pixels, interpolation="none")
    axes.set_axis_off()
    return figure


def legend(axes: Axes, columns: int = 5) -> None:
    """A legend above the axes, where it hides nothing; none without labels."""
    if not axes.get_legend_handles_labels()[0]:
        return
    axes.legend(
        loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=columns, borderaxespad=0.1,
        handlelength=1.7, columnspacing=1.4,
    )  # fmt: skip


def bound(axes: Axes, value: float, words: str) -> None:
    """A horizontal line at the bound that a curve should stay below."""
    axes.axhline(value, color=TARGET, linewidth=1.1, linestyle=(0, (5, 3)), label=words)
