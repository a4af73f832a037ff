"""The row of figures of a run: the most important ones by name, and all of metrics.json."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..evaluation.metrics.obstacles import MOVING, likeliest_moving
from ..results.run_folder import RunFolder
from ..results.tables import Table

CAMERAS = ("tof", "depth", "stereo")
LANDMARK_DOF, TRACK_DOF = 2.0, 2.0  # of their innovations


def metrics_row(run: RunFolder) -> dict[str, Any]:
    """Figures of a run by the columns of the table `metrics`; None where one is not known.

    Args:
        run: A run of any kind but a batch. Figures that need the truth come from metrics.json.

    Returns:
        Values by name; `figures` is JSON, as `parquet.write` takes it.

    Raises:
        RecordingError: A file of the run is damaged.
    """
    summary, metrics = run.read_json("summary.json") or {}, run.read_json("metrics.json") or {}
    skipped = summary.get("skipped") or {}
    timing = (metrics.get("timing_ms") or {}).get("total") or {}
    status = summary.get("status") or []
    return {
        "frames": summary.get("frames"),
        "skipped": sum(skipped.values()) if isinstance(skipped, dict) else skipped,
        "seconds": summary.get("seconds", metrics.get("duration_s")),
        "path_m": metrics.get("path_m"),
        "position_rmse_m": metrics.get("position_rmse_m"),
        "heading_rmse_deg": metrics.get("heading_rmse_deg"),
        "ate_m": metrics.get("ate_m"),
        "rpe_1s_m": metrics.get("rpe_1s_m"),
        "pose_nees": _by_dof(metrics, "pose_anees", float(metrics.get("pose_dof", 3))),
        "landmark_nis": _by_dof(metrics, "landmark_anis", LANDMARK_DOF),
        "track_nis": _by_dof(metrics, "track_anis", TRACK_DOF),
        **_floor(run.read_csv("floor.csv"), run.read_csv("timing.csv"), metrics),
        **_obstacles((run.read_json("obstacles.json") or {}).get("tracks", [])),
        "false_movers": metrics.get("false_movers"),
        "ospa_m": metrics.get("ospa_m"),
        "grid_correct_share": metrics.get("grid_correct_share"),
        "surface_fscore": metrics.get("surface_fscore_2cm"),
        "min_clearance_m": metrics.get("min_clearance_m"),
        "contacts": metrics.get("contacts"),
        "falls": metrics.get("falls"),
        "goals_missed": metrics.get("goals_missed"),
        "doubts": sum(int(one["times"]) for one in status) if "status" in summary else None,
        "frame_ms": timing.get("p50"),
        "frame_p95_ms": timing.get("p95"),
        "figures": json.dumps(_flat(metrics)),
    }


def _by_dof(metrics: Mapping[str, Any], name: str, dof: float) -> float | None:
    found = metrics.get(name)
    return None if found is None else float(found) / dof


def _flat(metrics: Mapping[str, Any], above: str = "") -> dict[str, float]:
    """Every number by its dotted name; true and false as 1 and 0."""
    found: dict[str, float] = {}
    for name, value in metrics.items():
        if isinstance(value, dict):
            found |= _flat(value, f"{above}{name}.")
        elif isinstance(value, (int, float)):
            found[above + name] = float(value)
    return found


def _floor(
    table: Table | None, timing: Table | None, metrics: Mapping[str, Any]
) -> dict[str, float | None]:
    """Share of the frames with a floor, its claimed and its true error of tilt; empty without a table."""
    if table is None:
        return {"floor_share": None, "tilt_sigma_deg": None, "tilt_error_deg": None}
    stamps = table.numbers("stamp_s")
    seen = np.array([state == "seen" for state in table.words("state")])
    frames = len(stamps if timing is None else timing)
    P00, P01, P11 = (table.numbers(name)[seen] for name in ("P00", "P01", "P11"))
    larger = (P00 + P11) / 2 + np.hypot((P00 - P11) / 2, P01)  # eigenvalue of the two tilts
    cameras = [one for one in CAMERAS if f"floor_{one}_angle_deg_median" in metrics]
    counts = {one: table.words("camera").count(one) for one in cameras}
    return {
        "floor_share": len(set(stamps[seen].tolist())) / max(frames, 1),
        "tilt_sigma_deg": float(np.degrees(np.sqrt(np.median(larger)))) if len(larger) else None,
        "tilt_error_deg": metrics[f"floor_{max(cameras, key=lambda one: counts[one])}_angle_deg_median"]
        if cameras
        else None,
    }  # fmt: skip


def _obstacles(tracks: list[dict[str, Any]]) -> dict[str, int]:
    likeliest = likeliest_moving(tracks)
    return {
        "tracks": len({int(entry["track"]) for entry in tracks}),
        "movers": sum(probability > MOVING for probability in likeliest.values()),
    }
