"""Evaluation of one run: all figures that its ground truth allows.

A figure without ground truth is absent, never zero. Only this package reads ground truth. A run in the axes of
the truth (a simulated walk) is compared as it is; a camera trajectory with its own axes (a map, a camera in
the hand) is compared after rigid alignment.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from perception.primitives.errors import InputError

from ..results.run_folder import (
    BATCH,
    COVARIANCE_HEADER,
    ERRORS,
    MAP,
    MONOCULAR,
    PANORAMA,
    PLAYBACK,
    SIMULATION,
    RunFolder,
)
from ..results.tables import Table, Trajectory
from ..results.tracking import TRACKING, tracking_metrics
from ..results.trajectory_uncertainty import SPACE, read_aligned_covariances
from .footprints import footprint_figures
from .foreign_trajectory import read_trajectory
from .metrics.consistency import consistency_metrics, whitened
from .metrics.contacts import contact_metrics, goal_metrics, walk_metrics
from .metrics.floor import floor_metrics
from .metrics.gauge_alignment import FLOOR as FLOOR_NAMES
from .metrics.gauge_alignment import (
    MAX_BODY_ROTATION_DEG,
    aligned_consistency,
    aligned_on_floor,
    body_rotation_deg,
    errors_in_space,
    errors_on_floor,
    planar_poses,
    up_in_truth,
)
from .metrics.gauge_alignment import SPACE as SPACE_NAMES
from .metrics.innovations import innovation_metrics
from .metrics.levels import level_metrics
from .metrics.maps import map_metrics, read_map
from .metrics.obstacles import obstacle_metrics
from .metrics.risk import risk_metrics, risk_of_run
from .metrics.surfaces import read_surface, surface_metrics
from .metrics.timing import timing_metrics
from .metrics.trajectory import (
    MAX_DIFFERENCE_S,
    Alignment,
    alignment_of,
    associate,
    pick,
    trajectory_metrics,
    wrapped,
)

MIN_POSES = 5  # ours: with fewer poses an alignment leaves hardly any error

_OWN_AXES = (
    "position_rmse_m",
    "position_max_m",
    "position_rmse_3d_m",
    "heading_rmse_deg",
    "heading_max_deg",
)


def evaluate(
    run: RunFolder,
    truth: Path | None = None,
    surface: Path | None = None,
    truth_sigma: tuple[float, float] = (0.0, 0.0),
) -> dict[str, Any]:
    """Compute all possible figures of a run and write metrics.json.

    Args:
        run: A run of any kind.
        truth: Trajectory in TUM, EuRoC or KITTI text, used instead of the run's own truth/. That of KITTI has no
            stamps and needs as many lines as the run has poses. Axes and body point may differ from those of the run,
            so only errors after alignment are measured, and the consistency of the covariances only if the truth is a
            trajectory of the same camera.
        surface: True surface (mesh or cloud) to compare the surface of the run with: in the frame of the run,
            or, together with `truth`, in the frame of the truth.
        truth_sigma: Standard deviations of the given truth itself, m and rad.

    Returns:
        Names and values of the figures. All are numbers but "timing_ms" (stage: p50, p95, max) and "note" (what
        cannot be judged for this kind of run). `surefoot.evaluation.metrics` documents them.

    Raises:
        InputError, RecordingError: A file cannot be read, or the given truth has no stamp in common with the run.
        OutputError: metrics.json cannot be written.
    """
    kind = run.kind
    if kind == BATCH:
        raise InputError(
            f"{run.root} is a batch of runs; `surefoot batch evaluate {run.root}` evaluates them"
        )
    summary = run.read_json("summary.json") or {}
    estimate = run.read_trajectory("trajectory.txt")
    true = (
        run.read_trajectory("truth/trajectory.txt")
        if truth is None
        else _given(run, estimate, truth)
    )
    run.path(ERRORS).unlink(missing_ok=True)
    metrics: dict[str, Any] = _kind_metrics(run, kind)
    own_axes = truth is not None or has_own_axes(run)
    reference = true if true is not None else estimate
    if reference is not None:
        sessions = list(run.sessions(reference.stamps).values())
        path = reference.positions if own_axes else reference.positions[:, :2]
        metrics |= walk_metrics(reference.stamps, path, sessions)
    if estimate is not None and true is not None and own_axes:
        figures = trajectory_metrics(estimate, _upright(true, estimate))
        metrics |= {name: value for name, value in figures.items() if name not in _OWN_AXES}
        metrics |= _aligned_consistency(run, estimate, true, truth_sigma)
    elif estimate is not None and true is not None:
        metrics |= trajectory_metrics(estimate, true)
        errors = pose_errors(run, true)
        metrics |= {} if errors is None else consistency_metrics(errors[1], "pose")
        metrics |= _smoothed(run, true)
    if true is not None and not own_axes:
        metrics |= _goals(true, summary)
    if summary.get("body") == "dynamic":
        metrics["falls"] = float(summary.get("fell_at_s") is not None)
    metrics |= _against_tables(run) | footprint_figures(run, None if own_axes else true)
    if surface is not None:
        moved = None
        if truth is not None and estimate is not None and true is not None:
            moved = alignment_of(estimate, true)
        metrics |= _surface(run, surface, moved)
    timing = run.read_csv("timing.csv")
    if timing is not None:
        metrics["timing_ms"] = timing_metrics(timing)
    if kind == MAP and true is None:
        metrics["note"] = (
            "a map has axes of its own: --truth compares its camera trajectory, --surface its surface"
        )
    if run.interrupted:
        metrics["interrupted"] = True
    run.write_json("metrics.json", metrics)
    return metrics


def has_own_axes(run: RunFolder) -> bool:
    """Whether the poses of a run have world axes of their own, not those of its ground truth."""
    body = (run.read_json("summary.json") or {}).get("trajectory") == "body"
    return run.has(SPACE) or (run.kind == MAP and not body)


def true_trajectory(run: RunFolder) -> Trajectory | None:
    """The true trajectory of a run in the axes of the run; None if it is unknown or in other axes."""
    return None if has_own_axes(run) else run.read_trajectory("truth/trajectory.txt")


def _given(run: RunFolder, estimate: Trajectory | None, truth: Path) -> Trajectory:
    """A given truth; without stamps of its own it has those of the run, pose by pose.

    Raises:
        InputError: It cannot be compared with the run.
    """
    if estimate is None:
        raise InputError(
            f"{run.root}: a run of kind {run.kind} without trajectory.txt cannot be compared with --truth"
        )
    found = read_trajectory(truth)
    if not found.has_stamps:
        if len(found.poses) != len(estimate):
            raise InputError(
                f"{truth} ({found.format}) has no stamps and {len(found.poses)} poses, the run {len(estimate)}; without "
                "stamps the numbers must be equal: give a TUM or EuRoC file"
            )
        return replace(found.poses, stamps=estimate.stamps)
    true = found.poses
    if len(associate(estimate.stamps, true.stamps)[0]) == 0:
        raise InputError(
            f"{truth} has no stamp within {MAX_DIFFERENCE_S:g} s of a stamp of the run: it covers "
            f"{true.stamps[0]:.3f} to {true.stamps[-1]:.3f} s, the run {estimate.stamps[0]:.3f} to "
            f"{estimate.stamps[-1]:.3f} s; give a truth of the same recording and clock"
        )
    return true


def _upright(true: Trajectory, estimate: Trajectory) -> Trajectory:
    """The truth, turned into the axes of a run, whose floor is level: those of KITTI, for one, have y down."""
    moved = alignment_of(estimate, true)
    if moved is None:
        return true
    turned = Rotation.from_matrix(moved.rotation.T) * Rotation.from_quat(true.quats_xyzw)
    return replace(true, positions=true.positions @ moved.rotation, quats_xyzw=turned.as_quat())


def _kind_metrics(run: RunFolder, kind: str) -> dict[str, Any]:
    """Figures of panorama and monocular runs, with a note on what cannot be judged."""
    if kind == PANORAMA:
        content = run.read_json("panorama.json") or {}
        views = content.get("views", [])
        placed = float(sum(bool(view.get("placed")) for view in views))
        return {
            "views": float(len(views)),
            "views_placed": placed,
            "views_placed_share": placed / max(len(views), 1),
            "obstacles": float(len(content.get("obstacles", []))),
            "note": content.get("failed")
            or "a panorama has no ground truth: how many views are placed is judged, obstacles and gaps are not; "
            "panorama.json has their standard deviations",
        }
    if kind == MONOCULAR:
        content = run.read_json("monocular.json") or {}
        figures: dict[str, Any] = {
            "frames": float(content.get("frames", 0)),
            "frames_judged": float(content.get("judged", 0)),
        }
        if "iou" in content:
            figures |= {"floor_iou_median": content["iou"], "floor_iou_min": content["iou_min"]}
        judged = (
            "the depth camera judges the floor by colour"
            if "iou" in content
            else "no depth image judges the floor"
        )
        figures["note"] = f"{judged}; obstacles and their motion are not judged"
        return figures
    return {}


def _surface(run: RunFolder, surface: Path, moved: Alignment | None) -> dict[str, float]:
    """Figures of the mesh, or else the cloud, against the true surface, in the frame of the latter."""
    name = "mesh.ply" if run.has("mesh.ply") else "cloud.ply"
    if not run.has(name):
        raise InputError(
            f"{run.root}: the run has no mesh.ply or cloud.ply to compare with {surface}"
        )
    mapped = read_surface(run.path(name))
    if moved is not None:
        mapped = moved.apply(mapped)
    return {f"surface_{k}": v for k, v in surface_metrics(mapped, read_surface(surface)).items()}


def _aligned_consistency(
    run: RunFolder, estimate: Trajectory, true: Trajectory, truth_sigma: tuple[float, float]
) -> dict[str, float | bool]:
    """Consistency of the covariances after alignment, and the table of these errors; empty without either."""
    found = aligned_errors(run, estimate, true)
    if found is None:
        return {}
    stamps, errors, covariances = found
    names = SPACE_NAMES if errors.shape[1] == 6 else FLOOR_NAMES
    header = ("stamp_s", *(f"error_{n}" for n in names), *(f"sigma_{n}" for n in names))
    sigmas = np.sqrt(np.maximum(np.diagonal(covariances, axis1=1, axis2=2), 0.0))
    run.write_csv(ERRORS, header, np.column_stack([stamps, errors, sigmas]).tolist())
    return aligned_consistency(errors, covariances, truth_sigma)


def aligned_errors(
    run: RunFolder, estimate: Trajectory, true: Trajectory
) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n k"], Float[np.ndarray, "n k k"]] | None:
    """Stamps, errors after rigid alignment, and covariances after the same alignment.

    Errors are over (x, y, z, rotation vector) if the run has space_covariance.csv; else over (x, y, yaw), where
    the floors that the run saw give the vertical axis of the truth. None if the run has no covariances, fewer
    than `MIN_POSES` poses match, or the truth is the trajectory of another body.
    """
    in_space = run.read_csv(SPACE)
    if in_space is not None:
        stamps, covariances = read_aligned_covariances(in_space)
        known, own = associate(estimate.stamps, stamps, 1e-6)
        estimate, covariances = pick(estimate, known), covariances[own]
        mine, theirs = associate(estimate.stamps, true.stamps)
        if len(mine) < MIN_POSES:
            return None
        estimate, true = pick(estimate, mine), pick(true, theirs)
        rotation_deg = body_rotation_deg(estimate, true)
        if rotation_deg is not None and rotation_deg > MAX_BODY_ROTATION_DEG:
            return None
        return estimate.stamps, errors_in_space(estimate, true), covariances[mine]
    table, floors = run.read_csv("trajectory_covariance.csv"), run.read_csv("floor.csv")
    if table is None or floors is None:
        return None
    stamps, poses, planar = planar_estimates(table)
    mine, theirs = associate(stamps, true.stamps)
    up = up_in_truth(floors, true)
    if len(mine) < MIN_POSES or up is None:
        return None
    errors = errors_on_floor(poses[mine], planar_poses(pick(true, theirs), up))
    return stamps[mine], errors, aligned_on_floor(poses[mine, :2], planar[mine])


def _smoothed(run: RunFolder, true: Trajectory) -> dict[str, float | bool]:
    """Pose figures of the smoothed trajectory, with the prefix smoothed_; empty without one."""
    smoothed = run.read_trajectory("smoothed.txt")
    if smoothed is None:
        return {}
    figures = trajectory_metrics(smoothed, true)
    found: dict[str, float | bool] = {
        f"smoothed_{name}": figures[name] for name in _OWN_AXES if name in figures
    }
    errors = pose_errors(run, true, "smoothed_covariance.csv")
    return found if errors is None else found | consistency_metrics(errors[1], "smoothed")


def pose_errors(
    run: RunFolder, true: Trajectory, name: str = "trajectory_covariance.csv"
) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n 3"]] | None:
    """Stamps and errors of (x, y, yaw), whitened by their own covariance.

    None if the run has no covariances or no stamps match.
    """
    table = run.read_csv(name)
    if table is None:
        return None
    stamps, poses, covariances = planar_estimates(table)
    mine, theirs = associate(stamps, true.stamps)
    if len(mine) == 0:
        return None
    errors = poses[mine] - np.column_stack([true.positions[theirs, :2], true.yaws[theirs]])
    errors[:, 2] = wrapped(errors[:, 2])
    return stamps[mine], whitened(errors, covariances[mine])


def planar_estimates(
    table: Table,
) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3 3"]]:
    """Stamps, poses (x, y, yaw) and covariances from trajectory_covariance.csv."""
    numbers = table.matrix(*COVARIANCE_HEADER)
    covariances = np.zeros((len(numbers), 3, 3))
    rows, columns = np.triu_indices(3)
    covariances[:, rows, columns] = covariances[:, columns, rows] = numbers[:, 4:]
    return numbers[:, 0], numbers[:, 1:4], covariances


def _goals(true: Trajectory, summary: dict[str, Any]) -> dict[str, float]:
    """Goals reached by the true trajectory, whatever the run itself estimated."""
    goals = [tuple(float(v) for v in goal) for goal in summary.get("goal_positions") or []]
    figures = goal_metrics(true.positions, goals)
    if figures:
        figures["goals_missed"] = figures["goals"] - figures["goals_passed"]
    return figures


def _against_tables(run: RunFolder) -> dict[str, float | bool]:
    """Figures of floor, innovations, obstacles, grid, contacts and claimed risk."""
    figures: dict[str, float | bool] = {}
    floor, true_floor = run.read_csv("floor.csv"), run.read_csv("truth/floor.csv")
    if floor is not None:
        figures |= floor_metrics(floor, true_floor)
    figures |= tracking_metrics(run.read_csv(TRACKING))
    innovations = run.read_csv("innovations.csv")
    if innovations is not None:
        figures |= innovation_metrics(innovations)
    obstacles, true_obstacles = run.read_json("obstacles.json"), run.read_csv("truth/obstacles.csv")
    if obstacles is not None and true_obstacles is not None:
        figures |= obstacle_metrics(obstacles["tracks"], true_obstacles)
    if run.has("map.yaml") and run.has("truth/map.yaml"):
        figures |= map_metrics(read_map(run.path("map.yaml")), read_map(run.path("truth/map.yaml")))
    clearance = run.read_csv("truth/clearance.csv")
    if clearance is not None and run.kind in (SIMULATION, PLAYBACK):  # the others judge no walk
        figures |= contact_metrics(clearance)
    risk = risk_of_run(run)
    if risk is not None:
        figures |= risk_metrics(risk)
    figures |= level_metrics(run)
    return figures
