"""Covariances of a trajectory without absolute poses, relative to its start and after alignment.

The origin, heading and height of such a trajectory are conventions, so its covariance depends on the gauge.
`from_start` is the covariance of the motion since the first pose, which a user of the map needs. `aligned` is
that of the error left after a least-squares rigid alignment with ground truth, which an evaluation needs. Both
require covariances between poses, which the marginals of the graph do not give: the factors are linearised
again at the solution, and one column of the inverse is solved for each pose.

Lens and depth distortion are the same wherever a scene is seen in the same way: aligned images agree to 3 mm and
0.1 deg, while their trajectory errs by 4 to 25 mm and 0.3 to 1.1 deg (three recordings). The graph cannot observe
this error; `view_errors` adds it.

Source: Dellaert and Kaess (2006), section 3 (square root SAM); Baarda (1973) (covariance of a free network after
a change of gauge).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy import sparse
from scipy.sparse.linalg import splu

from ..primitives.errors import InputError
from ..primitives.gaussian import Gaussian
from ..primitives.pose import Pose3
from ..smoothing.factors import WIDTHS, Factor, FloorSeen, LoopClosure, Motion, turned_covariance

LOOSE = 0.1  # m and rad: standard deviation of the first pose; it cancels, so any loose value does
EXACT = 1e-4  # ours: m and rad; standard deviation of the first pose, which defines the map frame
TURN_M = 1.0  # ours: arm that converts rotations to translations


def cross(v: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """Matrix of the cross product v x."""
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def error_transport(arm: Float[np.ndarray, "3"]) -> Float[np.ndarray, "6 6"]:
    """Maps the error of a pose to the error at a point rigidly attached to it, `arm` away."""
    lever = np.eye(6)
    lever[:3, 3:] = -cross(arm)
    return lever


def compounded(
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
    lever = error_transport(reference.rotation @ motion.position)
    whole = lever @ before @ lever.T + turned_covariance(step, reference.rotation)
    return np.asarray((whole + whole.T) / 2.0)


def planar_gaussian(pose: Pose3, covariance: Float[np.ndarray, "6 6"]) -> Gaussian:
    """Project a camera pose to the plane: (x, y, heading of the optical axis) with covariance.

    Args:
        pose: T_map_camera, in an upright map frame.
        covariance: Covariance of (x, y, z, rotation vector), map axes.
    """
    x, y, z = (float(v) for v in pose.rotation[:, 2])
    level = max(x * x + y * y, 1e-6)  # a camera that looks straight down has no heading
    jacobian = np.zeros((3, 6))
    jacobian[0, 0] = jacobian[1, 1] = 1.0
    jacobian[2, 3:] = -x * z / level, -y * z / level, 1.0
    mean = np.array([*pose.position[:2], np.arctan2(y, x)])
    return Gaussian(mean, jacobian @ covariance @ jacobian.T + EXACT**2 * np.eye(3))


@dataclass(frozen=True)
class AttachedImage:
    """An image, and the pose of the graph that it is attached to.

    Args:
        pose: T_world_camera.
        reference: Number of the pose in the graph; its own number if the image is a variable.
        own: Covariance of the errors that no other image shares, those of the step from the reference, in
            its axes.
    """

    pose: Pose3
    reference: int
    own: Float[np.ndarray, "6 6"]


@dataclass(frozen=True)
class PoseUncertainty:
    """Covariances of (x, y, z, rotation vector) of every image, world axes, m and rad.

    Args:
        from_start: Relative to the first image.
        aligned: After the rigid alignment of the whole trajectory, see `rigid_alignment`.
    """

    from_start: Float[np.ndarray, "n 6 6"]
    aligned: Float[np.ndarray, "n 6 6"]


def rigid_alignment(
    positions: Float[np.ndarray, "n 3"],
) -> tuple[Float[np.ndarray, "n 6 6"], Float[np.ndarray, "n 6 6"]]:
    """Jacobians of the least-squares rigid alignment of a trajectory, about its mean position.

    A rotation of one radian weighs as much as a translation of `TURN_M`.

    Args:
        positions: Of the poses, world axes, m.

    Returns:
        A and G: a small rigid motion g moves pose k by A_k g, and g = sum of G_k e_k minimises the weighted squares
        of e_k - A_k g.
    """
    arms = positions - positions.mean(axis=0)
    moves = np.stack([error_transport(arm) for arm in arms])
    weights = np.array([1.0] * 3 + [TURN_M**2] * 3)
    weighed = moves.transpose(0, 2, 1) * weights
    normal = np.einsum("nij,njk->ik", weighed, moves)
    return moves, np.linalg.solve(normal, weighed)


def pose_uncertainty(
    factors: Sequence[Factor], poses: Mapping[int, Pose3], images: Sequence[AttachedImage]
) -> PoseUncertainty:
    """Covariances of all images attached to a solved graph.

    Args:
        factors: Motions and loop closures in space, and floors, without the rejected ones.
        poses: T_world_body by number, the solution of the factors.
        images: The first one defines the start and is a variable of the graph.

    Raises:
        InputError: The factors do not connect the poses.
    """
    graph = _Solved(factors, poses)
    moves, best = rigid_alignment(np.array([one.pose.position for one in images]))
    levers, alone = [], []
    for one in images:
        reference = poses[one.reference]
        levers.append(error_transport(one.pose.position - reference.position))
        alone.append(turned_covariance(one.own, reference.rotation))
    common = graph.columns(
        (one.reference, G @ L) for one, G, L in zip(images, best, levers, strict=True)
    )
    spread = common.own + sum(G @ S @ G.T for G, S in zip(best, alone, strict=True))
    start = graph.columns([(images[0].reference, np.eye(6))])
    covariances = graph.covariances()
    from_start, aligned = [], []
    for i, (one, L, S) in enumerate(zip(images, levers, alone, strict=True)):
        own = L @ covariances[one.reference] @ L.T + S
        since = error_transport(one.pose.position - images[0].pose.position)
        with_start = L @ start.of(one.reference) + (alone[0] if i == 0 else 0.0)
        from_start.append(_less(own, since, with_start, start.own + alone[0]))
        with_common = L @ common.of(one.reference) + S @ best[i].T
        aligned.append(_less(own, moves[i], with_common, spread))
    return PoseUncertainty(np.array(from_start), np.array(aligned))


def _less(own: np.ndarray, A: np.ndarray, shared: np.ndarray, common: np.ndarray) -> np.ndarray:
    """Covariance of e - A c, from those of e, of e with c, and of c."""
    left = own - A @ shared.T - shared @ A.T + A @ common @ A.T
    return np.asarray((left + left.T) / 2.0)


class _Columns:
    """Cross-covariances of all poses with one linear combination of their errors."""

    def __init__(self, at: Mapping[int, int], columns: np.ndarray, own: np.ndarray) -> None:
        self._at, self._columns, self.own = at, columns, own

    def of(self, number: int) -> Float[np.ndarray, "6 6"]:
        """That of one pose."""
        return np.asarray(self._columns[self._at[number] : self._at[number] + 6])


class _Solved:
    """The linearised factors with their factorised information matrix."""

    def __init__(self, factors: Sequence[Factor], poses: Mapping[int, Pose3]) -> None:
        numbers = sorted(poses)
        self._at = {number: 6 * i for i, number in enumerate(numbers)}
        self._size = 6 * len(numbers)
        entries = _Information(self._size)
        entries.add([0], np.eye(6) / LOOSE**2)
        for factor in factors:
            if isinstance(factor, (Motion, LoopClosure)):
                at = [self._at[factor.before], self._at[factor.after]]
                entries.add(at, _between(factor, poses))
            elif isinstance(factor, FloorSeen):
                entries.add([self._at[factor.pose]], _floor(factor, poses[factor.pose]))
        try:
            self._inverse = splu(entries.matrix())
        except RuntimeError as error:
            raise InputError(
                f"pose uncertainty: the factors do not connect every pose to pose {numbers[0]} ({error})"
            ) from error

    def columns(self, parts: Iterable[tuple[int, np.ndarray]]) -> _Columns:
        """Cross-covariances with a sum of parts, each a matrix times the error of a pose."""
        wanted = np.zeros((self._size, 6))
        for number, part in parts:
            wanted[self._at[number] : self._at[number] + 6] += part.T
        columns = self._inverse.solve(wanted)
        return _Columns(self._at, columns, wanted.T @ columns)

    def covariances(self) -> dict[int, Float[np.ndarray, "6 6"]]:
        """Marginal covariance of every pose."""
        return {number: self.columns([(number, np.eye(6))]).own for number in self._at}


class _Information:
    """A sparse sum of blocks."""

    def __init__(self, size: int) -> None:
        self._size = size
        self._rows: list[np.ndarray] = []
        self._columns: list[np.ndarray] = []
        self._values: list[np.ndarray] = []

    def add(self, at: Sequence[int], block: Float[np.ndarray, "n n"]) -> None:
        """Add a block for the variables that begin at these indices."""
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
    """Information about the errors (before, after), world axes."""
    before = poses[factor.before]
    information = np.linalg.inv(turned_covariance(factor.covariance, before.rotation))
    arm = poses[factor.after].position - before.position
    jacobian = np.hstack([-error_transport(arm), np.eye(6)])
    return np.asarray(jacobian.T @ information @ jacobian)


def _floor(factor: FloorSeen, pose: Pose3) -> Float[np.ndarray, "6 6"]:
    """Information about a pose's error by the floor z = 0, with the weight of its robust loss."""
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
    width = WIDTHS["huber"]
    weight = 1.0 if size <= width else width / size
    return np.asarray(weight * jacobian.T @ information @ jacobian)
