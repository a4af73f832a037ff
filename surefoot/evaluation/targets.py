"""Targets of a run, and the closing table of `surefoot evaluate`."""

from __future__ import annotations

import math
import operator
from dataclasses import dataclass
from typing import Any, NamedTuple

_COMPARE = {"<=": operator.le, ">=": operator.ge, "==": operator.eq}
_WORDS = {"<=": "at most", ">=": "at least", "==": "should be"}


@dataclass(frozen=True)
class Target:
    """The bound that one figure must meet."""

    figure: str
    words: str
    compare: str
    bound: float
    unit: str = ""
    dof: int = 0

    def met(self, value: float) -> bool:
        """Whether a value meets the bound."""
        return bool(_COMPARE[self.compare](value, self.bound))

    def miss(self, value: float, metrics: dict[str, Any]) -> str:
        """The value with its bound, or of a consistency the direction and factor; empty if it is met."""
        if self.met(value):
            return ""
        mean = metrics.get(self.figure.replace("_consistent", "_anees"))
        if self.dof and mean is not None:
            dof = float(metrics.get(self.figure.replace("_consistent", "_dof"), self.dof))
            low, high, share = (
                metrics.get(self.figure.replace("_consistent", name))
                for name in ("_anees_low", "_anees_high", "_no_covariance_share")
            )
            if share and low <= mean <= high:
                return f"{share:.2%} of the covariances are not positive definite"
            above = mean > high
            return (
                f"too {'sure' if above else 'careful'}: "
                f"errors {math.sqrt(mean / dof):.2f} times the claimed ones"
            )
        if math.isnan(value):
            return "unknown"
        shown, bound = (f"{one:.3g} {self.unit}".strip() for one in (value, self.bound))
        return f"{shown}, {_WORDS[self.compare]} {bound}"


class Verdict(NamedTuple):
    """A target, the value that it judges, whether it is met, and how it is missed."""

    target: Target
    value: float
    met: bool
    miss: str


TARGETS = (
    Target("position_rmse_m", "position error, RMS", "<=", 0.05, "m"),
    Target("heading_rmse_deg", "heading error, RMS", "<=", 2.0, "deg"),
    Target(
        "pose_consistent",
        "pose covariance consistent (mean NEES in its 95 % band)",
        "==",
        1.0,
        dof=3,
    ),
    Target("grid_correct_share", "share of observed grid cells that are correct", ">=", 0.95),
    Target("floor_tof_angle_deg_median", "floor tilt error (TOF), median", "<=", 0.5, "deg"),
    Target("floor_tof_height_mm_median", "floor height error (TOF), median", "<=", 5.0, "mm"),
    Target(
        "moving_obstacle_consistent",
        "covariance of moving obstacles consistent (mean NEES in its 95 % band)",
        "==",
        1.0,
        dof=4,
    ),
    Target(
        "moving_obstacle_tracked_share", "moving obstacles: share of instants tracked", ">=", 0.8
    ),
    Target("ospa_m", "moving obstacles: OSPA (cut-off 0.5 m)", "<=", 0.25, "m"),
    Target("poses_in_footprints", "own poses inside footprints of obstacles", "==", 0.0),
    Target("footprints_over_free_share", "share of the footprints over free cells", "==", 0.0),
    Target("footprint_iou_median", "footprints seen from two sides, IoU, median", ">=", 0.8),
    Target("views_placed_share", "panorama: share of the views placed", ">=", 0.5),
    Target("goals_missed", "goals not reached", "==", 0.0),
    Target("contacts", "contacts", "==", 0.0),
    Target("falls", "falls", "==", 0.0),
)

