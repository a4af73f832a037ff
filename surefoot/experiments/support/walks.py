"""Simulated walks in parallel, with the metrics of each run."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from ...config.schema import Config
from ...evaluation.metrics.averages import rms
from ...evaluation.metrics.contact_classes import class_counts, contacts_of_run
from ...progress import Say, silent
from ...results.run_folder import RunFolder
from .trials import run_all

ExtraFigures = Callable[[RunFolder, Config], dict[str, float]]


def walk(config: Config, extra: ExtraFigures | None = None) -> dict[str, Any]:
    """Simulate one run in a temporary folder.

    Args:
        config: Configuration of the run.
        extra: Computes further figures from the run folder.

    Returns:
        Metrics of the run (see `surefoot.evaluation.metrics`) and the further figures.
    """
    from ...evaluation.evaluate import evaluate
    from ...run import simulate

    with tempfile.TemporaryDirectory() as place:
        out = Path(place) / "live"
        simulate.simulate(config, out, False, silent, report=False)
        folder = RunFolder.open(out)
        metrics = evaluate(folder)
        return metrics if extra is None else metrics | extra(folder, config)


def total_falls(found: Iterable[dict[str, Any]]) -> float:
    """Number of falls over all runs; runs of the kinematic body have no such metric and count as 0."""
    return float(sum(one.get("falls", 0.0) for one in found))


def column(found: Iterable[dict[str, Any]], name: str) -> Float[np.ndarray, "n"]:
    """One metric of every run; NaN where a run does not have it."""
    return np.array([metrics.get(name, np.nan) for metrics in found], dtype=float)


def walk_figures(found: Sequence[dict[str, Any]]) -> dict[str, float]:
    """Figures of walks to goals: contacts, falls, arrivals, pose errors, clearance and time."""
    all_of = partial(column, found)
    return {
        "contact_free_share": float(np.mean(all_of("contacts") == 0)),
        "falls": total_falls(found),
        "arrived_share": float(np.mean(all_of("goals_missed") == 0)),
        "position_rmse_m": rms(all_of("position_rmse_m")),
        "heading_rmse_deg": rms(all_of("heading_rmse_deg")),
        "anees_pose": float(np.mean(all_of("pose_anees"))),
        "min_clearance_mm": 1e3 * float(np.min(all_of("min_clearance_m"))),
        "time_s_mean": float(np.mean(all_of("duration_s"))),
    }


ROW = "contacts  clearance  missed  fell  rmse cm   deg   NEES  time s"


def row(metrics: dict[str, Any]) -> str:
    """The metrics of a walk to goals, in the columns of `ROW`."""
    return (
        f"{metrics.get('contacts', -1):8.0f}  {1e3 * metrics.get('min_clearance_m', np.nan):6.0f} mm"
        f"  {metrics.get('goals_missed', -1):6.0f}  {metrics.get('falls', -1):4.0f}"
        f"  {100 * metrics.get('position_rmse_m', np.nan):7.2f}"
        f"  {metrics.get('heading_rmse_deg', np.nan):4.2f}"
        f"  {metrics.get('pose_anees', np.nan):5.2f}  {metrics.get('duration_s', np.nan):6.1f}"
    )


def falls_and_contacts(folder: RunFolder, config: Config) -> dict[str, float]:
    """falls (0 or 1) and the contacts by class of a run."""
    summary = folder.read_json("summary.json") or {}
    figures = {"falls": float(summary.get("fell_at_s") is not None)}
    clearance = folder.read_csv("truth/clearance.csv")
    obstacles = folder.read_csv("truth/obstacles.csv")
    walked = folder.read_trajectory("truth/trajectory.txt")
    tracks = (folder.read_json("obstacles.json") or {}).get("tracks", [])
    if clearance is not None and obstacles is not None and walked is not None:
        poses = np.column_stack([walked.stamps, walked.positions[:, :2], walked.yaws])
        figures |= class_counts(contacts_of_run(clearance, poses, obstacles, tracks))
    return figures


def walk_all(
    configs: Iterable[Config], say: Say, extra: ExtraFigures | None = None
) -> list[dict[str, Any]]:
    """Metrics of every run, in order; runs are computed in parallel processes."""
    return run_all(walk, [(config, extra) for config in configs], say, "walks")
