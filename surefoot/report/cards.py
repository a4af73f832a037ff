"""The figures at the top of the report, and its verdict."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ..evaluation.targets import verdicts
from ..results.run_folder import MAP, MONOCULAR, PANORAMA


@dataclass(frozen=True)
class Card:
    """One figure at the top of the page; `met` is None without a target."""

    name: str
    value: str
    note: str
    met: bool | None = None


def cards(metrics: dict[str, Any], summary: dict[str, Any], kind: str) -> list[Card]:
    """The cards of a run of any kind, as far as its figures are known.

    Args:
        metrics: Content of metrics.json.
        summary: Content of summary.json.
        kind: Kind of the run.
    """
    listed = _trajectory(metrics) + _perception(metrics) + _obstacles(metrics) + _walk(metrics)
    if kind == MAP:
        listed += _plain(
            summary,
            ("vertices", "Surface", "{:,.0f}", "vertices of the mesh"),
            ("walkable_m2", "Walkable floor", "{:.1f} m²", "known, flat and free"),
            ("closures", "Loop closures", "{:.0f}", "places recognised again"),
        )
    if kind == PANORAMA:
        note = f"of {metrics.get('views', 0):.0f}"
        listed += _plain(
            metrics,
            ("views_placed", "Views placed", "{:.0f}", note),
            ("obstacles", "Obstacles", "{:.0f}", "listed below"),
        )
    if kind == MONOCULAR:
        listed += _plain(
            metrics,
            ("floor_iou_median", "Floor IoU", "{:.3f}", "median, colour against depth"),
            ("floor_iou_min", "Smallest floor IoU", "{:.3f}", "colour against depth"),
            (
                "frames_judged",
                "Frames judged",
                "{:.0f}",
                f"of {metrics.get('frames', 0):.0f}, by depth",
            ),
        )
    return listed + _resources(metrics, summary)


def verdict(metrics: dict[str, Any]) -> tuple[str, str]:
    """Style class and words of the verdict: how many targets are met."""
    judged = verdicts(metrics)
    if not judged:
        return "none", "no ground truth: no targets checked"
    missed = [f"{one.target.words} ({one.miss})" for one in judged if not one.met]
    text = f"{len(judged) - len(missed)} of {len(judged)} targets met"
    if not missed:
        return "good", text if len(judged) > 1 else f"target met: {judged[0].target.words}"
    return "bad", f"{text}; missed: {', '.join(missed)}"


def skipped(summary: dict[str, Any]) -> dict[str, int]:
    """Number of skipped frames by reason; older maps record only their number."""
    found = summary.get("skipped") or {}
    return found if isinstance(found, dict) else {"unreadable": int(found)}


def _plain(values: dict[str, Any], *wanted: tuple[str, str, str, str]) -> list[Card]:
    """Cards without a target, from (key, name, format, note)."""
    return [
        Card(name, shown.format(values[key]), note)
        for key, name, shown, note in wanted
        if values.get(key) is not None
    ]


def _met(metrics: dict[str, Any], figure: str) -> bool | None:
    return {one.target.figure: one.met for one in verdicts(metrics)}.get(figure)


def _trajectory(metrics: dict[str, Any]) -> list[Card]:
    listed = []
    if "position_rmse_m" in metrics:
        shown = f"{100 * metrics['position_rmse_m']:.1f} cm"
        met = _met(metrics, "position_rmse_m")
        listed.append(Card("Position error", shown, "RMS, horizontal; at most 5 cm", met))
    if "heading_rmse_deg" in metrics:
        shown = f"{metrics['heading_rmse_deg']:.2f}°"
        met = _met(metrics, "heading_rmse_deg")
        listed.append(Card("Heading error", shown, "RMS; at most 2°", met))
    if "ate_m" in metrics and "position_rmse_m" not in metrics:
        shown = f"{metrics['ate_m']:.3f} m"
        listed.append(Card("Trajectory error", shown, "RMS after alignment (ATE)"))
    if metrics.get("pose_anees") is not None:
        low, high = metrics.get("pose_anees_low") or 0.0, metrics.get("pose_anees_high") or 0.0
        note = f"consistent: {low:.2f} to {high:.2f}"
        met = _met(metrics, "pose_consistent")
        listed.append(Card("Mean NEES of the pose", f"{metrics['pose_anees']:.2f}", note, met))
    return listed


def _perception(metrics: dict[str, Any]) -> list[Card]:
    listed = _plain(
        metrics, ("surface_fscore_2cm", "Surface, F-score", "{:.1%}", "against the truth, at 2 cm")
    )
    if metrics.get("grid_correct_share") is not None:
        one_cell = metrics.get("grid_correct_share_one_cell")
        note = "at least 95 %" + (
            f"; {one_cell:.1%} within one cell" if one_cell is not None else ""
        )
        shown = f"{metrics['grid_correct_share']:.1%}"
        met = _met(metrics, "grid_correct_share")
        listed.append(Card("Observed cells correct", shown, note, met))
    for figure, name, shown, note in (
        ("floor_tof_angle_deg_median", "Floor tilt error", "{:.2f}°", "TOF, median; at most 0.5°"),
        ("floor_tof_height_mm_median", "Floor height error", "{:.1f} mm", "TOF, median; at most 5 mm"),
    ):  # fmt: skip
        if metrics.get(figure) is not None:
            listed.append(Card(name, shown.format(metrics[figure]), note, _met(metrics, figure)))
    if "floor_tof_angle_deg_median" not in metrics:
        for camera in ("tof", "depth", "stereo"):
            figure = f"floor_{camera}_seen_share"
            listed += _plain(
                metrics,
                (figure, f"Floor seen ({camera})", "{:.0%}", "the others were only expected"),
            )
    return listed


def _obstacles(metrics: dict[str, Any]) -> list[Card]:
    listed = []
    movers = int(metrics.get("moving_obstacle_count") or 0)
    of_movers = f"of {movers} mover{'' if movers == 1 else 's'}"
    if metrics.get("moving_obstacle_anees") is not None:
        low, high = (metrics[f"moving_obstacle_anees_{side}"] for side in ("low", "high"))
        shown = f"{metrics['moving_obstacle_anees']:.2f}"
        met = _met(metrics, "moving_obstacle_consistent")
        note = f"consistent: {low:.2f} to {high:.2f}"
        listed.append(Card("Mean NEES of moving obstacles", shown, note, met))
    for figure, name, shown, note in (
        ("moving_obstacle_tracked_share", "Moving obstacles tracked", "{:.0%}", f"{of_movers}, in sight or not; at least 80 %"),
        ("ospa_m", "Moving obstacles, OSPA", "{:.2f} m", f"{of_movers}; at most 0.25 m of 0.5 m"),
        ("poses_in_footprints", "Own poses in footprints", "{:.0f}", "of obstacles; none"),
        ("footprint_iou_median", "Footprints, IoU", "{:.2f}", "median, seen from two sides; at least 0.8"),
    ):  # fmt: skip
        if metrics.get(figure) is not None:
            listed.append(Card(name, shown.format(metrics[figure]), note, _met(metrics, figure)))
    return listed


def _walk(metrics: dict[str, Any]) -> list[Card]:
    listed = []
    if "min_clearance_m" in metrics:
        count = int(metrics.get("contacts", 0))
        note = "no contact" if count == 0 else f"{count} contact" + ("s" if count > 1 else "")
        shown = f"{100 * metrics['min_clearance_m']:.1f} cm"
        listed.append(Card("Smallest clearance", shown, note, _met(metrics, "contacts")))
    if "goals_passed" in metrics:
        shown = f"{metrics['goals_passed']:.0f} of {metrics['goals']:.0f}"
        note = f"final distance to the last: {metrics['goal_final_m']:.2f} m"
        listed.append(Card("Goals reached", shown, note, _met(metrics, "goals_missed")))
    if metrics.get("falls") is not None:
        met = _met(metrics, "falls")
        listed.append(Card("Falls", f"{metrics['falls']:.0f}", "a fall ends the run", met))
    return listed


def _resources(metrics: dict[str, Any], summary: dict[str, Any]) -> list[Card]:
    duration = f"in {metrics.get('duration_s') or 0:.0f} s"
    listed = _plain(metrics, ("path_m", "Path length", "{:.2f} m", duration))
    total = (metrics.get("timing_ms") or {}).get("total")
    if total:
        note = f"median; 95 % below {total['p95']:.0f} ms"
        listed.append(Card("Time per frame", f"{total['p50']:.0f} ms", note))
    if "frames" in summary:
        count = sum(skipped(summary).values())
        note = "none skipped" if count == 0 else f"{count} skipped"
        listed.append(Card("Frames", str(summary["frames"]), note))
    return listed