_UNTARGETED = (  # words, figure, format
    ("smallest clearance", "min_clearance_m", "{:.3f} m"),
    ("path length", "path_m", "{:.2f} m"),
    ("duration", "duration_s", "{:.1f} s"),
    ("grid cells correct within one cell", "grid_correct_share_one_cell", "{:.4f}"),
    ("position error after alignment, RMS (ATE)", "ate_m", "{:.4f} m"),
    ("position error after smoothing, RMS", "smoothed_position_rmse_m", "{:.4f} m"),
    ("surface: distance of the map from the truth, median", "surface_accuracy_mm", "{:.1f} mm"),
    ("surface: map points within 2 cm of the truth", "surface_precision_2cm", "{:.1%}"),
    ("surface: true points within 2 cm of the map", "surface_completeness_2cm", "{:.1%}"),
    ("surface: F-score at 2 cm", "surface_fscore_2cm", "{:.1%}"),
    ("moving obstacles: position error, RMS", "moving_obstacle_position_rmse_m", "{:.3f} m"),
    ("moving obstacles: velocity error, RMS", "moving_obstacle_velocity_rmse_mps", "{:.3f} m/s"),
    ("mean NEES of the pose ({dof:.0f} if consistent)", "pose_anees", "{:.2f}"),
    ("mean NIS of landmarks (2 if consistent)", "landmark_anis", "{:.2f}"),
    ("mean NIS of tracks (2 if consistent)", "track_anis", "{:.2f}"),
    ("frames in which the odometry is doubtful (alarm)", "odometry_alarms", "{:.0f}"),
    ("views placed", "views_placed", "{:.0f}"),
    ("obstacles listed", "obstacles", "{:.0f}"),
    ("frames", "frames", "{:.0f}"),
    ("frames with a depth image to compare with", "frames_judged", "{:.0f}"),
    ("floor by colour against depth, IoU, median", "floor_iou_median", "{:.3f}"),
    ("floor by colour against depth, IoU, smallest", "floor_iou_min", "{:.3f}"),
)


def verdicts(metrics: dict[str, Any]) -> list[Verdict]:
    """The verdict on every target whose figure is known."""
    known = [
        (one, float(metrics[one.figure])) for one in TARGETS if metrics.get(one.figure) is not None
    ]
    return [Verdict(one, value, one.met(value), one.miss(value, metrics)) for one, value in known]


def closing_table(metrics: dict[str, Any]) -> str:
    """The most important figures as plain text for the terminal."""
    judged = [
        (
            target.words,
            f"{value:.4g} {target.unit}".strip(),
            _bound(target),
            "ok" if met else f"MISSED, {miss}" if target.dof else "MISSED",
        )
        for target, value, met, miss in verdicts(metrics)
    ]
    rows = judged + [(words, shown, "", "") for words, shown in _untargeted(metrics)]
    note = [str(metrics["note"])] if "note" in metrics else []
    if not rows:
        return "\n".join(
            note or ["nothing to compare: the run has no ground truth, no poses and no timing"]
        )
    widths = [max(len(row[i]) for row in rows) for i in range(4)]
    lines = [
        f"{a:<{widths[0]}}  {b:>{widths[1]}}  {c:<{widths[2]}}  {d}".rstrip() for a, b, c, d in rows
    ]
    if metrics.get("interrupted"):
        lines.append("the run was interrupted: the figures are those of its first part")
    if not judged and not note:
        lines.append("no ground truth in the axes of this run: no targets to check")
    return "\n".join(lines + note)


def _bound(target: Target) -> str:
    return f"{target.compare} {target.bound:g} {target.unit}".strip()


def _untargeted(metrics: dict[str, Any]) -> list[tuple[str, str]]:
    """Words and value of the figures without a target."""
    dof = float(metrics.get("pose_dof", 3))
    rows = [
        (words.format(dof=dof), shown.format(metrics[name]))
        for words, name, shown in _UNTARGETED
        if metrics.get(name) is not None
    ]
    total = metrics.get("timing_ms", {}).get("total")
    if total:
        rows.append(
            ("time per frame, median / 95 %", f"{total['p50']:.0f} / {total['p95']:.0f} ms")
        )
    return rows
