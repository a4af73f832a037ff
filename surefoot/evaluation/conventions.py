"""Whether a trajectory was written by another convention than it was read by, as the truth tells.

Estimate and truth may be of bodies that are rotated against each other, and have axes of their own. Once positions are
aligned, the rotation between the bodies is constant, whatever it is; quaternions whose order is wrong make it vary.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from ..results.tables import Trajectory
from .foreign_trajectory import EUROC, KITTI, TUM, ForeignTrajectory
from .metrics.trajectory import LEAST_SPREAD_M, Alignment, align, distances, rms

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
        inverted_m = _error_m(mine, theirs)
        if CLEARLY * inverted_m < error_m:
            return (
                f"{file.source} may hold world-to-camera poses: with their inverses the ATE is {inverted_m:.3f} m, not "
                f"{error_m:.3f} m. Poses of the body in the world were expected; invert them"
            )
    return _order(estimate, truth, found, true, aligned)


def _order(
    estimate: ForeignTrajectory,
    truth: ForeignTrajectory,
    found: Trajectory,
    true: Trajectory,
    aligned: Alignment,
) -> str:
    """The doubt about quaternions whose scalar part is on the other side."""
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
    """The quaternions with the scalar part on the other side; those of matrices stay."""
    shift = {TUM: -1, EUROC: 1, KITTI: 0}[file.format]
    return np.roll(poses.quats_xyzw, shift, axis=1)


def _varies_rad(
    aligned: Alignment, mine: Float[np.ndarray, "n 4"], theirs: Float[np.ndarray, "n 4"]
) -> float:
    """By how much the rotation between the bodies varies about its mean, RMS."""
    turned = Rotation.from_matrix(aligned.rotation) * Rotation.from_quat(mine)
    between = turned.inv() * Rotation.from_quat(theirs)
    return rms(np.asarray((between.mean().inv() * between).magnitude()))
