"""Pictures of a panorama: range with the angles of the head, and with obstacles and gaps.

Source: seed 004, Figs. 2 and 6.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from mapping.panorama.key_angles import laws
from mapping.panorama.obstacles import SEEN_M, Surroundings
from mapping.panorama.rendering import Drawing
from mapping.panorama.views import View

from . import style
from .style import ESTIMATE, INK, WRONG

FARTHEST_M = 4.0
EVERY_DEG = 10
ROWS = 3  # of marks one above the other, so that neighbours stay readable
TICKS_DEG = np.arange(-180, 181, 30)


def _range(axes: Any, drawing: Drawing) -> Any:
    """Draw the range image in pixel coordinates; near is bright."""
    axes.grid(False)
    image = axes.imshow(drawing.range_m, cmap="viridis_r", vmin=0.4, vmax=FARTHEST_M)
    axes.set_xlabel("column, px")
    axes.set_ylabel("row, px")
    return image


def angles(drawing: Drawing, views: Sequence[View]) -> Any:
    """Measured key angles (solid) and the angles interpolated between them (dotted)."""
    across, down = laws(drawing, views)
    figure, axes = style.sheet(height_in=4.0)
    image = _range(axes, drawing)
    sphere = drawing.sphere
    columns, rows = np.arange(sphere.width, dtype=float), np.arange(sphere.height, dtype=float)
    for law, places, along in ((across, columns, "x"), (down, rows, "y")):
        line = axes.axvline if along == "x" else axes.axhline
        degrees_at = np.degrees(law.angle(places))
        low, high = sorted((float(degrees_at[0]), float(degrees_at[-1])))
        for degrees in range(math.ceil(low / EVERY_DEG) * EVERY_DEG, int(high) + 1, EVERY_DEG):
            place = float(np.interp(degrees, *_increasing(degrees_at, places)))
            line(place, color="white", linewidth=0.5, linestyle=":")
            _label(axes, along, place, f"{degrees}", INK, inside=True)
        for key, pixel in zip(np.degrees(law.keys_rad), law.pixels, strict=True):
            line(float(pixel), color=WRONG, linewidth=1.2)
            _label(axes, along, float(pixel), f"{round(key)}", WRONG, inside=False)
    figure.colorbar(image, ax=axes, label="range, m", shrink=0.8)
    axes.set_title("key angles of the head (solid) and interpolated angles (dotted), deg", pad=14.0)
    return figure


def _increasing(angles: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return (angles, places) if angles[0] < angles[-1] else (angles[::-1], places[::-1])


def _label(axes: Any, along: str, place: float, text: str, colour: str, inside: bool) -> None:
    """Write an angle at its line: key angles outside the image, others inside it."""
    settings: dict[str, Any] = {"color": colour, "fontsize": 6.5, "clip_on": False}
    if inside:
        settings["bbox"] = {"facecolor": "white", "alpha": 0.6, "pad": 0.6, "linewidth": 0.0}
    if along == "x":
        at = (place, 0.02 if inside else 1.01)
        axes.text(*at, text, transform=axes.get_xaxis_transform(), ha="center", **settings)
    else:
        at = (0.99 if inside else 1.005, place)
        side = "right" if inside else "left"
        axes.text(*at, text, transform=axes.get_yaxis_transform(), ha=side, va="center", **settings)


def obstacles(drawing: Drawing, found: Surroundings) -> Any:
    """Obstacles between their edges above, gaps below, each with its number in panorama.json, from 1."""
    sphere = drawing.sphere
    figure, axes = style.sheet(height_in=min(1.3 + 7.0 * sphere.height / sphere.width, 6.0))
    image = _range(axes, drawing)

    def column(azimuth_rad: float) -> float:
        return (-azimuth_rad - sphere.left_rad) * sphere.px_per_rad

    def edge(place: tuple[float, float]) -> float:
        return column(math.atan2(place[1] - drawing.centre[1], place[0] - drawing.centre[0]))

    def span(left: float, right: float, height: float, text: str, colour: str) -> None:
        across = axes.get_xaxis_transform()
        axes.plot([left, right], [height, height], color=colour, linewidth=2.0, transform=across, clip_on=False)  # fmt: skip
        axes.text(
            0.5 * (left + right), height, text, transform=across, ha="center", va="center", fontsize=7,
            color=colour, bbox={"facecolor": "white", "edgecolor": colour, "pad": 1.2, "linewidth": 0.5},
        )  # fmt: skip

    for k, one in enumerate(found.obstacles):
        left, right = edge(one.left_edge_m), edge(one.right_edge_m)
        height = 1.06 + 0.09 * (k % ROWS)
        for at, hidden_m in ((left, one.hidden_left_m), (right, one.hidden_right_m)):
            dash = "-" if hidden_m <= SEEN_M else "--"
            axes.plot(
                [at, at], [0.0, height], color=WRONG, linewidth=0.9, linestyle=dash, clip_on=False,
                transform=axes.get_xaxis_transform(),
            )  # fmt: skip
        span(left, right, height, f"{k + 1}", WRONG)
    for k, gap in enumerate(found.gaps):
        left, right = column(gap.left_rad), column(gap.right_rad)
        if gap.left is not None:
            left = edge(found.obstacles[gap.left].right_edge_m)
        if gap.right is not None:
            right = edge(found.obstacles[gap.right].left_edge_m)
        span(left, right, 0.03 + 0.09 * (k % ROWS), f"gap {k + 1}", ESTIMATE)
    ticks_rad = np.radians(TICKS_DEG)
    for axis, turned_rad, size, label in (
        (axes.xaxis, -ticks_rad - sphere.left_rad, sphere.width, "azimuth, deg, positive to the left"),
        (axes.yaxis, sphere.top_rad - ticks_rad, sphere.height, "elevation, deg"),
    ):  # fmt: skip
        places = turned_rad * sphere.px_per_rad
        inside = (places >= 0) & (places < size)
        axis.set_ticks(places[inside], [f"{degrees}" for degrees in TICKS_DEG[inside]])
        axis.set_label_text(label)
    axes.set(xlim=(-0.5, sphere.width - 0.5), ylim=(sphere.height - 0.5, -0.5))
    figure.colorbar(image, ax=axes, label="range, m")
    title = "obstacles and gaps by number; dashed: edge with a hidden corner"
    axes.set_title(title, pad=14.0 + 14.0 * ROWS)
    return figure
