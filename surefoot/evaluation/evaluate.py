"""One run against its truth: every figure that the truth at hand allows, and none that it does not.

The only part of the project that reads truth. A figure whose truth is absent is absent, never zero.
"""

from __future__ import annotations

import operator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from perception.primitives.errors import InputError

from ..results.run_folder import COVARIANCE_HEADER, ERRORS, RunFolder
from ..results.tables import Table, Trajectory, read_tum
from ..results.trajectory_uncertainty import SPACE, aligned_covariances
from .metrics.consistency import consistency_metrics, whitened
from .metrics.contacts import contact_metrics, goal_metrics, walk_metrics
from .metrics.floor import floor_metrics
from .metrics.gauge_alignment import FLOOR as FLOOR_NAMES
from .metrics.gauge_alignment import SPACE as SPACE_NAMES
from .metrics.gauge_alignment import (
    TURNED_DEG,
    aligned_on_floor,
    body_turn_deg,
    claim_metrics,
    errors_in_space,
    errors_on_floor,
    standing,
    up_in_truth,
)
from .metrics.innovations import innovation_metrics
from .metrics.maps import map_metrics, read_map
from .metrics.obstacles import obstacle_metrics
from .metrics.surfaces import read_surface, surface_metrics
from .metrics.timing import timing_metrics
from .metrics.trajectory import (
    Alignment,
    alignment_of,
    associate,
    pick,
    trajectory_metrics,
    wrapped,
)

LEAST_POSES = 5  # of which an alignment leaves something

_COMPARE = {"<=": operator.le, ">=": operator.ge, "==": operator.eq}

_OWN_AXES = ("position_rmse_m", "position_max_m", "heading_rmse_deg", "heading_max_deg")


@dataclass(frozen=True)
class Target:
    """What one figure must be for the run to count as good."""

    figure: str
    words: str
    compare: str
    bound: float
    unit: str = ""

    def met(self, value: float) -> bool:
        """Whether a value is good enough."""
        return bool(_COMPARE[self.compare](value, self.bound))


TARGETS = (
    Target("position_rmse_m", "position error, RMS", "<=", 0.05, "m"),
    Target("heading_rmse_deg", "heading error, RMS", "<=", 2.0, "deg"),
    Target("pose_consistent", "pose covariance honest (mean NEES in its 95 % band)", "==", 1.0),
    Target("grid_correct_share", "seen grid cells that are right", ">=", 0.95),
    Target("floor_tof_angle_deg_median", "floor tilt error (TOF), median", "<=", 0.5, "deg"),
    Target("floor_tof_height_mm_median", "floor height error (TOF), median", "<=", 5.0, "mm"),
    Target("goals_missed", "goals not reached", "==", 0.0),
    Target("contacts", "contacts", "==", 0.0),
    Target("falls", "falls", "==", 0.0),
)


def evaluate(
    run: RunFolder,
    truth: Path | None = None,
    surface: Path | None = None,
    truth_sigma: tuple[float, float] = (0.0, 0.0),
) -> dict[str, Any]:
    """Compute every figure that is possible and write metrics.json.

    Args:
        run: The run.
        truth: A trajectory in TUM text to compare with instead of the run's own truth/. Its axes and its
            body point may be others, so only what an alignment leaves is measured then; and of claimed
            covariances what the same alignment leaves of them, if it is the way of the run's own camera.
        surface: A mesh or cloud of the true surfaces to hold the run's against: in the frame of the run, or,
            with a truth, in that of the truth.
        truth_sigma: Deviations of the given truth itself, m and rad, for its claims.

    Returns:
        Figure names and numbers, flat; "timing_ms" alone is a table: stage to p50, p95, max. Names and
        meanings are in `surefoot.evaluation.metrics`.

    Raises:
        InputError, RecordingError: A file of the run, or the given truth, cannot be read.
        OutputError: metrics.json cannot be written.
    """
    metrics: dict[str, Any] = {}
    summary = run.read_json("summary.json") or {}
    estimate = run.read_trajectory("trajectory.txt") if run.has("trajectory.txt") else None
    true = read_tum(truth) if truth is not None else run.read_trajectory("truth/trajectory.txt")
    run.path(ERRORS).unlink(missing_ok=True)
    walked = true if true is not None else estimate
    if walked is not None:
        metrics |= walk_metrics(walked.stamps, walked.positions)
    if estimate is not None and true is not None and truth is not None:
        figures = trajectory_metrics(estimate, true)
        metrics |= {name: value for name, value in figures.items() if name not in _OWN_AXES}
        metrics |= _claims(run, estimate, true, truth_sigma)
    elif estimate is not None and true is not None:
        metrics |= trajectory_metrics(estimate, true)
        claims = pose_errors(run, true)
        metrics |= {} if claims is None else consistency_metrics(claims[1], "pose")
        metrics |= _smoothed(run, true)
    if true is not None and truth is None:
        metrics |= _goals(true, summary)
    if summary.get("body") == "dynamic":
        metrics["falls"] = float(summary.get("fell_at_s") is not None)
    metrics |= _against_tables(run)
    if surface is not None:
        moved = None
        if truth is not None and estimate is not None and true is not None:
            moved = alignment_of(estimate, true)
        metrics |= _surface(run, surface, moved)
    timing = run.read_csv("timing.csv")
    if timing is not None:
        metrics["timing_ms"] = timing_metrics(timing)
    run.write_json("metrics.json", metrics)
    return metrics


