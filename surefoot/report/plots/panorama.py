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
    """Each obstacle between its edges, with distance, width and height; gaps with their doubt below."""
    figure, axes = style.sheet(height_in=4.0)
    image = _range(axes, drawing)
    sphere = drawing.sphere

    def column(edge: tuple[float, float]) -> float:
        x, y = edge[0] - drawing.centre[0], edge[1] - drawing.centre[1]
        return (-math.atan2(y, x) - sphere.left_rad) * sphere.px_per_rad

    for k, one in enumerate(found.obstacles):
        left, right = column(one.left_edge_m), column(one.right_edge_m)
        for edge, hidden_m in ((left, one.hidden_left_m), (right, one.hidden_right_m)):
            style_of = "-" if hidden_m <= SEEN_M else "--"
            axes.axvline(edge, color=WRONG, linewidth=0.9, linestyle=style_of)
        text = f"{one.distance_m:.2f} m\n{one.width_m:.2f} x {one.height_m:.2f} m"
        height = 0.90 - 0.10 * (k % 2)
        axes.text(
            0.5 * (left + right), height, text, transform=axes.get_xaxis_transform(), ha="center",
            va="top", fontsize=6.5, color=INK, bbox={"facecolor": "white", "alpha": 0.7, "pad": 1.0},
        )  # fmt: skip
    for gap in found.gaps:
        if gap.left is None or gap.right is None:
            continue
        ends = found.obstacles[gap.left], found.obstacles[gap.right]
        middle = 0.5 * (column(ends[0].right_edge_m) + column(ends[1].left_edge_m))
        axes.text(
            middle, 0.04, f"gap {gap.width_m:.2f} m\n±{gap.sigma_width_m:.2f}", transform=axes.get_xaxis_transform(),
            ha="center", fontsize=6.5, color=ESTIMATE, bbox={"facecolor": "white", "alpha": 0.7, "pad": 1.0},
        )  # fmt: skip
    figure.colorbar(image, ax=axes, label="range, m", shrink=0.8)
    axes.set_title(
        "obstacles: forward distance, width x height; gaps ± sigma; dashed: edge with a hidden corner"
    )
    return figure
