"""Joint angles of a leg for a wanted place of its foot, numerically.

Damped Gauss-Newton (Levenberg-Marquardt) from the last solution: the error of the foot's pose, position and rotation vector, is divided by the
geometric Jacobian of the six joints. Angles stay within their ranges. From one frame to the next three or four steps
suffice.

Source: Sugihara 2011, "Solvability-unconcerned inverse kinematics by the Levenberg-Marquardt method": damping by the
squared error, so that a foot out of reach is approached and not missed.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from perception.primitives.kinematics import KinematicTree, link_poses
from perception.primitives.pose import Pose3

DAMPING = 1e-9  # Sugihara: bias, so that a stretched leg stays solvable
STEPS = 60  # ours: a start at the posture needs up to 20
EXACT = 1e-9  # ours: of the error, m and rad
LONGEST_RAD = 0.5  # ours: of one step


def solved(
    tree: KinematicTree,
    angles: Float[np.ndarray, "n"],
    leg: tuple[int, ...],
    foot: Float[np.ndarray, "4 4"],
    wanted: Pose3,
) -> tuple[Float[np.ndarray, "n"], float]:
    """Angles with which a foot is nearest to its wanted pose.

    Args:
        tree: Of n joints.
        angles: To begin with; those of other joints stay, rad.
        leg: Its joints, from the hip down; the last one carries the foot.
        foot: Frame of the foot in the last link.
        wanted: That frame in the frame of the base.

    Returns:
        The angles, and what remains of the error: m and rad, Euclidean.
    """
    found = np.array(angles, dtype=np.float64)
    least = np.array([tree.joints[j].least_rad for j in leg])
    most = np.array([tree.joints[j].most_rad for j in leg])
    chosen = list(leg)
    found[chosen] = np.clip(found[chosen], least, most)
    goal, turned = wanted.position, wanted.rotation
    error = np.inf
    for _ in range(STEPS):
        poses = link_poses(tree, found)
        tip = poses[leg[-1] + 1] @ foot
        miss = np.concatenate([goal - tip[:3, 3], _rotation_vector(turned @ tip[:3, :3].T)])
        error = float(np.linalg.norm(miss))
        if error < EXACT:
            break
        axes = np.stack([poses[j + 1][:3, :3] @ np.array(tree.joints[j].axis) for j in leg])
        arms = tip[:3, 3] - np.stack([poses[j + 1][:3, 3] for j in leg])
        J = np.concatenate([np.cross(axes, arms), axes], axis=1).T
        step = np.linalg.solve(J.T @ J + (error**2 / 2 + DAMPING) * np.eye(len(leg)), J.T @ miss)
        step *= min(1.0, LONGEST_RAD / max(float(np.abs(step).max()), 1e-12))
        found[chosen] = np.clip(found[chosen] + step, least, most)
    return found, error


def bent(tree: KinematicTree, leg: tuple[int, ...]) -> Float[np.ndarray, "k"]:
    """Angles of a leg with a bent knee, from which every stance is found: the middles of the ranges, at most half a rad."""
    middle = [(tree.joints[j].least_rad + tree.joints[j].most_rad) / 2 for j in leg]
    return np.clip(middle, -LONGEST_RAD, LONGEST_RAD)


def _rotation_vector(rotation: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3"]:
    """Axis times angle of a rotation, rad."""
    skew = np.array(
        [
            rotation[2, 1] - rotation[1, 2],
            rotation[0, 2] - rotation[2, 0],
            rotation[1, 0] - rotation[0, 1],
        ]
    )
    sine = float(np.linalg.norm(skew)) / 2
    angle = float(np.arctan2(sine, (np.trace(rotation) - 1.0) / 2.0))
    return skew / 2 if sine < 1e-9 else np.asarray(skew * (angle / (2 * sine)))
