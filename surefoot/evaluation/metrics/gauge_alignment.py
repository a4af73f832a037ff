"""Consistency of a trajectory with its own axes: errors and covariances after rigid alignment with the truth.

Alignment removes part of the error, so the covariance that the error is compared with must lose the same part:
it is projected by the same (gauge) transformation. If the truth is the trajectory of a body that is rotated
against the camera, the errors of the poses are meaningless; `body_rotation_deg` detects this.

Source: Baarda (1973) (covariances after a change of gauge); Bar-Shalom et al. 2001, section 5.4 (NEES).
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from perception.floor.levelling import UP, rotation_between
from perception.odometry.pose_uncertainty import TURN_M, rigid_alignment

from ...results.gauge import without_gauge
from ...results.tables import Table, Trajectory
from .consistency import consistency_metrics, whitened
from .trajectory import associate, wrapped

SPACE = ("x", "y", "z", "turn_x", "turn_y", "turn_z")
FLOOR = ("x", "y", "yaw")
ITERATIONS = 20  # of Gauss-Newton; three suffice
PER_COMPONENT = ("anees", "anees_low", "anees_high", "consistent")
MAX_BODY_ROTATION_DEG = 10.0  # ours: beyond this the truth is that of another body than the camera
CLEARLY = 3.0  # ours: how many times less the rotations must differ for that
EXCITATION_RAD = 0.05  # ours: rotation about two axes needed to determine the rotation of the body


def errors_in_space(estimate: Trajectory, true: Trajectory) -> Float[np.ndarray, "n 6"]:
    """Errors of (x, y, z, rotation vector) after the rigid alignment of the truth with the estimate.

    Args:
        estimate, true: Poses at the same instants, each in its own axes.

    Returns:
        In the axes of the estimate, m and rad.
    """
    best = rigid_alignment(estimate.positions)[1]
    centre = estimate.positions.mean(axis=0)
    estimated = Rotation.from_quat(estimate.quats_xyzw)
    reference = Rotation.from_quat(true.quats_xyzw)
    turn = estimated[0] * reference[0].inv()
    shift = centre - turn.apply(true.positions).mean(axis=0)
    errors = np.zeros((len(estimate), 6))
    for _ in range(ITERATIONS):
        errors[:, :3] = estimate.positions - turn.apply(true.positions) - shift
        errors[:, 3:] = (estimated * (turn * reference).inv()).as_rotvec()
        motion = np.einsum("nij,nj->i", best, errors)
        more = Rotation.from_rotvec(motion[3:])
        turn, shift = more * turn, more.apply(shift - centre) + centre + motion[:3]
        if np.linalg.norm(motion) < 1e-12:
            break
    return errors


def errors_on_floor(
    estimate: Float[np.ndarray, "n 3"], true: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 3"]:
    """Errors of (x, y, yaw) after the rigid planar alignment of the truth with the estimate, m and rad."""
    best = floor_gauge(estimate[:, :2])[1]
    centre = estimate[:, :2].mean(axis=0)
    angle = float(wrapped(estimate[:1, 2] - true[:1, 2])[0])
    shift = centre - (_rotation(angle) @ true[:, :2].T).mean(axis=1)
    errors = np.zeros((len(estimate), 3))
    for _ in range(ITERATIONS):
        errors[:, :2] = estimate[:, :2] - true[:, :2] @ _rotation(angle).T - shift
        errors[:, 2] = wrapped(estimate[:, 2] - true[:, 2] - angle)
        motion = np.einsum("nij,nj->i", best, errors)
        angle += float(motion[2])
        shift = _rotation(float(motion[2])) @ (shift - centre) + centre + motion[:2]
        if np.linalg.norm(motion) < 1e-12:
            break
    return errors


def floor_gauge(
    positions: Float[np.ndarray, "n 2"],
) -> tuple[Float[np.ndarray, "n 3 3"], Float[np.ndarray, "n 3 3"]]:
    """The planar counterpart of `perception.odometry.pose_uncertainty.gauge`."""
    moves = floor_transport(positions - positions.mean(axis=0))
    weighed = moves.transpose(0, 2, 1) * np.array([1.0, 1.0, TURN_M**2])
    return moves, np.linalg.solve(np.einsum("nij,njk->ik", weighed, moves), weighed)


def floor_transport(arms: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 3 3"]:
    """The planar counterpart of `perception.odometry.pose_uncertainty.error_transport`, of each arm."""
    lever = np.tile(np.eye(3), (len(arms), 1, 1))
    lever[:, 0, 2], lever[:, 1, 2] = -arms[:, 1], arms[:, 0]
    return lever


def aligned_on_floor(
    positions: Float[np.ndarray, "n 2"], covariances: Float[np.ndarray, "n 3 3"]
) -> Float[np.ndarray, "n 3 3"]:
    """Covariances of an odometry after the rigid alignment of its trajectory.

    Args:
        positions: Positions of the poses, m.
        covariances: Covariances of (x, y, yaw) relative to the start. Two poses are assumed to share the
            whole error of the more certain one, because the errors of odometry steps are independent.
    """
    return without_gauge(*floor_gauge(positions), covariances, floor_transport(positions))


def up_in_truth(floors: Table, true: Trajectory) -> Float[np.ndarray, "3"] | None:
    """Vertical axis in the world of the truth, as the median normal of all floors seen.

    Args:
        floors: Table floor.csv of the run.
        true: T_world_camera.

    Returns:
        Unit vector; None if no floor was seen at a stamp of the truth.
    """
    seen = np.array([word == "seen" for word in floors.words("state")], dtype=bool)
    stamps, normals = floors.numbers("stamp_s")[seen], floors.matrix("nx", "ny", "nz")[seen]
    order = np.argsort(stamps, kind="stable")
    mine, theirs = associate(stamps[order], true.stamps)
    if len(mine) == 0:
        return None
    ups = Rotation.from_quat(true.quats_xyzw[theirs]).apply(normals[order][mine])
    median = np.median(
        ups, axis=0
    )  # robust to a wall; a table mistaken for the floor is level, too
    size = float(np.linalg.norm(median))
    return median / size if size > 0.5 else None


def planar_poses(true: Trajectory, up: Float[np.ndarray, "3"]) -> Float[np.ndarray, "n 3"]:
    """(x, y, heading of the optical axis) of a camera, in an upright frame of arbitrary heading.

    Args:
        true: T_world_camera, in any world frame.
        up: Vertical axis in that world, unit length.
    """
    upright = rotation_between(up, UP)
    ahead = Rotation.from_quat(true.quats_xyzw).apply(np.array([0.0, 0.0, 1.0])) @ upright.T
    headings = np.arctan2(ahead[:, 1], ahead[:, 0])
    return np.column_stack([(true.positions @ upright.T)[:, :2], headings])


def body_rotation_deg(estimate: Trajectory, true: Trajectory) -> float | None:
    """Angle between the body frames of truth and estimate, deg; None if the rotations do not determine it."""
    estimated = Rotation.from_quat(estimate.quats_xyzw)
    reference = Rotation.from_quat(true.quats_xyzw)
    mine = (estimated[0].inv() * estimated).as_rotvec()
    theirs = (reference[0].inv() * reference).as_rotvec()
    u, size, vt = np.linalg.svd(mine.T @ theirs)
    if size[1] < len(mine) * EXCITATION_RAD**2:
        return None
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(u) * np.linalg.det(vt))])
    turn = Rotation.from_matrix((u * signs) @ vt)
    if CLEARLY * np.linalg.norm(mine - turn.apply(theirs)) > np.linalg.norm(mine - theirs):
        return None  # errors of the rotations explain it as well
    return float(np.degrees(turn.magnitude()))


def aligned_consistency(
    errors: Float[np.ndarray, "n k"],
    covariances: Float[np.ndarray, "n k k"],
    truth_sigma: tuple[float, float] = (0.0, 0.0),
) -> dict[str, float | bool]:
    """Consistency figures of aligned errors.

    Args:
        errors: Errors of (x, y, yaw) or (x, y, z, rotation vector), m and rad.
        covariances: Their covariances.
        truth_sigma: Standard deviations of the truth itself, m and rad.

    Returns:
        Figures of `consistency_metrics` for all components together, prefix pose; pose_dof, their number;
        pose_variance_ratio, mean NEES per degree of freedom: 1 if consistent, 4 if errors are twice as large
        as the standard deviations. Mean NEES, its band and verdict of each component, 1 if consistent:
        pose_x_anees, ..., pose_yaw_anees or pose_turn_z_anees.
    """
    dof = errors.shape[1]
    names, lengths = (FLOOR, 2) if dof == 3 else (SPACE, 3)
    own = np.array([truth_sigma[0]] * lengths + [truth_sigma[1]] * (dof - lengths))
    total = covariances + np.diag(own**2)
    whole = whitened(errors, total)
    figures = {"pose_dof": float(dof), **consistency_metrics(whole, "pose")}
    if "pose_anees" in figures:
        figures["pose_variance_ratio"] = figures["pose_anees"] / dof
    variances = np.diagonal(total, axis1=1, axis2=2)
    for i, name in enumerate(names):
        alone = whitened(errors[:, i : i + 1], variances[:, i, np.newaxis, np.newaxis])
        found = consistency_metrics(alone, f"pose_{name}")
        keys = (f"pose_{name}_{figure}" for figure in PER_COMPONENT)
        figures |= {key: found[key] for key in keys if key in found}
    return figures


def _rotation(angle_rad: float) -> Float[np.ndarray, "2 2"]:
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[c, -s], [s, c]])
