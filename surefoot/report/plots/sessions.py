"""Picture of a merged map: the trajectory of each session over the grid, and what changed between them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ...results.run_folder import RunFolder
from .style import INK, SERIES, TARGET, WRONG, Drawn
from .top_view import grid_sheet

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def sessions(run: RunFolder) -> Drawn | None:
    """Trajectories of the sessions, and changes; None for a map of one recording."""
    content, path = run.read_json("sessions.json"), run.read_trajectory("trajectory.txt")
    if content is None or path is None:
        return None
    figure, axes = grid_sheet(run)
    names = {one["session"]: one["name"] for one in content["sessions"]}
    found = run.sessions(path.stamps)
    for k, mine in found.items():
        x, y = path.positions[mine, 0], path.positions[mine, 1]
        colour = SERIES[(k - 1) % len(SERIES)]
        axes.plot(x, y, color=colour, lw=1.6, zorder=6, label=f"session {k}: {names[k]}")
    changes = (run.read_json("changes.json") or {"changes": []})["changes"]
    for change in changes:
        _draw(axes, change)
    for kind, colour, line in (("before", WRONG, "--"), ("after", TARGET, "-")):
        if any(change[kind] is not None for change in changes):
            axes.plot([], [], color=colour, ls=line, lw=1.6, label=f"changed, {kind}")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.1), ncol=3)
    if len(found) == 1:
        return Drawn(figure, "Trajectory of the only session of this map over its occupancy grid.")
    sentence = "Trajectory of each session of this map over its occupancy grid. "
    sentence += (
        f"{len(changes)} changes between two sessions each: dashed what the one saw and the other did not, solid what "
        "came; an arrow joins the two places of one object, and the number is the probability."
        if changes
        else "Nothing changed between them."
    )
    return Drawn(figure, sentence)


def _draw(axes: Axes, change: dict[str, Any]) -> None:
    """One change."""
    places = []
    for kind, colour, line in (("before", WRONG, "--"), ("after", TARGET, "-")):
        one = change[kind]
        if one is not None:
            ring = np.array([*one["outline_m"], one["outline_m"][0]])
            axes.plot(ring[:, 0], ring[:, 1], color=colour, ls=line, lw=1.6, zorder=7)
            places.append(one["position_m"])
    if len(places) == 2:
        arrow = {"arrowstyle": "->", "color": INK, "lw": 1.0}
        axes.annotate("", xy=places[1], xytext=places[0], arrowprops=arrow, zorder=8)
    axes.annotate(f"{change['probability']:.2f}", places[-1], fontsize=7, zorder=9)
