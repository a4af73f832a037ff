"""Picture of the surfaces of the ground: outline, height, and what is beyond each side."""

from __future__ import annotations

import numpy as np

from mapping.ground.surface import Border
from mapping.io import ground_file

from ...results.run_folder import RunFolder
from .style import Drawn, sheet

SIDES = {
    Border.UNSEEN: ("#8A94A0", ":", "not seen beyond"),
    Border.DROP: ("#C8503C", "-", "drop"),
    Border.RISE: ("#20262E", "-", "rise"),
}


def ground(run: RunFolder) -> Drawn | None:
    """The surfaces at the end of the run, body frame; None without the file or without surfaces."""
    if not run.has(ground_file.NAME):
        return None
    surfaces, _ = ground_file.load(run.path(ground_file.NAME))
    if not surfaces:
        return None
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.lines import Line2D
    from matplotlib.patches import Polygon

    figure, axes = sheet(1, 1, 4.5)
    heights = [float(one.height_at(one.outline.mean(axis=0))[0]) for one in surfaces]
    colours = ScalarMappable(Normalize(min(heights) - 0.05, max(heights) + 0.05), "viridis")
    for one, height in zip(surfaces, heights, strict=True):
        axes.add_patch(Polygon(one.outline, facecolor=colours.to_rgba(np.array(height)), alpha=0.6))
        for k, (x, y) in enumerate(one.outline):
            after = one.outline[(k + 1) % len(one.outline)]
            colour, line, _ = SIDES[Border(int(one.borders[k]))]
            axes.plot((x, after[0]), (y, after[1]), line, color=colour, lw=1.2)
    axes.plot(0.0, 0.0, "k^")
    axes.set(xlabel="x ahead, m", ylabel="y left, m", aspect="equal")
    figure.colorbar(colours, ax=axes, label="height, m")
    marks = [Line2D([], [], color=c, ls=line, label=name) for c, line, name in SIDES.values()]
    figure.legend(handles=marks, loc="outside upper right", ncols=3)
    return Drawn(
        figure,
        f"The {len(surfaces)} surfaces on which a foot may stand at the end of the run, round the robot (triangle).",
    )
