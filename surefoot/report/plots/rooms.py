"""Picture of the rooms of a run: each in a colour of its own with its area, and the doorways with their widths."""

from __future__ import annotations

import numpy as np

from mapping.io import geotiff, world_file

from ...results.room_entries import ROOMS
from ...results.run_folder import RunFolder
from .style import FAINT, INK, SERIES, WIDTH_IN, WRONG, Drawn, sheet

MOST_IN, MARGIN_M = 8.0, 0.3


def rooms(run: RunFolder) -> Drawn | None:
    """The rooms of rooms.json on the map; None without the file."""
    found = run.read_json(ROOMS)
    if not found or not found["rooms"] or not run.has(world_file.LAYERS):
        return None
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch, Polygon

    layers, origin, cell_m = geotiff.load(run.path(world_file.LAYERS))
    corners = np.concatenate([np.array(room["outline_m"]) for room in found["rooms"]])
    low, high = corners.min(axis=0) - MARGIN_M, corners.max(axis=0) + MARGIN_M
    shape = (high[1] - low[1]) / (high[0] - low[0])
    figure, axes = sheet(1, 1, min(max(shape * WIDTH_IN * 0.8, 2.6), MOST_IN))
    for room in found["rooms"]:
        colour = SERIES[(room["number"] - 1) % len(SERIES)]
        axes.add_patch(Polygon(np.array(room["outline_m"]), color=colour, alpha=0.35, linewidth=0))
    rows, columns = layers["occupancy"].shape
    (left, bottom), (right, top) = origin, origin + np.array([columns, rows]) * cell_m
    standing = np.where(layers["occupancy"] >= 0.5, 1.0, np.nan)
    axes.imshow(
        standing, origin="lower", extent=(left, right, bottom, top), cmap="Greys", vmin=0.0, vmax=1.3,
        interpolation="nearest",
    )  # fmt: skip
    for door in found["doors"]:
        axes.plot(*np.array(door["jambs_m"]).T, color=WRONG, linewidth=2.5)
    for room in found["rooms"]:
        words = f"{room['number']}\n{room['area_m2']:.1f} m²"
        axes.text(*room["centre_m"], words, ha="center", va="center", fontsize=7.0, color=INK)
    axes.grid(False)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="x, m", ylabel="y, m")
    axes.set_aspect("equal")
    shown = (Patch(color=FAINT, label="room"), Patch(color="#3A3F45", label="obstacle"))
    door_line = Line2D([], [], color=WRONG, linewidth=2.5, label="doorway")
    figure.legend(handles=[*shown, door_line], loc="outside upper right", ncols=3)
    widths = ", ".join(
        f"{door['rooms'][0]} to {door['rooms'][1]}: {door['width_m']:.2f} ± {door['sigma_width_m']:.2f} m"
        for door in found["doors"]
    )
    return Drawn(
        figure,
        f"Rooms: {len(found['rooms'])}, in groups that doorways join: {len(found['floors'])}. Each has a colour, its number and "
        f"the area of free floor that was seen. Doorways and their widths: {widths or 'none'}.",
    )
