"""How far each pose of a graph may be off from where the graph's first pose has it.

Where a recording without poses begins, and which way is ahead there, is a convention, not a measurement; and
what is up, nobody tells an evaluation whose truth has other axes. So the claim that can be held against a truth
is about the motion since the first pose. It takes the covariance of two poses together, which the marginals of
the graph do not give: the factors are linearised once more at the solution, and for each pose one column of the
inverse is solved for.

Source: Dellaert and Kaess (2006), section 3 (square root SAM); the choice of gauge is ours.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from scipy import sparse
from scipy.sparse.linalg import splu

from ..localisation.factors import Factor, FloorSeen, LoopClosure, Motion, turned_covariance
from ..primitives.errors import InputError
from ..primitives.pose import Pose3

HUBER = 1.345  # as the graph weighs floors
FREE = 1e6  # information that holds the first pose; any does, for only differences are asked for


def cross(v: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """The matrix of the cross product with v from the left."""
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def carried(arm: Float[np.ndarray, "3"]) -> Float[np.ndarray, "6 6"]:
    """How an error of a pose shows at a place that hangs on it: a turn moves what is an arm away."""
    lever = np.eye(6)
    lever[:3, 3:] = -cross(arm)
    return lever


def joined(
    before: Float[np.ndarray, "6 6"],
    reference: Pose3,
    motion: Pose3,
    step: Float[np.ndarray, "6 6"],
) -> Float[np.ndarray, "6 6"]:
    """Covariance after one more step.

    Args:
        before: Of the reference, world axes, m and rad.
        reference: T_world_reference.
        motion: T_reference_camera.
        step: Covariance of `motion`, axes of the reference.

    Returns:
        Of the camera, (x, y, z, rotation vector), world axes.
    """
    lever = carried(reference.rotation @ motion.position)
    whole = lever @ before @ lever.T + turned_covariance(step, reference.rotation)
    return np.asarray((whole + whole.T) / 2.0)


def relative_covariances(
    factors: Sequence[Factor], poses: Mapping[int, Pose3]
) -> dict[int, Float[np.ndarray, "6 6"]]:
    """Covariance of every pose given where the first one is.

    Args:
        factors: Motions and closures in space, floors; those that were rejected left out.
        poses: T_world_body by number, the solution of the factors.

    Returns:
        By number, of (x, y, z, rotation vector), world axes, m and rad; zero for the first pose.

    Raises:
        InputError: The factors do not tie every pose to the first.
    """
    numbers = sorted(poses)
    at = {number: 6 * i for i, number in enumerate(numbers)}
    entries = _Information(6 * len(numbers))
    entries.add([0], FREE * np.eye(6))
    for factor in factors:
        if isinstance(factor, (Motion, LoopClosure)):
            entries.add([at[factor.before], at[factor.after]], _between(factor, poses))
        elif isinstance(factor, FloorSeen):
            entries.add([at[factor.pose]], _floor(factor, poses[factor.pose]))
    try:
        inverse = splu(entries.matrix())
    except RuntimeError as error:
        raise InputError(
            f"claims: the factors do not tie every pose to pose {numbers[0]} ({error})"
        ) from error
    first = poses[numbers[0]]
    claimed = {numbers[0]: np.zeros((6, 6))}
    for number in numbers[1:]:
        change = np.zeros(
            (6 * len(numbers), 6)
        )  # of this pose less what the first one's error explains
        change[at[number] : at[number] + 6] = np.eye(6)
        change[:6] = -carried(poses[number].position - first.position).T
        covariance = change.T @ inverse.solve(change)
        claimed[number] = np.asarray((covariance + covariance.T) / 2.0)
    return claimed


class _Information:
    """A sparse sum of blocks."""

    def __init__(self, size: int) -> None:
        self._size = size
        self._rows: list[np.ndarray] = []
        self._columns: list[np.ndarray] = []
        self._values: list[np.ndarray] = []

    def add(self, at: Sequence[int], block: Float[np.ndarray, "n n"]) -> None:
        """Add a block whose rows and columns belong to the variables that begin there."""
        index = np.concatenate([np.arange(start, start + 6) for start in at])
        rows, columns = np.meshgrid(index, index, indexing="ij")
        self._rows.append(rows.ravel())
        self._columns.append(columns.ravel())
        self._values.append(block.ravel())

    def matrix(self) -> sparse.csc_matrix:
        """The sum."""
        where = (np.concatenate(self._rows), np.concatenate(self._columns))
        values = np.concatenate(self._values)
        return sparse.coo_matrix((values, where), shape=(self._size, self._size)).tocsc()


def _between(
    factor: Motion | LoopClosure, poses: Mapping[int, Pose3]
) -> Float[np.ndarray, "12 12"]:
    """Information of errors (before, after), world axes."""
    before = poses[factor.before]
    information = np.linalg.inv(turned_covariance(factor.covariance, before.rotation))
    arm = poses[factor.after].position - before.position
    jacobian = np.hstack([-carried(arm), np.eye(6)])
    return np.asarray(jacobian.T @ information @ jacobian)


def _floor(factor: FloorSeen, pose: Pose3) -> Float[np.ndarray, "6 6"]:
    """Information of a pose's error by the floor z = 0, weighed as its loss does."""
    up = np.array([0.0, 0.0, 1.0])
    plane = factor.plane
    jacobian = np.zeros((3, 6))
    for i, tangent in enumerate(plane.tangents):
        jacobian[i, 3:] = np.cross(pose.rotation @ tangent, up)
    jacobian[2, 2] = 1.0
    tilt = plane.tangents @ pose.rotation.T @ up
    missing = np.array([tilt[0], tilt[1], pose.position[2] - plane.offset_m])
    information = np.linalg.inv(plane.covariance)
    size = math.sqrt(float(missing @ information @ missing))
    weight = 1.0 if size <= HUBER else HUBER / size
    return np.asarray(weight * jacobian.T @ information @ jacobian)
