"""What a way without poses claims: how far each pose may be off, once it is said against what.

Where such a recording begins, which way is ahead and how high zero lies is convention, not measurement; a truth
with axes of its own cannot tell it wrong. Two claims can be held against one. From the start: of the motion
since the first pose, as a user of the map asks. Aligned: of what is left when the whole way is laid over the
truth in least squares, as an evaluation does; there no single pose of the truth weighs more than others. Both
take covariances between poses, which the marginals of a graph do not give: the factors are linearised once more
at the solution, and a column of the inverse is solved for each pose.

What lens and depth distort is alike wherever the same things are seen the same way: images that were laid over each
other agree to 3 mm and 0.1 deg, and their way is off by 4 to 25 mm and 0.3 to 1.1 deg (three recordings). No graph
can find that out; each image is given a deviation of its own for it (`BackEndConfig.image_m`).

Source: Dellaert and Kaess (2006), section 3 (square root SAM); Baarda (1973) (a free network's covariance after
a change of its gauge).
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
from ..primitives.pose import Pose3
from ..smoothing.factors import Factor, FloorSeen, LoopClosure, Motion, turned_covariance

HUBER = 1.345  # as the graph weighs floors
LOOSE = 0.1  # m and rad: deviation of the first pose; any does that binds little, for it drops out
TURN_M = 1.0  # ours: a turn counts as what it moves at arm's length


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


@dataclass(frozen=True)
class Hung:
    """An image of the way: where it is, and by which pose of the graph that is known.

    Args:
        pose: T_world_camera.
        reference: Number of the pose in the graph; its own if the image is one.
        own: Covariance of what no other image shares with it, axes of the reference: the step from there, none for
            a reference itself, and what the image distorts.
    """

    pose: Pose3
    reference: int
    own: Float[np.ndarray, "6 6"]


@dataclass(frozen=True)
class Claims:
    """Covariances of (x, y, z, rotation vector) of every image, world axes, m and rad.

    Args:
        from_start: Given where the first image is; zero for that.
        aligned: After the best motion of the whole way, `gauge` says which that is.
    """

    from_start: Float[np.ndarray, "n 6 6"]
    aligned: Float[np.ndarray, "n 6 6"]


def gauge(
    positions: Float[np.ndarray, "n 3"],
) -> tuple[Float[np.ndarray, "n 6 6"], Float[np.ndarray, "n 6 6"]]:
    """How a small motion of the whole way moves every pose, and how the best one follows from errors.

    A turn by one radian weighs as much as a shift by `TURN_M`. The motion is about the mean position.

    Args:
        positions: Of the poses, world axes, m.

    Returns:
        A and G: poses move by A_k g, and g = sum of G_k e_k makes the weighted squares of e_k - A_k g least.
    """
    arms = positions - positions.mean(axis=0)
    moves = np.stack([carried(arm) for arm in arms])
    weights = np.array([1.0] * 3 + [TURN_M**2] * 3)
    weighed = moves.transpose(0, 2, 1) * weights
    normal = np.einsum("nij,njk->ik", weighed, moves)
    return moves, np.linalg.solve(normal, weighed)


def claims(factors: Sequence[Factor], poses: Mapping[int, Pose3], way: Sequence[Hung]) -> Claims:
    """What a graph claims of every image that hangs on it.

    Args:
        factors: Motions and closures in space, floors; those that were rejected left out.
        poses: T_world_body by number, the solution of the factors.
        way: Images; the first one defines the start and is a pose of the graph.

    Raises:
        InputError: The factors do not tie the poses together.
    """
    graph = _Solved(factors, poses)
    moves, best = gauge(np.array([one.pose.position for one in way]))
    levers, alone = [], []
    for one in way:
        reference = poses[one.reference]
        levers.append(carried(one.pose.position - reference.position))
        alone.append(turned_covariance(one.own, reference.rotation))
    common = graph.columns(
        (one.reference, G @ L) for one, G, L in zip(way, best, levers, strict=True)
    )
    spread = common.own + sum(G @ S @ G.T for G, S in zip(best, alone, strict=True))
    start = graph.columns([(way[0].reference, np.eye(6))])
    covariances = graph.covariances()
    from_start, aligned = [], []
    for i, (one, L, S) in enumerate(zip(way, levers, alone, strict=True)):
        own = L @ covariances[one.reference] @ L.T + S
        since = carried(one.pose.position - way[0].pose.position)
        with_start = L @ start.of(one.reference) + (alone[0] if i == 0 else 0.0)
        from_start.append(_less(own, since, with_start, start.own + alone[0]))
        with_common = L @ common.of(one.reference) + S @ best[i].T
        aligned.append(_less(own, moves[i], with_common, spread))
    return Claims(np.array(from_start), np.array(aligned))


def _less(own: np.ndarray, A: np.ndarray, shared: np.ndarray, common: np.ndarray) -> np.ndarray:
    """Covariance of e - A c, from those of e, of e with c, and of c."""
    left = own - A @ shared.T - shared @ A.T + A @ common @ A.T
    return np.asarray((left + left.T) / 2.0)


class _Columns:
    """Covariances of all poses with one combination of their errors."""

    def __init__(self, at: Mapping[int, int], columns: np.ndarray, own: np.ndarray) -> None:
        self._at, self._columns, self.own = at, columns, own

    def of(self, number: int) -> Float[np.ndarray, "6 6"]:
        """Of one pose with it."""
        return np.asarray(self._columns[self._at[number] : self._at[number] + 6])


class _Solved:
    """The factors, linearised, with the inverse of their information at hand."""

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
                f"claims: the factors do not tie every pose to pose {numbers[0]} ({error})"
            ) from error

    def columns(self, parts: Iterable[tuple[int, np.ndarray]]) -> _Columns:
        """Of the sum of parts, each a matrix times the error of a pose."""
        wanted = np.zeros((self._size, 6))
        for number, part in parts:
            wanted[self._at[number] : self._at[number] + 6] += part.T
        columns = self._inverse.solve(wanted)
        return _Columns(self._at, columns, wanted.T @ columns)

    def covariances(self) -> dict[int, Float[np.ndarray, "6 6"]]:
        """Of every pose by itself."""
        return {number: self.columns([(number, np.eye(6))]).own for number in self._at}


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
