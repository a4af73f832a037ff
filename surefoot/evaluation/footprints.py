"""Figures of the footprints of a run: over free cells, around the robot's own places, and against the truth."""

from __future__ import annotations

from ..results.run_folder import RunFolder
from ..results.tables import Trajectory
from ..results.trajectory_uncertainty import SPACE
from .metrics.footprints import outline_metrics, over_free_share, poses_inside
from .metrics.maps import read_map


def footprint_figures(run: RunFolder, true: Trajectory | None) -> dict[str, float]:
    """Figures of a run, as far as its files go; none without footprints.

    Args:
        run: The run.
        true: True trajectory in the axes of the run; None if unknown.

    Returns:
        footprints (number), footprints_over_free_share; poses_in_footprints (places of a walking body, estimated and
        true; a camera in the hand may be above an obstacle) and the figures of `outline_metrics`.
    """
    found = (run.read_json("obstacles.json") or {}).get("footprints")
    if not found:
        return {}
    figures = {"footprints": float(len(found))}
    if run.has("map.yaml"):
        figures["footprints_over_free_share"] = over_free_share(
            found, read_map(run.path("map.yaml"))
        )
    estimate = run.read_trajectory("trajectory.txt")
    paths = [path for path in (estimate, true) if path is not None]
    if paths and not run.has(SPACE):
        inside = sum(poses_inside(found, path.positions[:, :2]) for path in paths)
        figures["poses_in_footprints"] = float(inside)
    outlines = run.read_json("truth/outlines.json")
    return figures if outlines is None else figures | outline_metrics(found, outlines)
