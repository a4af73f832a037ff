"""Judges anybody's trajectory: accuracy as evo prints it, and whether the claimed covariances hold.

Errors and covariances are compared after rigid alignment with the truth, both without the part that alignment
removes (see `results.gauge`), or as they stand if the estimate has the axes of the truth.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from perception.filtering.consistency import band, calibration
from perception.primitives.errors import InputError

from ..results.tables import Trajectory
from .conventions import clock_doubt, doubt, scale_doubt
from .foreign_covariance import PLANAR, POSITION, SPACE, Claims, read_claims
from .foreign_trajectory import ForeignTrajectory, pairs, read_trajectory
from .metrics import calibration as scores
from .metrics.averages import rms
from .metrics.consistency import consistency_metrics, effective_samples, squared, whitened
from .metrics.gauge_alignment import (
    MAX_BODY_ROTATION_DEG,
    body_rotation_deg,
    errors_in_space,
    errors_on_floor,
)
from .metrics.trajectory import (
    MAX_DIFFERENCE_S,
    align,
    pick,
    relative_errors,
    trajectory_metrics,
    wrapped,
)

MIN_POSES = 5  # ours: with fewer poses an alignment leaves hardly any error
MOTIONS = 200
"""Number of motions between poses that are judged; each lasts longer than the errors of images are correlated."""
TOGETHER = 120  # poses of which the joint covariance is made
NEARER = 3.0  # ours: how much nearer to 1, as a factor, another convention must bring the sigmas to be named
LIKELIER = 1000.0  # ours: and by what factor it must make the errors likelier
BINS = 5  # of the distance travelled, with equally many poses
COMPONENTS = {
    SPACE: ("x", "y", "z", "turn_x", "turn_y", "turn_z"),
    PLANAR: ("x", "y", "yaw"),
    POSITION: ("x", "y", "z"),
}
_LENGTHS = {SPACE: 3, PLANAR: 2, POSITION: 3}


@dataclass(frozen=True)
class Verdict:
    """Result of `judge`.

    Args:
        metrics: Figures by name, see docs/evaluate.md.
        estimate: The trajectory in the axes of the truth, at the matching stamps.
        truth: The truth at the same stamps.
        errors: Errors of the poses that have a covariance; None without covariances.
        covariances: Theirs, with the covariance of the truth.
        rows: Which of the matching poses these are.
        travelled: Distance travelled until then, m.
    """

    metrics: dict[str, Any]
    estimate: Trajectory
    truth: Trajectory
    errors: Float[np.ndarray, "n k"] | None = None
    covariances: Float[np.ndarray, "n k k"] | None = None
    rows: Int[np.ndarray, "n"] | None = None
    travelled: Float[np.ndarray, "n"] | None = None


def judge_files(
    trajectory: Path,
    covariance: Path | None,
    truth: Path,
    same_axes: bool = False,
    body_axes: bool = False,
    truth_sigma: tuple[float, float] = (0.0, 0.0),
    rotation_first: bool = False,
) -> Verdict:
    """Judge the files of a foreign system.

    Args:
        trajectory: In any format of `foreign_trajectory`.
        covariance: CSV or g2o; None: accuracy only.
        truth: In any of them.
        same_axes: Estimate and truth have the same axes: nothing is aligned.
        body_axes: The covariances are in the axes of each pose.
        truth_sigma: Standard deviations of the truth, m and rad.
        rotation_first: The covariances are over (rotation vector, x, y, z).

    Raises:
        InputError: A file cannot be read, or they do not belong together.
    """
    estimate, true = read_trajectory(trajectory), read_trajectory(truth)
    claims = (
        None if covariance is None else read_claims(covariance, estimate, body_axes, rotation_first)
    )
    return judge(estimate, claims, true, same_axes, truth_sigma)


def judge(
    estimate: ForeignTrajectory,
    claims: Claims | None,
    truth: ForeignTrajectory,
    same_axes: bool = False,
    truth_sigma: tuple[float, float] = (0.0, 0.0),
) -> Verdict:
    """Judge a trajectory; arguments as for `judge_files`."""
    mine, theirs = pairs(estimate, truth)
    bare = [file.source for file in (estimate, truth) if not file.has_rotations]
    if bare and claims is not None:
        claims = claims.of_positions()
    left_out = _left_out(estimate, len(mine), 0 if claims is None else claims.unknown)
    if len(mine) < MIN_POSES:
        raise InputError(
            f"only {len(mine)} of the {estimate.lines} poses of {estimate.source} can be compared"
            f"{f' ({left_out})' * bool(left_out)}; at least {MIN_POSES} are needed"
        )
    found = pick(estimate.poses, mine)
    true = replace(pick(truth.poses, theirs), stamps=found.stamps)
    metrics: dict[str, Any] = {
        "format": estimate.format,
        "truth_format": truth.format,
        "poses": float(estimate.lines),
        **({"left_out": left_out} if left_out else {}),
        **({"without_rotations": " and ".join(bare)} if bare else {}),
        **(position_accuracy if bare else accuracy)(found, true),
    }
    doubtful = doubt(estimate, truth, found, true)
    if words := doubtful or scale_doubt(found, true) or clock_doubt(estimate, truth, found, true):
        metrics["doubt"] = words
    shown = _in_truth(found, true, same_axes)
    if claims is None:
        metrics["note"] = "no covariances given: accuracy only"
        return Verdict(metrics, shown, true)
    rows, chosen = _common(mine, claims)
    if len(rows) < MIN_POSES:
        raise InputError(
            f"only {len(rows)} poses have both a covariance and a true pose; at least {MIN_POSES} are needed"
        )
    errors = errors_of(claims.compared, pick(found, rows), pick(true, rows), same_axes)
    if claims.compared == SPACE and not same_axes:
        _check_body(pick(found, rows), pick(true, rows), doubtful)
    claims = claims.fitting(estimate.poses, chosen)
    lengths = _LENGTHS[claims.compared]
    own = np.diag(
        np.square([truth_sigma[0]] * lengths + [truth_sigma[1]] * (errors.shape[1] - lengths))
    )
    covariances = claims.expected(estimate.poses, chosen, same_axes) + own
    between = claims.between(estimate.poses, chosen, errors, max(1, len(rows) // MOTIONS), own)
    steps = np.linalg.norm(np.diff(true.positions, axis=0), axis=1)
    travelled = np.concatenate([[0.0], np.cumsum(steps)])[rows]
    metrics["covariances"] = (
        "estimate and truth have the same axes: covariances as given" if same_axes else claims.words
    )
    some = np.unique(np.linspace(0, len(chosen) - 1, min(len(chosen), TOGETHER)).astype(np.int64))
    joint = claims.together(estimate.poses, chosen[some], not same_axes)
    known = None if joint is None else _Joint(some, joint)
    metrics |= honesty(errors, covariances, claims.compared, travelled, known)
    metrics |= _in_parts(between, whitened(errors, covariances))
    if metrics["verdict"] == scores.TOO_SURE and "doubt" not in metrics:
        expected = (
            (
                words,
                one.fitting(estimate.poses, chosen).expected(estimate.poses, chosen, same_axes)
                + own,
            )
            for words, one in claims.otherwise(estimate.poses)
        )
        if words := _claims_doubt(
            errors, metrics["pose_anees"], metrics["pose_effective_samples"], expected
        ):
            metrics["doubt"] = words
    return Verdict(metrics, shown, true, errors, covariances, rows, travelled)


def accuracy(estimate: Trajectory, truth: Trajectory) -> dict[str, float]:
    """ATE and RPE as evo prints them, of poses at the same instants.

    `trajectory_metrics`, and the RPE from pose to pose (evo's default): rpe_frame_m, rpe_frame_deg.
    """
    figures = trajectory_metrics(estimate, truth)
    every = np.arange(len(estimate) - 1)
    lengths, angles = relative_errors(estimate, truth, (every, every + 1))
    return figures | {
        "rpe_frame_m": rms(lengths),
        "rpe_frame_deg": float(np.degrees(rms(angles))),
    }


def position_accuracy(estimate: Trajectory, truth: Trajectory) -> dict[str, float]:
    """The figures of `accuracy` that rotations have no part in."""
    figures = trajectory_metrics(estimate, truth)
    return {
        name: value
        for name, value in figures.items()
        if not (name.startswith(("rpe", "heading")) or name.endswith("_deg"))
    }


def errors_of(
    kind: str, estimate: Trajectory, truth: Trajectory, same_axes: bool
) -> Float[np.ndarray, "n k"]:
    """Errors of poses at the same instants, axes of the estimate, after rigid alignment or as they stand."""
    if kind == PLANAR:
        mine, theirs = (
            np.column_stack([one.positions[:, :2], one.yaws]) for one in (estimate, truth)
        )
        if not same_axes:
            return errors_on_floor(mine, theirs)
        return np.column_stack([(mine - theirs)[:, :2], wrapped(mine[:, 2] - theirs[:, 2])])
    if kind == POSITION:
        moved = None if same_axes else align(truth.positions, estimate.positions)
        if moved is None and not same_axes:
            raise InputError(
                "the poses lie on a line, so that positions alone do not determine the alignment; "
                "give 6x6 covariances, or axes that are those of the truth (--same-axes)"
            )
        return estimate.positions - (
            truth.positions if moved is None else moved.apply(truth.positions)
        )
    if not same_axes:
        return errors_in_space(estimate, truth)
    turned = Rotation.from_quat(estimate.quats_xyzw) * Rotation.from_quat(truth.quats_xyzw).inv()
    return np.column_stack([estimate.positions - truth.positions, turned.as_rotvec()])


def honesty(
    errors: Float[np.ndarray, "n k"],
    covariances: Float[np.ndarray, "n k k"],
    kind: str,
    travelled: Float[np.ndarray, "n"],
    joint: _Joint | None = None,
) -> dict[str, Any]:
    """Figures of claimed covariances; a pose whose covariance is zero, such as the first one, is left out.

    Returns:
        `consistency_metrics` with the prefix pose; pose_dof; verdict, factor and sigma_factor; the same of each
        component; crps_m and crps_deg; reliability (levels and shares); by_distance; and `metrics.calibration.by_halves`.
    """
    names, lengths = COMPONENTS[kind], _LENGTHS[kind]
    dof = errors.shape[1]
    white = whitened(errors, covariances)
    usable = np.isfinite(squared(white))
    if np.count_nonzero(usable) < MIN_POSES:
        still = np.median(np.diagonal(covariances, axis1=1, axis2=2), axis=0) <= 0.0
        which = ", ".join(name for name, one in zip(names, still, strict=True) if one)
        raise InputError(
            f"only {np.count_nonzero(usable)} of {len(usable)} covariances are positive definite"
            f"{f' (most have no variance in {which})' * bool(which)}, at least {MIN_POSES} are needed; leave out components "
            "without a variance: 3x3 over (x, y, z), or over (x, y, yaw) with a header"
        )
    figures: dict[str, Any] = {"pose_dof": float(dof), "poses_judged": float(usable.sum())}
    errors, covariances, white = errors[usable], covariances[usable], white[usable]
    every = np.flatnonzero(usable)
    figures |= consistency_metrics(white, "pose")
    figures |= _direction(white, _most(joint, every))
    figures["pose_consistent"] = figures["verdict"] == scores.IN_BAND
    for name in ("anees_low", "anees_high", "effective_samples"):
        figures[f"pose_{name}"] = figures.pop(name)
    sigmas = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    figures["by_component"] = {
        name: _direction((errors[:, i] / sigmas[:, i])[:, None], _most(joint, every, i))
        for i, name in enumerate(names)
    }
    parts = (("m", slice(0, lengths), 1.0), ("deg", slice(lengths, dof), 180.0 / np.pi))
    for unit, part, size in parts:
        if errors[:, part].size:
            score = scores.crps(errors[:, part], sigmas[:, part])
            figures[f"crps_{unit}"] = float(size * score.mean())
    levels, shares = calibration(squared(white), dof)
    figures["reliability"] = {"levels": levels.tolist(), "shares": shares.tolist()}
    figures["by_distance"] = _by_distance(white, travelled[usable], joint, every)
    return figures


def _direction(white: Float[np.ndarray, "n k"], most: float = np.inf) -> dict[str, Any]:
    """Verdict in words, factor, what the sigmas should be multiplied by, and the band behind it.

    Args:
        white: Whitened errors in order of time.
        most: Number of independent samples by the claims themselves.
    """
    dof = white.shape[1]
    mean = float(np.mean(squared(white)))
    effective = min(effective_samples(white), most)
    low, high = band(dof, effective)
    words, factor = scores.verdict(mean, low, high, dof)
    return {
        "verdict": words,
        "factor": factor,
        "sigma_factor": float(np.sqrt(mean / dof)),
        "anees_low": low,
        "anees_high": high,
        "effective_samples": effective,
    }


@dataclass(frozen=True)
class _Joint:
    """Covariance of the errors of some poses together."""

    rows: Int[np.ndarray, "m"]
    covariance: Float[np.ndarray, "m k m k"]


def _most(joint: _Joint | None, rows: Int[np.ndarray, "n"], component: int | None = None) -> float:
    """Number of independent samples among some poses if the claims are exact; infinite if they do not tell.

    The variance of the mean of n squared normalised errors is 2 / n^2 times the squared Frobenius norm of the
    correlation of all of them (Isserlis 1918).
    """
    if joint is None:
        return np.inf
    picked = np.flatnonzero(np.isin(joint.rows, rows))
    whole = joint.covariance[picked][:, :, picked]
    if component is not None:
        whole = whole[:, component : component + 1][:, :, :, component : component + 1]
    n, k = whole.shape[:2]
    if n < 2:
        return np.inf
    blocks = whole[np.arange(n), :, np.arange(n), :]
    values, vectors = np.linalg.eigh(blocks)
    floor = 1e-12 * np.maximum(values[:, -1:], 1e-300)
    white = vectors / np.sqrt(np.maximum(values, floor))[:, None, :]
    correlation = np.einsum("iab,iajc,jcd->ibjd", white, whole, white, optimize=True)
    return float(max(k * n**2 / np.sum(correlation**2), 1.0))


def _in_parts(
    between: tuple[Float[np.ndarray, "j k"], Float[np.ndarray, "j k k"]] | None,
    poses: Float[np.ndarray, "n k"],
) -> dict[str, Any]:
    """Verdict on the motions between poses, and what is fitted on the first half and tested on the second.

    Errors that accumulate are independent from motion to motion, not from pose to pose. Without motions (`between`) the
    whitened errors of the poses are taken.
    """
    figures: dict[str, Any] = {}
    white = poses if between is None else whitened(*between)
    usable = white[np.isfinite(squared(white))]
    if between is not None and len(usable) >= MIN_POSES:
        figures["motions"] = {"number": float(len(usable)), **_direction(usable)}
    return figures | scores.by_halves(usable)


def _by_distance(
    white: Float[np.ndarray, "n k"],
    travelled: Float[np.ndarray, "n"],
    joint: _Joint | None,
    rows: Int[np.ndarray, "n"],
) -> list[dict[str, Any]]:
    """Verdict in each of `BINS` parts of the distance travelled, with equally many poses."""
    parts = np.array_split(np.arange(len(white)), min(BINS, max(1, len(white) // 10)))
    return [
        {
            "from_m": float(travelled[part[0]]),
            "to_m": float(travelled[part[-1]]),
            **_direction(white[part], _most(joint, rows[part])),
        }
        for part in parts
    ]


def _claims_doubt(
    errors: Float[np.ndarray, "n k"],
    anees: float,
    samples: float,
    otherwise: Iterable[tuple[str, Float[np.ndarray, "n k k"]]],
) -> str:
    """The other convention of the covariances by which the mean NEES would be much nearer to exact; empty without one.

    A wrong order or wrong axes leave the determinant, and so make the mean NEES of exact claims larger, never smaller:
    only claims that seem too sure can be those. Few independent samples tell conventions apart by chance, so that the
    likelihoods, each with the sigmas times the best factor, must differ too.
    """
    dof = errors.shape[1]
    best, said = anees, ""
    for words, covariances in otherwise:
        series = squared(whitened(errors, covariances))
        mean = float(np.mean(series[np.isfinite(series)]))
        nearer = NEARER * abs(np.log(mean / dof)) < np.log(anees / dof)
        if mean < best and nearer and samples * dof / 2 * np.log(anees / mean) > np.log(LIKELIER):
            best, said = mean, words
    return said and (
        f"the covariances may {said}: the mean NEES is then {best:.2f}, not {anees:.2f} ({dof} if exact)"
    )


def _left_out(estimate: ForeignTrajectory, used: int, unknown: int) -> str:
    """Why some poses, or covariances, are not compared, in words; empty if all are."""
    same, apart = estimate.lines - estimate.lost - len(estimate.poses), len(estimate.poses) - used
    words = [f"{estimate.lost} are not finite"] if estimate.lost else []
    if same:
        words.append(f"{same} have the stamp of another pose")
    if apart:
        words.append(f"{apart} have no true pose of their own within {MAX_DIFFERENCE_S:g} s")
    if unknown:
        words.append(f"{unknown} covariances are zero, which tells nothing")
    return ", ".join(words)


def _common(
    mine: Int[np.ndarray, "k"], claims: Claims
) -> tuple[Int[np.ndarray, "m"], Int[np.ndarray, "m"]]:
    """Matching poses with a covariance: indices among the matches, and among the claims."""
    chosen = np.minimum(np.searchsorted(claims.rows, mine), len(claims.rows) - 1)
    rows = np.flatnonzero(claims.rows[chosen] == mine)
    return rows, chosen[rows]


def _check_body(estimate: Trajectory, truth: Trajectory, doubtful: str) -> None:
    """Refuse the truth of a body that is rotated against that of the estimate."""
    rotation_deg = body_rotation_deg(estimate, truth)
    if rotation_deg is not None and rotation_deg > MAX_BODY_ROTATION_DEG:
        raise InputError(
            doubtful
            or f"the truth is the trajectory of a body that is rotated by {rotation_deg:.0f} deg against that of the "
            "estimate; give the truth of the same body, or covariances of the positions alone (3x3)"
        )


def _in_truth(estimate: Trajectory, truth: Trajectory, same_axes: bool) -> Trajectory:
    """The estimate in the axes of the truth, for pictures."""
    moved = None if same_axes else align(estimate.positions, truth.positions)
    if moved is None:
        return estimate
    turned = Rotation.from_matrix(moved.rotation) * Rotation.from_quat(estimate.quats_xyzw)
    return Trajectory(estimate.stamps, moved.apply(estimate.positions), turned.as_quat())
