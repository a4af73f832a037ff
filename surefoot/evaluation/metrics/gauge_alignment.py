"""Is a way without poses as good as it claims? Errors and covariances after one motion of the whole is free.

The truth of such a recording has axes of its own, so the whole way may be laid over it first. What then is left
is less than the errors were, most where the way is long beside its errors; the claim that it is held against
has lost the same motion. A truth whose body is turned against the camera cannot be held against the claims of
poses; that is found out first.

Source: Baarda (1973) (covariances after a change of gauge); Bar-Shalom et al. 2001, section 5.4 (NEES).
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from perception.floor.levelling import UP, rotation_between
from perception.odometry.pose_uncertainty import TURN_M, rigid_alignment

from ...results.tables import Table, Trajectory
from .consistency import consistency_metrics, whitened
from .trajectory import associate, wrapped

SPACE = ("x", "y", "z", "turn_x", "turn_y", "turn_z")
FLOOR = ("x", "y", "yaw")
ROUNDS = 20  # of Gauss-Newton; three do
TOLD = ("anees", "anees_low", "anees_high", "consistent")
TURNED_DEG = 10.0  # ours: a body turned by more is another body than the camera
TELLING_RAD = 0.05  # ours: turns must be so large, about two axes, to tell how the body is turned


def errors_in_space(estimate: Trajectory, true: Trajectory) -> Float[np.ndarray, "n 6"]:
    """What is left of (x, y, z, rotation vector) after the best motion of the truth.

    Args:
        estimate, true: Pose by pose at the same instants, each in its own axes.

    Returns:
        Axes of the estimate, m and rad.
    """
    best = rigid_alignment(estimate.positions)[1]
    centre = estimate.positions.mean(axis=0)
    turns = Rotation.from_quat(estimate.quats_xyzw)
    there = Rotation.from_quat(true.quats_xyzw)
    turn = turns[0] * there[0].inv()
    shift = centre - turn.apply(true.positions).mean(axis=0)
    errors = np.zeros((len(estimate), 6))
    for _ in range(ROUNDS):
        errors[:, :3] = estimate.positions - turn.apply(true.positions) - shift
        errors[:, 3:] = (turns * (turn * there).inv()).as_rotvec()
        motion = np.einsum("nij,nj->i", best, errors)
        more = Rotation.from_rotvec(motion[3:])
        turn, shift = more * turn, more.apply(shift - centre) + centre + motion[:3]
        if np.linalg.norm(motion) < 1e-12:
            break
    return errors


def errors_on_floor(
    estimate: Float[np.ndarray, "n 3"], true: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 3"]:
    """What is left of (x, y, yaw) after the best motion of the truth on the floor, m and rad."""
    best = floor_gauge(estimate[:, :2])[1]
    centre = estimate[:, :2].mean(axis=0)
    angle = float(wrapped(estimate[:1, 2] - true[:1, 2])[0])
    shift = centre - (_turn(angle) @ true[:, :2].T).mean(axis=1)
    errors = np.zeros((len(estimate), 3))
    for _ in range(ROUNDS):
        errors[:, :2] = estimate[:, :2] - true[:, :2] @ _turn(angle).T - shift
        errors[:, 2] = wrapped(estimate[:, 2] - true[:, 2] - angle)
        motion = np.einsum("nij,nj->i", best, errors)
        angle += float(motion[2])
        shift = _turn(float(motion[2])) @ (shift - centre) + centre + motion[:2]
        if np.linalg.norm(motion) < 1e-12:
            break
    return errors


def floor_gauge(
    positions: Float[np.ndarray, "n 2"],
) -> tuple[Float[np.ndarray, "n 3 3"], Float[np.ndarray, "n 3 3"]]:
    """As `perception.odometry.pose_uncertainty.gauge`, on the floor."""
    moves = np.stack([_carried(arm) for arm in positions - positions.mean(axis=0)])
    weighed = moves.transpose(0, 2, 1) * np.array([1.0, 1.0, TURN_M**2])
    return moves, np.linalg.solve(np.einsum("nij,njk->ik", weighed, moves), weighed)


def aligned_on_floor(
    positions: Float[np.ndarray, "n 2"], covariances: Float[np.ndarray, "n 3 3"]
) -> Float[np.ndarray, "n 3 3"]:
    """Covariances of an odometry after the best motion of its whole way.

    Args:
        positions: Of the poses, m.
        covariances: Of (x, y, yaw), given the start. Two poses are taken to share all of the error of the surer
            one: errors of steps are new, and a pose that hangs on an old one has the error of that.
    """
    back = np.stack([_carried(-position) for position in positions])
    walked = back @ covariances @ back.transpose(0, 2, 1)  # said at one place, errors only grow
    order = np.argsort(np.trace(walked, axis1=1, axis2=2), kind="stable")
    positions, covariances, walked = positions[order], covariances[order], walked[order]
    moves, best = floor_gauge(positions)
    carry = np.stack([_carried(position) for position in positions])
    parts = best @ carry  # of those in the best motion
    until = np.cumsum(walked @ parts.transpose(0, 2, 1), axis=0)
    later = np.cumsum(parts[::-1], axis=0)[::-1] - parts
    shared = until + walked @ later.transpose(0, 2, 1)
    common = np.einsum("nij,njk->ik", parts, shared)
    left = np.empty_like(covariances)
    for i, (A, C) in enumerate(zip(moves, carry, strict=True)):
        with_common = C @ shared[i]
        one = covariances[i] - A @ with_common.T - with_common @ A.T + A @ common @ A.T
        left[order[i]] = (one + one.T) / 2.0
    return left


def up_in_truth(floors: Table, true: Trajectory) -> Float[np.ndarray, "3"] | None:
    """What is up in the world of the truth, by all the floors that its camera saw: unit, None if it saw none.

    Args:
        floors: A run's floor.csv.
        true: T_world_camera.
    """
    seen = np.array([word == "seen" for word in floors.words("state")], dtype=bool)
    stamps, normals = floors.numbers("stamp_s")[seen], floors.matrix("nx", "ny", "nz")[seen]
    order = np.argsort(stamps, kind="stable")
    mine, theirs = associate(stamps[order], true.stamps)
    if len(mine) == 0:
        return None
    ups = Rotation.from_quat(true.quats_xyzw[theirs]).apply(normals[order][mine])
    middle = np.median(
        ups, axis=0
    )  # a table taken for the floor is level as well, a wall is outvoted
    size = float(np.linalg.norm(middle))
    return middle / size if size > 0.5 else None


def standing(true: Trajectory, up: Float[np.ndarray, "3"]) -> Float[np.ndarray, "n 3"]:
    """(x, y, heading of the optical axis) of a camera, in an upright frame whose heading is of no account.

    Args:
        true: T_world_camera, any world.
        up: Unit, in that world.
    """
    upright = rotation_between(up, UP)
    ahead = Rotation.from_quat(true.quats_xyzw).apply(np.array([0.0, 0.0, 1.0])) @ upright.T
    headings = np.arctan2(ahead[:, 1], ahead[:, 0])
    return np.column_stack([(true.positions @ upright.T)[:, :2], headings])


def body_turn_deg(estimate: Trajectory, true: Trajectory) -> float | None:
    """By how much the body of the truth is turned against that of the estimate; None if the way does not tell."""
    turns = Rotation.from_quat(estimate.quats_xyzw)
    there = Rotation.from_quat(true.quats_xyzw)
    mine = (turns[0].inv() * turns).as_rotvec()
    others = (there[0].inv() * there).as_rotvec()
    u, size, vt = np.linalg.svd(mine.T @ others)
    if size[1] < len(mine) * TELLING_RAD**2:
        return None
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(u) * np.linalg.det(vt))])
    return float(np.degrees(Rotation.from_matrix((u * signs) @ vt).magnitude()))


def claim_metrics(
    errors: Float[np.ndarray, "n k"],
    covariances: Float[np.ndarray, "n k k"],
    truth_sigma: tuple[float, float] = (0.0, 0.0),
) -> dict[str, float | bool]:
    """Figures of aligned errors against aligned claims.

    Args:
        errors: Of (x, y, yaw) or (x, y, z, rotation vector), m and rad.
        covariances: Claimed.
        truth_sigma: Deviations of the truth itself, m and rad; it is no better than its own makers say.

    Returns:
        Those of `consistency_metrics` for all degrees of freedom together, prefix pose; pose_dof, how many;
        pose_variance_ratio, mean NEES by degree of freedom: 1 if honest, 4 if deviations are twice as
        large as claimed. And mean NEES, its band and verdict of every degree by itself, 1 if honest:
        pose_x_anees, ..., pose_yaw_anees or pose_turn_z_anees.
    """
    dof = errors.shape[1]
    names, lengths = (FLOOR, 2) if dof == 3 else (SPACE, 3)
    own = np.array([truth_sigma[0]] * lengths + [truth_sigma[1]] * (dof - lengths))
    claimed = covariances + np.diag(own**2)
    whole = whitened(errors, claimed)
    figures = {"pose_dof": float(dof), **consistency_metrics(whole, "pose")}
    if "pose_anees" in figures:
        figures["pose_variance_ratio"] = figures["pose_anees"] / dof
    variances = np.diagonal(claimed, axis1=1, axis2=2)
    for i, name in enumerate(names):
        alone = whitened(errors[:, i : i + 1], variances[:, i, np.newaxis, np.newaxis])
        told = consistency_metrics(alone, f"pose_{name}")
        figures |= {key: told[key] for key in (f"pose_{name}_{one}" for one in TOLD) if key in told}
    return figures


def _carried(arm: Float[np.ndarray, "2"]) -> Float[np.ndarray, "3 3"]:
    return np.array([[1.0, 0.0, -arm[1]], [0.0, 1.0, arm[0]], [0.0, 0.0, 1.0]])


def _turn(angle_rad: float) -> Float[np.ndarray, "2 2"]:
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[c, -s], [s, c]])
