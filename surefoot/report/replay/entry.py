"""One moment as the live page gets it: the same numbers and pictures as the replay page has of it."""

from __future__ import annotations

import base64
from dataclasses import replace
from typing import Any, cast

from ...results.moment import Moment
from ...results.run_folder import RunFolder
from .columns import columns, gaze_maps, grids
from .figures import figures
from .gathering import gather
from .surroundings import body_of

HELD = ("colour", "depth", "grid", "gaze_map")
"""Fields of arrays and pictures, which a page gets once."""


class Entries:
    """Makes the entries of one run, in their order.

    Args:
        run: Its folder, for the sizes of the body.
    """

    def __init__(self, run: RunFolder) -> None:
        self._run = run
        self._before: Moment | None = None
        self._start_s = 0.0
        self._has_body = False

    def of(self, moment: Moment) -> dict[str, Any]:
        """What a page needs to draw the next moment; it has the earlier ones.

        Args:
            moment: With the values that hold (`held`).
        """
        before, self._before = self._before, moment
        if before is None:
            self._start_s = moment.stamp_s
        same = [name for name in HELD if getattr(moment, name) is getattr(before, name, None)]
        fresh = replace(moment, **cast(Any, dict.fromkeys(same)))
        found = gather([fresh])
        gaze, gaze_bytes = gaze_maps([fresh])
        grid, grid_bytes = grids(found.grids)
        values, series = figures([moment], [] if moment.grid is None else [(0, moment.grid)])
        body = None
        if not self._has_body and moment.head is not None:
            body, self._has_body = body_of(self._run, [moment]), True
        known = moment.surfaces is getattr(before, "surfaces", None)
        return {
            **columns([replace(moment, surfaces=None) if known else moment]),
            "t": [round(moment.stamp_s - self._start_s, 3)],
            "values": values,
            "series": series,
            "gaze_map": None if gaze is None else {**gaze, "data": _base64(gaze_bytes)},
            "grid": None if grid is None else {**grid, "data": _base64(grid_bytes)},
            "panes": [
                {**strip.pane(), "picture": _base64(strip.shots[0].data)}
                for strip in found.strips
                if strip.shots
            ],
            "goals": [] if moment.goal is None else [moment.goal.tolist()],
            "body": body,
        }


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode("ascii")
