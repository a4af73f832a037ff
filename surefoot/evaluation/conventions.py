"""Whether a trajectory was written by another convention, or clock, than it was read by, as the truth tells.

Estimate and truth may be of bodies that are rotated against each other, and have axes of their own. Once positions are
aligned, the rotation between the bodies is constant, whatever it is; quaternions whose order is wrong make it vary. Clocks that
differ make it vary with the rate of turn.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from ..results.tables import Trajectory
from .foreign_trajectory import EUROC, TUM, ForeignTrajectory
from .metrics.averages import rms
from .metrics.trajectory import LEAST_SPREAD_M, Alignment, align, distances

QUARTERS = 4  # ours: parts of a trajectory that must agree on the offset of the clocks
LEAST_POSES = 40  # ours: for that
TURNS = 10  # ours: alternations of that
ENOUGH_POSES = 10_000  # ours: for axes and body; the fit that follows corrects both
FITS = 0.85  # ours: share of the varying rotation that an offset of the clocks leaves at most
CLEARLY = 3.0  # F test of two variances of 15 degrees of freedom each, five poses, at .9999


def doubt(
    estimate: ForeignTrajectory, truth: ForeignTrajectory, found: Trajectory, true: Trajectory
) -> str:
    """What is wrong with the convention of one of the files, and what to do; empty if nothing is.

    Args:
        estimate, truth: The files.
        found, true: Their poses at the same instants.
    """
    aligned = align(found.positions, true.positions)
    spread = np.linalg.svd(true.positions - true.positions.mean(axis=0), compute_uv=False)
    if aligned is None or spread[1] < LEAST_SPREAD_M * len(found) ** 0.5:
        return ""
    error_m = _error_m(found.positions, true.positions)
    for file, mine, theirs in (
        (estimate, _inverted(found), true.positions),
        (truth, found.positions, _inverted(true)),
    ):
        if not file.has_rotations:
            continue
        inverted_m = _error_m(mine, theirs)
        if CLEARLY * inverted_m < error_m:
            return (
                f"{file.source} may hold world-to-camera poses: with their inverses the ATE is {inverted_m:.3f} m, not "
                f"{error_m:.3f} m. Poses of the body in the world were expected; invert them"
            )
    mirrored_m = _error_m(found.positions * [1.0, 1.0, -1.0], true.positions)
    if CLEARLY * mirrored_m < error_m:
        return (
            f"{estimate.source} or {truth.source} may have left-handed axes: mirrored, the ATE is {mirrored_m:.3f} m, not "
            f"{error_m:.3f} m. Change the sign of one axis, and the rotations with it"
        )
    return _order(estimate, truth, found, true, aligned)


def scale_doubt(found: Trajectory, true: Trajectory) -> str:
    """How much larger or smaller the estimate is than the truth, if that is most of its error; else empty."""
    rigid, scaled = (align(found.positions, true.positions, k) for k in (False, True))
    if rigid is None or scaled is None or scaled.scale <= 0.0:
        return ""
    error_m, left_m = (
        rms(distances(one.apply(found.positions), true.positions)) for one in (rigid, scaled)
    )
    if CLEARLY * left_m > error_m:
        return ""
    return (
        f"the scale of the estimate: with positions times {scaled.scale:.4g} the ATE is {left_m:.3f} m, not {error_m:.3f} m. "
        "One camera does not measure the scale: multiply positions and their standard deviations by it. "
        "Of any other system it is an error"
    )


def clock_doubt(
    estimate: ForeignTrajectory, truth: ForeignTrajectory, found: Trajectory, true: Trajectory
) -> str:
    """By how much the clocks seem to differ; empty if that explains little.

    The rotation between the bodies then varies with the rate of turn, alike in all parts of the trajectory.

    Args:
        estimate, truth: The files.
        found, true: Their poses at the same instants.

    Source: ours.
    """
    whole = all(file.has_stamps and file.has_rotations for file in (estimate, truth))
    if not whole or len(true) < LEAST_POSES:
        return ""
    mine, turned = (Rotation.from_quat(one.quats_xyzw) for one in (found, true))
    seconds = (true.stamps[2:] - true.stamps[:-2])[:, None]
    rate = (turned[:-2].inv() * turned[2:]).as_rotvec() / seconds
    body = Rotation.identity()
    few, few_turned = (one[:: 1 + len(true) // ENOUGH_POSES] for one in (mine, turned))
    for _ in range(TURNS):  # the axes, and the bodies in them
        axes = (few_turned * body.inv() * few.inv()).mean()
        body = ((axes * few).inv() * few_turned).mean()
    rest = (body.inv() * (axes * mine).inv() * turned).as_rotvec()[1:-1].ravel()
    small = np.concatenate(
        [np.tile(np.eye(3), (len(rate), 1, 1)), turned[1:-1].inv().as_matrix()], 2
    )
    known = small.reshape(-1, 6)  # what small errors of body and axes would make of it
    late = np.column_stack([known, rate.ravel()])
    fits = [np.linalg.lstsq(one, rest, rcond=1e-6)[0] for one in (known, late)]
    left = [(rest - one @ fit).reshape(-1, 3) for one, fit in zip((known, late), fits, strict=True)]
    before, after = (rms(np.linalg.norm(one, axis=1)) for one in left)
    parts = [[float(np.sum(part**2)) for part in np.array_split(one, QUARTERS)] for one in left]
    if after > FITS * before or np.any(np.greater(parts[1], parts[0])):
        return ""
    late_s = float(fits[1][-1])
    return (
        f"the clock of {truth.source}: if its stamps were {1e3 * abs(late_s):.0f} ms {'later' if late_s > 0.0 else 'earlier'}, "
        f"rotations would differ by {np.degrees(after):.2f} deg, not {np.degrees(before):.2f} deg. Correct them if the clocks are not the same"
    )


def _order(
    estimate: ForeignTrajectory,
    truth: ForeignTrajectory,
    found: Trajectory,
    true: Trajectory,
    aligned: Alignment,
) -> str:
    """The doubt about quaternions whose scalar part is on the other side."""
    if not (estimate.has_rotations and truth.has_rotations):
        return ""
    read_rad = _varies_rad(aligned, found.quats_xyzw, true.quats_xyzw)
    mine, theirs = _reordered(estimate, found), _reordered(truth, true)
    better = [
        (rad, files)
        for one, other, files in (
            (mine, true.quats_xyzw, (estimate,)),
            (found.quats_xyzw, theirs, (truth,)),
            (mine, theirs, (estimate, truth)),
        )
        if CLEARLY * (rad := _varies_rad(aligned, one, other)) < read_rad
    ]
    if not better:
        return ""
    alone = [files[0] for _, files in better if len(files) == 1]
    words = (" or " if alone else " and ").join(
        f"{file.source} may begin with {'qx' if file.format == EUROC else 'qw'}"
        for file in alone or (estimate, truth)
    )
    return (
        f"the quaternions of {words}: the rotation between the bodies of estimate and truth then varies by "
        f"{np.degrees(min(rad for rad, _ in better)):.1f} deg, not {np.degrees(read_rad):.1f} deg. Reorder them, or name the columns "
        "in a header"
    )


def _error_m(mine: Float[np.ndarray, "n 3"], theirs: Float[np.ndarray, "n 3"]) -> float:
    """ATE; infinite if the alignment is not determined."""
    aligned = align(mine, theirs)
    return math.inf if aligned is None else rms(distances(aligned.apply(mine), theirs))


def _inverted(poses: Trajectory) -> Float[np.ndarray, "n 3"]:
    """Positions of the inverse poses."""
    return -Rotation.from_quat(poses.quats_xyzw).inv().apply(poses.positions)


def _reordered(file: ForeignTrajectory, poses: Trajectory) -> Float[np.ndarray, "n 4"]:
    """The quaternions with the scalar part on the other side; those of matrices, and with names, stay."""
    shift = {TUM: -1, EUROC: 1}.get(file.format, 0)
    return np.roll(poses.quats_xyzw, shift, axis=1)


def _varies_rad(
    aligned: Alignment, mine: Float[np.ndarray, "n 4"], theirs: Float[np.ndarray, "n 4"]
) -> float:
    """By how much the rotation between the bodies varies about its mean, RMS."""
    turned = Rotation.from_matrix(aligned.rotation) * Rotation.from_quat(mine)
    between = turned.inv() * Rotation.from_quat(theirs)
    return rms(np.asarray((between.mean().inv() * between).magnitude()))
