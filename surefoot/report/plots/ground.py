"""Picture of the surfaces of the ground: outline, height, and what is beyond each side."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mapping.ground.surface import Border
from mapping.io import ground_file
from perception.primitives.pose import Pose2

from ...results.run_folder import RunFolder
from .style import Drawn, sheet

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SIDES = {
    Border.UNSEEN: ("#8A94A0", ":", "not seen beyond"),
    Border.DROP: ("#C8503C", "-", "drop"),
    Border.RISE: ("#20262E", "-", "rise"),
}


def ground(run: RunFolder) -> Drawn | None:
    """The surfaces at the end of the run, body frame; None without the file or without surfaces."""
    if not run.has(ground_file.NAME):
        return None
    surfaces, body = ground_file.load(run.path(ground_file.NAME))
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
    walked = _walked(run, body, axes)
    axes.plot(0.0, 0.0, "k^")
    axes.set(xlabel="x ahead, m", ylabel="y left, m")
    axes.set_aspect("equal", adjustable="datalim")
    figure.colorbar(colours, ax=axes, label="height, m")
    marks = [Line2D([], [], color=c, ls=line, label=name) for c, line, name in SIDES.values()]
    figure.legend(handles=marks, loc="outside upper right", ncols=3)
    return Drawn(
        figure,
        f"The {len(surfaces)} surfaces on which a foot may stand at the end of the run, round the robot (triangle){walked}.",
    )


def _walked(run: RunFolder, body: Pose2, axes: Axes) -> str:
    """Draw route, footsteps and goal of a walk over levels; words about them, empty without footsteps."""
    steps = run.read_csv("footsteps.csv")
    trajectory = run.read_trajectory("trajectory.txt")
    if steps is None or trajectory is None:
        return ""
    to_body = body.inverse()
    route = to_body.apply(trajectory.positions[:, :2])
    feet = to_body.apply(steps.matrix("x_m", "y_m"))
    axes.plot(*route.T, color="#0072B2", lw=1.0)
    axes.plot(*feet.T, "o", color="#20262E", ms=2.5)
    goals = (run.read_json("summary.json") or {}).get("goal_positions") or []
    if goals:
        axes.plot(*to_body.apply(np.array(goals, float)).T, "*", color="#00785A", ms=11)
    return f", its route (blue), {len(feet)} footsteps (dots) and goal (star)"