def _surface(run: RunFolder, surface: Path, moved: Alignment | None) -> dict[str, float]:
    """The run's surface, or its cloud, against a true one, moved into its frame first."""
    name = "mesh.ply" if run.has("mesh.ply") else "cloud.ply"
    if not run.has(name):
        raise InputError(f"{run.root}: the run has no cloud.ply to hold against {surface}")
    mapped = read_surface(run.path(name))
    if moved is not None:
        mapped = moved.apply(mapped)
    return {f"surface_{k}": v for k, v in surface_metrics(mapped, read_surface(surface)).items()}


def _claims(
    run: RunFolder, estimate: Trajectory, true: Trajectory, truth_sigma: tuple[float, float]
) -> dict[str, float | bool]:
    """Whether claims hold against a truth with axes of its own; none where they cannot be compared."""
    held = aligned_claims_of(run, estimate, true)
    if held is None:
        return {}
    stamps, errors, covariances = held
    names = SPACE_NAMES if errors.shape[1] == 6 else FLOOR_NAMES
    header = ("stamp_s", *(f"error_{n}" for n in names), *(f"sigma_{n}" for n in names))
    sigmas = np.sqrt(np.maximum(np.diagonal(covariances, axis1=1, axis2=2), 0.0))
    run.write_csv(ERRORS, header, np.column_stack([stamps, errors, sigmas]).tolist())
    return claim_metrics(errors, covariances, truth_sigma)


def aligned_claims_of(
    run: RunFolder, estimate: Trajectory, true: Trajectory
) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n k"], Float[np.ndarray, "n k k"]] | None:
    """Stamps, errors after the best motion of the whole, and claims after the same.

    Of (x, y, z, rotation vector) for the way of `surefoot map`; of (x, y, yaw) for a run, whose floors say
    what is up in the truth. None where nothing is claimed, too little is known, or the truth is that of
    another body.
    """
    in_space = run.read_csv(SPACE)
    if in_space is not None:
        stamps, covariances = aligned_covariances(in_space)
        known, own = associate(estimate.stamps, stamps, 1e-6)
        estimate, covariances = pick(estimate, known), covariances[own]
        mine, theirs = associate(estimate.stamps, true.stamps)
        if len(mine) < LEAST_POSES:
            return None
        estimate, true = pick(estimate, mine), pick(true, theirs)
        turned = body_turn_deg(estimate, true)
        if turned is not None and turned > TURNED_DEG:
            return None
        return estimate.stamps, errors_in_space(estimate, true), covariances[mine]
    table, floors = run.read_csv("trajectory_covariance.csv"), run.read_csv("floor.csv")
    if table is None or floors is None:
        return None
    stamps, poses, planar = pose_claims(table)
    mine, theirs = associate(stamps, true.stamps)
    up = up_in_truth(floors, true)
    if len(mine) < LEAST_POSES or up is None:
        return None
    errors = errors_on_floor(poses[mine], standing(pick(true, theirs), up))
    return stamps[mine], errors, aligned_on_floor(poses[mine, :2], planar[mine])


def _smoothed(run: RunFolder, true: Trajectory) -> dict[str, float | bool]:
    """The same figures of the smoothed poses, with the prefix smoothed_; none where nobody smoothed."""
    if not run.has("smoothed.txt"):
        return {}
    figures = trajectory_metrics(read_tum(run.path("smoothed.txt")), true)
    told: dict[str, float | bool] = {
        f"smoothed_{name}": figures[name] for name in _OWN_AXES if name in figures
    }
    claims = pose_errors(run, true, "smoothed_covariance.csv")
    return told if claims is None else told | consistency_metrics(claims[1], "smoothed")


def pose_errors(
    run: RunFolder, true: Trajectory, name: str = "trajectory_covariance.csv"
) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n 3"]] | None:
    """Stamps of the poses and their errors (x, y, yaw) in units of their own covariance.

    None if the run has no covariances or nothing matches.
    """
    table = run.read_csv(name)
    if table is None:
        return None
    stamps, poses, covariances = pose_claims(table)
    mine, theirs = associate(stamps, true.stamps)
    if len(mine) == 0:
        return None
    errors = poses[mine] - np.column_stack([true.positions[theirs, :2], true.yaws[theirs]])
    errors[:, 2] = wrapped(errors[:, 2])
    return stamps[mine], whitened(errors, covariances[mine])


