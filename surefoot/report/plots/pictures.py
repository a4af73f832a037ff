"""All plots of a run, in the order of the report. Every number in them comes from the files of the run."""

from __future__ import annotations

from collections.abc import Callable

from ...results.run_folder import RunFolder
from . import consistency, ground, rooms, sessions, surface, time_series, top_view, world_map
from .style import Drawn, Picture, styled, svg

_PLOTS: tuple[tuple[str, str, Callable[[RunFolder], Drawn | None]], ...] = (
    ("map", "Trajectory", top_view.trajectory),
    ("sessions", "Sessions and changes", sessions.sessions),
    ("surface", "Surface", surface.surface),
    ("layers", "Floor layers", surface.layers),
    ("ground", "Ground of several levels", ground.ground),
    ("world", "Map of the whole run", world_map.world_map),
    ("rooms", "Rooms", rooms.rooms),
    ("aligned", "Pose error after alignment", time_series.aligned_errors),
    ("pose", "Pose error", time_series.pose_errors),
    ("nees", "Consistency of the pose covariance", consistency.nees_over_time),
    ("calibration", "Calibration of all covariances", consistency.calibration),
    ("whiteness", "Whiteness of innovations", consistency.whiteness),
    ("clearance", "Clearance", time_series.clearance),
    ("risk", "Claimed risk of contact", consistency.risk),
    ("floor", "Floor plane", time_series.floor),
    ("grid", "Occupancy grid against the truth", top_view.grid_check),
    ("tracks", "Moving obstacles", time_series.tracks),
    ("commands", "Commands", time_series.commands),
    ("timing", "Computing time", time_series.timing),
)


def pictures(run: RunFolder) -> list[Picture]:
    """Every plot that the run has data for.

    Raises:
        RecordingError: A file of the run cannot be read.
    """
    drawn = []
    with styled():
        for identity, title, draw in _PLOTS:
            result = draw(run)
            if result is not None:
                drawn.append(Picture(identity, title, result.sentence, svg(result.figure)))
    return drawn
