"""Picture of the map of the whole run: occupancy probability, height, and the standard deviation of the height."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32

from mapping.io import geotiff, world_file

from ...results.run_folder import RunFolder
from .style import WIDTH_IN, Drawn, sheet

UNSEEN = "#BFD3E6"  # a colour that no layer has
MARGIN_IN, MOST_IN = 1.2, 6.5  # room for titles, scales and legend; largest height of the figure
EDGE_CELLS = 3


def world_map(run: RunFolder) -> Drawn | None:
    """The layers of map_layers.tif; None without the file or if no cell was seen."""
    if not run.has(world_file.LAYERS):
        return None
    layers, origin, cell_m = geotiff.load(run.path(world_file.LAYERS))
    seen = np.isfinite(layers["occupancy"])
    if not seen.any():
        return None
    from matplotlib.patches import Patch

    rows, columns = _span(seen.any(axis=1)), _span(seen.any(axis=0))
    left, right = (origin[0] + cell_m * edge for edge in (columns.start, columns.stop))
    bottom, top = (origin[1] + cell_m * edge for edge in (rows.start, rows.stop))
    shape = (top - bottom) / (right - left)
    figure, axes = sheet(1, 3, min(MARGIN_IN + shape * WIDTH_IN / 3, MOST_IN), sharey=True)
    sigma_mm = 1e3 * np.sqrt(layers["height_variance_m2"])
    for one, layer, title, limits, colours in (
        (axes[0], layers["occupancy"], "occupied, probability", (0.0, 1.0), "Greys"),
        (axes[1], layers["height_m"], "height, m", _limits(layers["height_m"]), "viridis"),
        (axes[2], sigma_mm, "height, std. dev., mm", _limits(sigma_mm), "magma"),
    ):
        one.set_facecolor(UNSEEN)
        image = one.imshow(
            layer[rows, columns], origin="lower", extent=(left, right, bottom, top),
            vmin=limits[0], vmax=limits[1], cmap=colours, interpolation="nearest",
        )  # fmt: skip
        one.grid(False)
        one.set(title=title, xlabel="x, m")
        figure.colorbar(image, ax=one, orientation="horizontal", shrink=0.9)
    axes[0].set_ylabel("y, m")
    figure.legend(handles=[Patch(color=UNSEEN, label="not seen")], loc="outside upper right")
    return Drawn(
        figure,
        "Every cell that the run saw: the probability that an obstacle stands in it, the mean height of its surface "
        "above the floor, and the standard deviation of that height. Blue cells were not seen.",
    )


def _span(used: np.ndarray) -> slice:
    """The used part of an axis, with a few cells around it."""
    places = np.flatnonzero(used)
    return slice(
        max(int(places[0]) - EDGE_CELLS, 0), min(int(places[-1]) + 1 + EDGE_CELLS, len(used))
    )


def _limits(layer: Float32[np.ndarray, "rows columns"]) -> tuple[float, float]:
    """Range of the colours: the middle 98 % of the values."""
    if not np.isfinite(layer).any():
        return 0.0, 1.0
    low, high = np.nanpercentile(layer, (1, 99))
    return float(low), float(max(high, low + 1e-3))