def pose_claims(
    table: Table,
) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3 3"]]:
    """Stamps, poses (x, y, yaw) and covariances from trajectory_covariance.csv."""
    numbers = table.matrix(*COVARIANCE_HEADER)
    covariances = np.zeros((len(numbers), 3, 3))
    rows, columns = np.triu_indices(3)
    covariances[:, rows, columns] = covariances[:, columns, rows] = numbers[:, 4:]
    return numbers[:, 0], numbers[:, 1:4], covariances


def _goals(true: Trajectory, summary: dict[str, Any]) -> dict[str, float]:
    """Goals by the true way, whatever the run itself believed to have reached."""
    goals = [tuple(float(v) for v in goal) for goal in summary.get("goal_positions") or []]
    figures = goal_metrics(true.positions, goals)
    if figures:
        figures["goals_missed"] = figures["goals"] - figures["goals_passed"]
    return figures


def _against_tables(run: RunFolder) -> dict[str, float | bool]:
    figures: dict[str, float | bool] = {}
    floor, true_floor = run.read_csv("floor.csv"), run.read_csv("truth/floor.csv")
    if floor is not None:
        figures |= floor_metrics(floor, true_floor)
    surprises = run.read_csv("innovations.csv")
    if surprises is not None:
        figures |= innovation_metrics(surprises)
    obstacles, true_obstacles = run.read_json("obstacles.json"), run.read_csv("truth/obstacles.csv")
    if obstacles is not None and true_obstacles is not None:
        figures |= obstacle_metrics(obstacles["tracks"], true_obstacles)
    if run.has("map.yaml") and run.has("truth/map.yaml"):
        figures |= map_metrics(read_map(run.path("map.yaml")), read_map(run.path("truth/map.yaml")))
    clearance = run.read_csv("truth/clearance.csv")
    if clearance is not None:
        figures |= contact_metrics(clearance)
    return figures


def verdicts(metrics: dict[str, Any]) -> list[tuple[Target, float, bool]]:
    """Every target whose figure is there: target, value, whether it is met."""
    return [
        (target, float(metrics[target.figure]), target.met(float(metrics[target.figure])))
        for target in TARGETS
        if metrics.get(target.figure) is not None
    ]


def closing_table(metrics: dict[str, Any]) -> str:
    """The figures that matter as plain text, for the terminal."""
    judged = [
        (
            target.words,
            f"{value:.4g} {target.unit}".strip(),
            _wanted(target),
            "ok" if met else "MISSED",
        )
        for target, value, met in verdicts(metrics)
    ]
    told = [(words, shown, "", "") for words, shown in _told(metrics)]
    if not judged and not told:
        return "nothing to compare: the run has no truth, no poses and no timing"
    rows = judged + told
    widths = [max(len(row[i]) for row in rows) for i in range(4)]
    lines = [
        f"{a:<{widths[0]}}  {b:>{widths[1]}}  {c:<{widths[2]}}  {d}".rstrip() for a, b, c, d in rows
    ]
    if not judged:
        lines.append("no truth of its own beside this run: no targets to judge")
    return "\n".join(lines)


def _wanted(target: Target) -> str:
    return f"{target.compare} {target.bound:g} {target.unit}".strip()


def _told(metrics: dict[str, Any]) -> list[tuple[str, str]]:
    """Figures without a target."""
    rows = [
        ("smallest clearance", "min_clearance_m", "{:.3f} m"),
        ("way walked", "path_m", "{:.2f} m"),
        ("duration", "duration_s", "{:.1f} s"),
        ("grid cells right within one cell", "grid_correct_share_one_cell", "{:.4f}"),
        ("position after alignment, RMS (ATE)", "ate_aligned_m", "{:.4f} m"),
        ("position error after smoothing, RMS", "smoothed_position_rmse_m", "{:.4f} m"),
        ("mover position error, RMS", "mover_position_rmse_m", "{:.3f} m"),
        ("mover velocity error, RMS", "mover_velocity_rmse_mps", "{:.3f} m/s"),
        ("movers: OSPA (cut at 0.5 m)", "ospa_m", "{:.3f} m"),
        (
            f"mean NEES of the pose ({metrics.get('pose_dof', 3):.0f} if honest)",
            "pose_anees",
            "{:.2f}",
        ),
        ("mean NIS of landmarks (2 if honest)", "landmark_anis", "{:.2f}"),
        ("mean NIS of tracks (2 if honest)", "track_anis", "{:.2f}"),
    ]
    told = [(w, f.format(metrics[n])) for w, n, f in rows if metrics.get(n) is not None]
    total = metrics.get("timing_ms", {}).get("total")
    if total:
        told.append(
            ("time per frame, median / 95 %", f"{total['p50']:.0f} / {total['p95']:.0f} ms")
        )
    return told
