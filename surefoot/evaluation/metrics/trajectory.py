"""Errors of a trajectory: without alignment, after alignment, and relative (RPE).

The formulas are those of the evo package, so that figures can be compared with published ones.

Source: Umeyama 1991 (alignment); Sturm et al. 2012 (ATE, RPE).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from ...results.tables import Trajectory
from .averages import rms

MAX_DIFFERENCE_S = 0.01  # as evo: stamps further apart do not match
# ours: true positions that spread less across their main direction leave the rotation to errors of millimetres
LEAST_SPREAD_M = 0.10


@dataclass(frozen=True)
class Alignment:
    """`reference = scale * rotation @ estimate + translation`, in two or three dimensions."""

    rotation: Float[np.ndarray, "d d"]
    translation: Float[np.ndarray, "d"]
    scale: float

    def apply(self, points: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "n d"]:
        """Points of the estimate in the frame of the reference, m."""
        return np.asarray(self.scale * points @ self.rotation.T + self.translation)


def associate(
    stamps: Float[np.ndarray, "n"],
    others: Float[np.ndarray, "m"],
    max_difference_s: float = MAX_DIFFERENCE_S,
) -> tuple[Int[np.ndarray, "k"], Int[np.ndarray, "k"]]:
    """Match stamps: each stamp of the shorter series with the nearest stamp of the other.

    Args:
        stamps, others: Increasing, s.
        max_difference_s: Largest difference of a pair.

    Returns:
        Indices into `stamps` and into `others`, in order of time.
    """
    if len(stamps) > len(others):
        second, first = associate(others, stamps, max_difference_s)
        return first, second
    if len(stamps) == 0:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    after = np.clip(np.searchsorted(others, stamps), 1, max(len(others) - 1, 1))
    before = after - 1
    after = np.minimum(after, len(others) - 1)
    nearest = np.where(
        np.abs(others[before] - stamps) <= np.abs(others[after] - stamps), before, after
    )
    first = np.flatnonzero(np.abs(others[nearest] - stamps) <= max_difference_s)
    return first, nearest[first]


def align(
    estimate: Float[np.ndarray, "n d"],
    reference: Float[np.ndarray, "n d"],
    with_scale: bool = False,
) -> Alignment | None:
    """Least-squares rigid (or similarity) transform from the estimate to the reference.

    Returns:
        None if the points do not determine it: fewer than d points, or collinear points in space (coincident
        points in the plane).

    Source: Umeyama 1991, eq. (34)-(43).
    """
    n, d = estimate.shape
    if n < d:
        return None
    mean_estimate, mean_reference = estimate.mean(axis=0), reference.mean(axis=0)
    centred_estimate, centred_reference = estimate - mean_estimate, reference - mean_reference
    u, singular, vt = np.linalg.svd(centred_reference.T @ centred_estimate / n)
    if np.count_nonzero(singular > 1e-12 * max(singular[0], 1e-300)) < d - 1 or singular[0] == 0.0:
        return None
    signs = np.ones(d)
    if np.linalg.det(u) * np.linalg.det(vt) < 0.0:
        signs[-1] = -1.0
    rotation = u @ np.diag(signs) @ vt
    scale = 1.0
    if with_scale:
        scale = float(singular @ signs / np.mean(np.sum(centred_estimate**2, axis=1)))
    return Alignment(rotation, mean_reference - scale * rotation @ mean_estimate, scale)


def alignment_of(estimate: Trajectory, reference: Trajectory) -> Alignment | None:
    """Rigid transform between two trajectories at matching stamps; None if it is not determined."""
    mine, theirs = associate(estimate.stamps, reference.stamps)
    return align(estimate.positions[mine], reference.positions[theirs])


def distances(
    estimate: Float[np.ndarray, "n d"], reference: Float[np.ndarray, "n d"]
) -> Float[np.ndarray, "n"]:
    """Distance of each pair of points, m; their RMS after alignment is the ATE."""
    return np.asarray(np.linalg.norm(estimate - reference, axis=1))


def wrapped(angles_rad: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    """Angles wrapped to [-pi, pi)."""
    return np.asarray((angles_rad + np.pi) % (2 * np.pi) - np.pi)


def pairs_apart(
    stamps: Float[np.ndarray, "n"], seconds: float
) -> tuple[Int[np.ndarray, "k"], Int[np.ndarray, "k"]]:
    """Each index with the first index at least `seconds` later."""
    later = np.searchsorted(stamps, stamps + seconds - 1e-9)
    first = np.flatnonzero(later < len(stamps))
    return first, later[first]


def relative_errors(
    estimate: Trajectory,
    reference: Trajectory,
    pairs: tuple[Int[np.ndarray, "k"], Int[np.ndarray, "k"]],
) -> tuple[Float[np.ndarray, "k"], Float[np.ndarray, "k"]]:
    """Relative pose error (RPE) of pairs of instants.

    Args:
        estimate, reference: Poses at the same instants.
        pairs: Indices of the first and of the second instant.

    Returns:
        Translation in m and rotation angle in rad of (Q_i^-1 Q_j)^-1 (P_i^-1 P_j) of each pair.

    Source: Sturm et al. 2012, eq. (1).
    """
    moved_estimate, turned_estimate = _motions(estimate, pairs)
    moved_reference, turned_reference = _motions(reference, pairs)
    back = turned_reference.inv()
    translation = np.linalg.norm(back.apply(moved_estimate - moved_reference), axis=1)
    return np.asarray(translation), np.asarray((back * turned_estimate).magnitude())


def _motions(
    trajectory: Trajectory, pairs: tuple[Int[np.ndarray, "k"], Int[np.ndarray, "k"]]
) -> tuple[Float[np.ndarray, "k 3"], Rotation]:
    first, second = pairs
    turn_first = Rotation.from_quat(trajectory.quats_xyzw[first])
    turn_second = Rotation.from_quat(trajectory.quats_xyzw[second])
    moved = turn_first.inv().apply(trajectory.positions[second] - trajectory.positions[first])
    return moved, turn_first.inv() * turn_second


def pick(trajectory: Trajectory, chosen: Int[np.ndarray, "k"]) -> Trajectory:
    """The poses at some indices."""
    return Trajectory(
        trajectory.stamps[chosen], trajectory.positions[chosen], trajectory.quats_xyzw[chosen]
    )


def trajectory_metrics(estimate: Trajectory, reference: Trajectory) -> dict[str, float]:
    """Figures of a trajectory against the truth; empty if no stamps match.

    Returns:
        Without alignment: position_rmse_m, position_max_m, heading_rmse_deg and heading_max_deg in the
        horizontal plane, position_rmse_3d_m in space. After rigid alignment: ate_m (also with _mean, _median, _std,
        _min, _max before the unit, and ate_sse_m2), ate_deg (rotation, see
        `rotation_errors`). After alignment with scale: ate_scaled_m,
        scale. After planar alignment: ate_floor_m. Relative errors over one
        second: rpe_1s_m, rpe_1s_deg. Number of pairs: matched_poses. A figure whose alignment is not
        determined is absent.
    """
    mine, theirs = associate(estimate.stamps, reference.stamps)
    if len(mine) == 0:
        return {}
    estimate, reference = pick(estimate, mine), pick(reference, theirs)
    p, q = estimate.positions, reference.positions
    yaw_errors = wrapped(estimate.yaws - reference.yaws)
    figures = {
        "matched_poses": float(len(mine)),
        "position_rmse_m": rms(distances(p[:, :2], q[:, :2])),
        "position_max_m": float(np.max(distances(p[:, :2], q[:, :2]))),
        "heading_rmse_deg": float(np.degrees(rms(yaw_errors))),
        "heading_max_deg": float(np.degrees(np.max(np.abs(yaw_errors)))),
        "position_rmse_3d_m": rms(distances(p, q)),
    }
    for name, d, scaled in (
        ("ate_m", 3, False),
        ("ate_scaled_m", 3, True),
        ("ate_floor_m", 2, False),
    ):
        alignment = align(p[:, :d], q[:, :d], scaled)
        if alignment is None:
            continue
        left = distances(alignment.apply(p[:, :d]), q[:, :d])
        figures[name] = rms(left)
        if scaled:
            figures["scale"] = alignment.scale
        elif d == 3:
            figures |= _spread_of(left)
            figures["ate_deg"] = float(
                np.degrees(rms(rotation_errors(estimate, reference, alignment)))
            )
    pairs = pairs_apart(estimate.stamps, 1.0)
    if len(pairs[0]):
        lengths, angles = relative_errors(estimate, reference, pairs)
        figures["rpe_1s_m"], figures["rpe_1s_deg"] = rms(lengths), float(np.degrees(rms(angles)))
    return figures


def rotation_errors(
    estimate: Trajectory, reference: Trajectory, alignment: Alignment
) -> Float[np.ndarray, "n"]:
    """Angles between the orientations after alignment, rad.

    The trajectory is turned by the alignment of positions, as evo does. A camera that moves along a line or hardly
    at all does not determine that turn: where the second principal standard deviation of the true positions is
    below `LEAST_SPREAD_M`, it is turned by the mean rotation between the orientations instead.

    Args:
        estimate, reference: Poses at the same instants.
        alignment: Of the positions.
    """
    mine, theirs = (Rotation.from_quat(one.quats_xyzw) for one in (estimate, reference))
    centred = reference.positions - reference.positions.mean(axis=0)
    spread = np.linalg.svd(centred, compute_uv=False)[1] / np.sqrt(len(centred))
    turn = Rotation.from_matrix(alignment.rotation)
    if spread < LEAST_SPREAD_M:
        turn = (theirs * mine.inv()).mean()
    return np.asarray((theirs.inv() * turn * mine).magnitude())


def _spread_of(lengths: Float[np.ndarray, "n"]) -> dict[str, float]:
    """The other statistics that evo prints."""
    return {
        "ate_mean_m": float(np.mean(lengths)),
        "ate_median_m": float(np.median(lengths)),
        "ate_std_m": float(np.std(lengths)),
        "ate_min_m": float(np.min(lengths)),
        "ate_max_m": float(np.max(lengths)),
        "ate_sse_m2": float(np.sum(np.square(lengths))),
    }
