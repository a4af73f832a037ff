"""Covariances of foreign trajectories: tables (`covariance_table`), and pose graphs as g2o text.

The order is (position, rotation) and the axes are those of the world, as in ROS, unless told otherwise; GTSAM has
(rotation, position) in the axes of each pose.

g2o: vertices VERTEX_SE3:QUAT or VERTEX_SE2 with edges EDGE_SE3:QUAT or EDGE_SE2. The joint covariance of all vertices
follows from the information of the edges.

Source: Dellaert and Kaess (2006) (marginals of a graph).
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from perception.odometry.pose_uncertainty import error_transport, rigid_alignment
from perception.primitives.errors import InputError

from ..results.gauge import without_gauge
from ..results.tables import Trajectory
from .covariance_table import SIZES, matrices, read_covariances
from .foreign_graph import PoseGraph, is_graph, read_g2o
from .foreign_trajectory import ForeignTrajectory
from .metrics.gauge_alignment import floor_gauge, floor_transport
from .metrics.trajectory import MAX_DIFFERENCE_S, associate

SPACE, PLANAR, POSITION = "space", "planar", "position"
GROWING, INDEPENDENT, ALIGNED, GRAPH = "growing", "independent", "aligned", "graph"
UNFIT = "unfit"
GROWS = 0.1  # ours: of a localiser the first covariance is as large as the others, of odometry it is nearly zero
LEAST_LEFT = 2e-3  # ours: share of the variance after alignment; of errors that grow for a tenth of the poses 5e-3
_ROTATION_FIRST = [3, 4, 5, 0, 1, 2]
_FLOOR, _OFF_FLOOR = [0, 1, 5], [2, 3, 4]  # x, y, yaw and z, roll, pitch
_SAME_M = 1e-3  # ours: a vertex is at the pose of the trajectory that is this close

WORDS = {
    GROWING: "covariances grow from the start: errors are taken to be accumulated, as of odometry",
    INDEPENDENT: "covariances do not grow from the start: errors are taken to be independent from pose to pose",
    UNFIT: "covariances grow from the start, but not as accumulated errors do: errors are taken to be independent from pose to pose",
    ALIGNED: "covariances are those of the error after rigid alignment",
    GRAPH: "covariances of all poses together follow from the pose graph",
}

AXES = (
    "be in the axes of the world (leave out --body-axes)",
    "be in the axes of each pose (--body-axes)",
)
ORDERS = (
    "have the position before the rotation (leave out --rotation-first)",
    "have the rotation before the position (--rotation-first)",
)
ROUGH = (
    "; rotations or correlations are missing, so that motions are not judged and what alignment removes is a rough guess: "
    "give full covariances of the poses, or a truth in the same axes with --same-axes"
)


@dataclass(frozen=True)
class Claims:
    """Covariances of some poses of a trajectory.

    Args:
        kind: `SPACE` (6x6 over x, y, z, rotation vector), `PLANAR` (x, y, yaw) or `POSITION` (x, y, z).
        shared: How the errors of two poses belong together: `GROWING`, `INDEPENDENT`, `UNFIT`, `ALIGNED` or `GRAPH`.
        rows: Which poses of the trajectory have a covariance, increasing.
        covariances: One per row, world axes, m and rad; of a graph relative to its first pose.
        graph: The pose graph, if the covariances come from one.
        given: As in the file, if the file does not tell their order and axes.
        body_axes, rotation_first: How these were read.
        unknown: Number of covariances that are zero, which tells nothing.
        by_positions: Positions alone are compared, and were aligned.
    """

    kind: str
    shared: str
    rows: Int[np.ndarray, "n"]
    covariances: Float[np.ndarray, "n k k"]
    graph: PoseGraph | None = None
    given: Float[np.ndarray, "n k k"] | None = None
    body_axes: bool = False
    rotation_first: bool = False
    unknown: int = 0
    by_positions: bool = False

    @property
    def compared(self) -> str:
        """Of which errors the methods below give covariances: `kind`, or `POSITION` if positions alone are compared."""
        return POSITION if self.by_positions else self.kind

    def of_positions(self) -> Claims:
        """The claims about positions alone, for a trajectory or a truth without rotations.

        Raises:
            InputError: They are those of a pose graph, or over (x, y, yaw).
        """
        if self.graph is not None or self.kind == PLANAR:
            of = "a pose graph" if self.graph is not None else "covariances over (x, y, yaw)"
            raise InputError(
                f"{of} cannot be compared with a trajectory without rotations; give covariances over (x, y, z) "
                "or (x, y, z, rotation vector)"
            )
        return replace(self, by_positions=True)

    def read_as(self, poses: Trajectory, body_axes: bool, rotation_first: bool) -> Claims:
        """The covariances of the file by this convention."""
        assert self.given is not None
        found = self.given
        if rotation_first:
            found = found[:, _ROTATION_FIRST][:, :, _ROTATION_FIRST]
        if body_axes:
            found = _turned(self.kind, found, poses, self.rows)
        return replace(self, covariances=found, body_axes=body_axes, rotation_first=rotation_first)

    def otherwise(self, poses: Trajectory) -> list[tuple[str, Claims]]:
        """The same file by other conventions, each with its words and what to do."""
        if self.given is None:
            return []
        found = []
        for body_axes, rotation_first in itertools.product((False, True), repeat=2):
            changed = (body_axes != self.body_axes, rotation_first != self.rotation_first)
            if not any(changed) or (changed[1] and self.kind != SPACE):
                continue
            words = [ORDERS[rotation_first]] * changed[1] + [AXES[body_axes]] * changed[0]
            found.append((" and ".join(words), self.read_as(poses, body_axes, rotation_first)))
        return found

    @property
    def complete(self) -> bool:
        """Whether they tell how errors of rotation move later positions: poses, and not standard deviations alone."""
        return self.kind != POSITION and bool(
            np.any(self.covariances[:, ~np.eye(self.covariances.shape[1], dtype=bool)])
        )

    @property
    def words(self) -> str:
        """How they are taken."""
        return WORDS[self.shared] + ROUGH * (self.shared == GROWING and not self.complete)

    def expected(
        self, poses: Trajectory, chosen: Int[np.ndarray, "m"], same_axes: bool
    ) -> Float[np.ndarray, "m k k"]:
        """Covariances of the errors of some of the rows, after rigid alignment over them unless in the `same_axes`."""
        found = self.covariances[chosen] if same_axes else self.left(poses, chosen)
        return found[:, :3, :3] if self.by_positions else found

    def left(self, poses: Trajectory, chosen: Int[np.ndarray, "m"]) -> Float[np.ndarray, "m k k"]:
        """Covariances of the errors that remain after rigid alignment over some of the rows.

        Args:
            poses: The trajectory.
            chosen: Indices into `rows`.
        """
        covariances = self.covariances[chosen]
        if self.shared == ALIGNED:
            return covariances
        if self.graph is not None:
            return self.graph.covariances(chosen, aligned=True)
        positions = poses.positions[self.rows[chosen]]
        if self.shared != GROWING:
            return without_gauge(*self.gauge(positions), own=covariances)
        return without_gauge(*self.gauge(positions), covariances, self.carry(positions))

    def fitting(self, poses: Trajectory, chosen: Int[np.ndarray, "m"]) -> Claims:
        """These claims; as `UNFIT` if they grow but cannot be those of accumulated errors.

        Of accumulated errors most covariances after alignment would be impossible, or alignment would leave nearly
        nothing, since all growth is within a few poses: those of a localiser that was told its start.
        """
        if self.shared == GROWING:
            own = self.covariances[chosen]
            sizes = np.linalg.eigvalsh(own)
            regular = sizes[:, 0] > 1e-12 * sizes[:, -1]
            left = self.left(poses, chosen)[regular]
            shares = np.trace(np.linalg.solve(own[regular], left), axis1=1, axis2=2) / own.shape[1]
            possible = np.linalg.eigvalsh(left)[:, 0] > 0.0
            if regular.any() and (np.mean(possible) < 0.5 or np.median(shares) < LEAST_LEFT):
                return replace(self, shared=UNFIT)
        return self

    def gauge(
        self, positions: Float[np.ndarray, "n 3"]
    ) -> tuple[Float[np.ndarray, "n k g"], Float[np.ndarray, "n g k"]]:
        """Jacobians of the rigid alignment, as `rigid_alignment` gives them."""
        if self.kind == PLANAR:
            return floor_gauge(positions[:, :2])
        if self.kind == POSITION:
            return position_gauge(positions)
        moves, best = rigid_alignment(positions)
        if self.by_positions:
            best = np.concatenate(
                [position_gauge(positions)[1], np.zeros((len(positions), 6, 3))], 2
            )
        return moves, best

    def together(
        self, poses: Trajectory, chosen: Int[np.ndarray, "m"], aligned: bool
    ) -> Float[np.ndarray, "m k m k"] | None:
        """Covariance of accumulated errors of some poses together; None of errors that are not accumulated.

        Args:
            poses: The trajectory.
            chosen: Indices into `rows`, at most some hundred.
            aligned: After the rigid alignment over these poses.
        """
        if self.shared != GROWING:
            return None
        positions, own = poses.positions[self.rows[chosen]], self.covariances[chosen]
        n, k = own.shape[:2]
        carry = self.carry(positions)
        back = np.linalg.inv(carry)
        grown = back @ own @ back.transpose(0, 2, 1)
        rank = np.argsort(np.argsort(np.trace(grown, axis1=1, axis2=2), kind="stable"))
        lesser = np.where(rank[:, None] <= rank, np.arange(n)[:, None], np.arange(n))
        blocks = carry[:, None] @ grown[lesser] @ carry.transpose(0, 2, 1)[None]
        joint = blocks.transpose(0, 2, 1, 3).copy()
        if aligned:
            moves, best = self.gauge(positions)
            kept = np.eye(n * k) - moves.reshape(n * k, -1) @ best.transpose(1, 0, 2).reshape(
                -1, n * k
            )
            joint = (kept @ joint.reshape(n * k, n * k) @ kept.T).reshape(n, k, n, k)
        return joint[:, :3, :, :3] if self.by_positions else joint

    def carry(self, positions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n k k"]:
        """Maps from an error at the origin to the error at each position; one for positions alone."""
        if self.kind == PLANAR:
            return floor_transport(positions[:, :2])
        if self.kind == POSITION:
            return np.tile(np.eye(3), (len(positions), 1, 1))
        return np.stack([error_transport(position) for position in positions])

    def between(
        self,
        poses: Trajectory,
        chosen: Int[np.ndarray, "m"],
        errors: Float[np.ndarray, "m k"],
        lag: int,
        truth: Float[np.ndarray, "k k"],
    ) -> tuple[Float[np.ndarray, "j k"], Float[np.ndarray, "j k k"]] | None:
        """Errors of the motions between poses `lag` apart, one after the other, and their covariances.

        None unless errors accumulate, and claims and errors are complete: only then are those of motions independent,
        and their covariances known.

        Args:
            poses: The trajectory.
            chosen: Indices into `rows`.
            errors: Errors of these poses; what alignment removed cancels.
            lag: Number of poses from one to the next.
            truth: Covariance of a true pose.
        """
        if self.shared != GROWING or not self.complete or self.by_positions:
            return None
        at = np.arange(0, len(chosen), lag)
        carry = self.carry(poses.positions[self.rows[chosen[at]]])
        moved = carry[1:] @ np.linalg.inv(carry[:-1])
        covariances = self.covariances[chosen[at]]
        before = moved @ covariances[:-1] @ moved.transpose(0, 2, 1)
        grown = covariances[1:] - before
        own = truth + moved @ truth @ moved.transpose(0, 2, 1)
        relative = errors[at[1:]] - np.einsum("nij,nj->ni", moved, errors[at[:-1]])
        return relative, (grown + grown.transpose(0, 2, 1)) / 2.0 + own


def position_gauge(
    positions: Float[np.ndarray, "n 3"],
) -> tuple[Float[np.ndarray, "n 3 6"], Float[np.ndarray, "n 6 3"]]:
    """`rigid_alignment` by positions alone; what they do not determine, such as the roll of a straight line, is zero."""
    moves = np.stack([error_transport(arm)[:3] for arm in positions - positions.mean(axis=0)])
    back = moves.transpose(0, 2, 1)
    return moves, np.linalg.pinv(np.einsum("nij,njk->ik", back, moves), hermitian=True) @ back


def read_claims(
    path: Path,
    trajectory: ForeignTrajectory,
    body_axes: bool = False,
    rotation_first: bool = False,
) -> Claims:
    """Read the covariances of a trajectory.

    Args:
        path: CSV or g2o.
        trajectory: Whose poses they belong to.
        body_axes: The covariances are in the axes of each pose, not in those of the world.
        rotation_first: They are over (rotation vector, x, y, z), not over (x, y, z, rotation vector).

    Raises:
        InputError: The file is in neither format, does not belong to the trajectory, or a matrix is no covariance; or
            `body_axes` of a trajectory without rotations.
    """
    if body_axes and not trajectory.has_rotations:
        raise InputError(
            f"{trajectory.source} has no rotations, so that the axes of its poses are unknown; leave out --body-axes"
        )
    if is_graph(path):
        if body_axes or rotation_first:
            raise InputError(
                f"{path} is a pose graph, whose order and axes are known; leave out --body-axes and --rotation-first"
            )
        return _of_graph(path, trajectory)
    table = read_covariances(path)
    size, upper = SIZES[table.values.shape[1]]
    if rotation_first and (size != 6 or table.openvins):
        raise InputError(f"{path} has no 6x6 covariances without names; leave out --rotation-first")
    planar = any(word in name.lower() for name in table.names for word in ("yaw", "theta"))
    kind = SPACE if size == 6 else PLANAR if planar else POSITION
    covariances = matrices(table.values, size, upper)
    mine, rows = _rows(path, table.stamps, len(covariances), trajectory)
    covariances = covariances[mine]
    _check(path, covariances, table.lines[mine], table.values.shape[1])
    known = np.any(covariances, axis=(1, 2))
    if not known.any():
        raise InputError(
            f"{path}: every covariance is zero, which tells nothing; write the covariances of the system"
        )
    known[max(int(np.argmax(known)) - 1, 0)] = True  # the known start of errors that grow
    covariances, rows = covariances[known], rows[known]
    if size == 6 and not (rotation_first or np.any(covariances[:, _OFF_FLOOR])):
        kind, covariances = PLANAR, covariances[:, _FLOOR][:, :, _FLOOR]
    sizes = np.trace(covariances, axis1=1, axis2=2)
    shared = GROWING if sizes[0] < GROWS * np.median(sizes) else INDEPENDENT
    claims = Claims(kind, shared, rows, covariances, unknown=int(np.sum(~known)))
    if any(name.startswith("aligned_") for name in table.names):
        return replace(claims, shared=ALIGNED)
    if table.openvins:
        R = Rotation.from_quat(trajectory.poses.quats_xyzw[rows]).as_matrix()
        covariances[:, 3:, 3:] = R @ covariances[:, 3:, 3:] @ R.transpose(0, 2, 1)
        return claims
    return replace(claims, given=covariances).read_as(trajectory.poses, body_axes, rotation_first)


def _of_graph(path: Path, trajectory: ForeignTrajectory) -> Claims:
    graph = read_g2o(path)
    positions = graph.positions
    poses = trajectory.poses.positions
    if len(positions) == trajectory.lines:
        rows = np.arange(len(poses))
        graph = replace(graph, numbers=graph.numbers[trajectory.rows])
    else:
        away = np.linalg.norm(poses[None, :, :] - positions[:, None, :], axis=2)
        rows = np.argmin(away, axis=1)
        far = float(away[np.arange(len(rows)), rows].max())
        if far > _SAME_M or np.any(np.diff(rows) <= 0):
            raise InputError(
                f"{path} has {len(positions)} vertices and the trajectory {len(poses)} poses, and not every vertex "
                f"is at a pose of the trajectory in the same order (farthest {far:.3g} m); give the poses of the vertices"
            )
    kind = PLANAR if graph.planar else SPACE
    every = np.arange(len(rows))
    return Claims(kind, GRAPH, rows, graph.covariances(every, aligned=False), graph)


def _rows(
    path: Path, stamps: Float[np.ndarray, "n"] | None, count: int, trajectory: ForeignTrajectory
) -> tuple[Int[np.ndarray, "k"], Int[np.ndarray, "k"]]:
    """Lines of the table, and the poses that they belong to."""
    poses = trajectory.poses
    if stamps is None or not trajectory.has_stamps:
        if count != trajectory.lines:
            raise InputError(
                f"{path} has {count} covariances and {trajectory.source} {trajectory.lines} poses; without stamps "
                "in both the numbers must be equal"
            )
        return trajectory.rows, np.arange(len(poses))
    order = np.argsort(stamps, kind="stable")
    mine, theirs = associate(stamps[order], poses.stamps)
    if len(mine) == 0:
        raise InputError(
            f"{path} has no stamp within {MAX_DIFFERENCE_S:g} s of a pose of {trajectory.source}: it covers "
            f"{stamps.min():.3f} to {stamps.max():.3f} s, the trajectory {poses.stamps[0]:.3f} to "
            f"{poses.stamps[-1]:.3f} s; give the covariances of this trajectory"
        )
    theirs, first = np.unique(theirs, return_index=True)  # of two for one pose the first
    return order[mine[first]], theirs


def _check(
    path: Path, covariances: Float[np.ndarray, "n k k"], lines: Int[np.ndarray, "n"], count: int
) -> None:
    """Refuse what is no covariance; a first pose without error is one."""
    scale = np.abs(covariances).max(axis=(1, 2))
    with np.errstate(invalid="ignore"):  # inf - inf
        uneven = np.abs(covariances - covariances.transpose(0, 2, 1)).max(axis=(1, 2))
    bad = ~np.isfinite(scale) | (uneven > 1e-4 * scale)
    if not bad.any():
        least = np.linalg.eigvalsh(covariances)[:, 0]
        bad = least < -1e-6 * scale
    if bad.any():
        first = int(np.flatnonzero(bad)[0])
        size, upper = SIZES[count]
        raise InputError(
            f"{path}, line {lines[first]}: covariance {first} (counted from 0) is not finite, symmetric and positive; "
            f"{count} numbers were read as {'the upper triangle of ' * upper}a {size}x{size} matrix row by row, m and rad; "
            "of standard deviations or variances name the columns (sigma_x or var_x, ...)"
        )


def _turned(
    kind: str,
    covariances: Float[np.ndarray, "n k k"],
    poses: Trajectory,
    rows: Int[np.ndarray, "n"],
) -> Float[np.ndarray, "n k k"]:
    """Covariances in world axes from those in the axes of each pose."""
    turns = np.zeros_like(covariances)
    if kind == PLANAR:
        yaws = poses.yaws[rows]
        turns[:, :3, :3] = Rotation.from_euler("z", yaws).as_matrix()
    else:
        R = Rotation.from_quat(poses.quats_xyzw[rows]).as_matrix()
        turns[:, :3, :3] = R
        if kind == SPACE:
            turns[:, 3:, 3:] = R
    return np.asarray(turns @ covariances @ turns.transpose(0, 2, 1))
