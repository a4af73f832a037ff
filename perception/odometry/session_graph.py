"""Several sessions as one pose graph: which of them belong together, and the poses of all of them.

Every session brings its own odometry and loop closures; links between sessions are loop closures with a robust loss.
Sessions that no believed pair of sessions connects stay apart. Where the solution rejects most links of a pair, the
pair contradicts the others and is no longer believed. The first session of a part keeps its axes.

Source: Kümmerle et al. 2011 (pose graph); Baarda 1973 (covariances after a change of gauge), as `pose_uncertainty`;
the choice of pairs is ours.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from ..primitives.errors import InputError
from ..primitives.pose import Pose3
from ..smoothing.factors import Factor, LoopClosure, Motion, Placement, turned_covariance
from ..smoothing.smoother import Solution, solve
from .back_end import ANCHOR_M, ANCHOR_RAD
from .pose_uncertainty import error_transport
from .session_links import PairLinks

BELIEVED = 0.9  # ours: probability from which two sessions are joined
LEAST_KEPT = 0.5  # ours: share of the links of a pair that the solution keeps, of a true one
LEAST_M, LEAST_RAD = 0.002, 0.002  # ours: deviation of the motion between two images, at least


@dataclass(frozen=True, eq=False)
class SessionGraph:
    """The images of a session that are variables, and what it knows about their motion.

    Args:
        poses: T_session_camera of each, in the axes of its map.
        factors: Motions and loop closures; their numbers are indices into `poses`.
    """

    poses: Sequence[Pose3]
    factors: Sequence[Motion | LoopClosure]


@dataclass(frozen=True, eq=False)
class Joined:
    """One part: sessions that belong together, in the axes of the first of them.

    Args:
        sessions: Their numbers, the one that gives the axes first.
        poses: T_part_camera of the images of each session, by session.
        numbers: Number of the first image of each session in the graph, by session.
        factors: All factors that the solution keeps.
        links: Number of links kept, by pair of sessions.
        solution: Of the graph; None for one image alone.
    """

    sessions: tuple[int, ...]
    poses: Mapping[int, Sequence[Pose3]]
    numbers: Mapping[int, int]
    factors: tuple[Factor, ...]
    links: Mapping[tuple[int, int], int]
    solution: Solution | None


def join(
    graphs: Sequence[SessionGraph],
    pairs: Mapping[tuple[int, int], PairLinks],
    rank: Sequence[int],
) -> list[Joined]:
    """Join the sessions that belong together.

    Args:
        graphs: Of each session.
        pairs: Links of each pair of sessions (smaller number first).
        rank: Of each session; the lowest of a part gives its axes.

    Returns:
        The parts, those with most sessions first.

    Raises:
        InputError: The images of a session are not connected by its factors.
    """
    believed = {pair for pair, one in pairs.items() if one.probability >= BELIEVED and one.links}
    while True:
        parts = [
            _solved(part, graphs, pairs, believed, rank) for part in groups(len(graphs), believed)
        ]
        false = {
            pair
            for part in parts
            for pair, kept in part.links.items()
            if kept < LEAST_KEPT * len(pairs[pair].links)
        }
        if not false:
            return parts
        believed -= {min(false, key=lambda pair: (pairs[pair].probability, pair))}


def groups(count: int, pairs: set[tuple[int, int]]) -> list[list[int]]:
    """Sessions that pairs connect, directly or through others; large groups first, then by their numbers."""
    of = list(range(count))
    for one, other in sorted(pairs):
        kept, gone = sorted((of[one], of[other]))
        of = [kept if group == gone else group for group in of]
    found = [[k for k in range(count) if of[k] == group] for group in sorted(set(of))]
    return sorted(found, key=lambda group: (-len(group), group))


def relative_covariance(
    before: Float[np.ndarray, "6 6"], after: Float[np.ndarray, "6 6"], one: Pose3, other: Pose3
) -> Float[np.ndarray, "6 6"]:
    """Covariance of the motion between two poses, where only that of each is known.

    Errors of odometry accumulate, so the later pose has that of the earlier one and its own.

    Args:
        before, after: Of the two poses, in the axes that both are given in.
        one, other: The two poses.

    Returns:
        In the axes of the first pose, at least `LEAST_M` and `LEAST_RAD` in every direction.
    """
    lever = error_transport(other.position - one.position)
    grown = turned_covariance(after - lever @ before @ lever.T, one.rotation.T)
    least = np.array([LEAST_M] * 3 + [LEAST_RAD] * 3)
    values, vectors = np.linalg.eigh((grown + grown.T) / 2.0 / np.outer(least, least))
    kept = (vectors * np.maximum(values, 1.0)) @ vectors.T
    return np.asarray(kept * np.outer(least, least))


def _solved(
    group: Sequence[int],
    graphs: Sequence[SessionGraph],
    pairs: Mapping[tuple[int, int], PairLinks],
    believed: set[tuple[int, int]],
    rank: Sequence[int],
) -> Joined:
    """The joint solution of some sessions."""
    order = sorted(group, key=lambda k: rank[k])
    begins = np.concatenate([[0], np.cumsum([len(graphs[k].poses) for k in order])])
    numbers = {k: int(begin) for k, begin in zip(order, begins, strict=False)}
    inside: list[Factor] = [
        replace(factor, before=factor.before + numbers[k], after=factor.after + numbers[k])
        for k in order
        for factor in graphs[k].factors
    ]
    owners: dict[int, tuple[int, int]] = {}
    across: list[Factor] = []
    for pair in sorted(believed):
        if pair[0] in numbers:
            for link in pairs[pair].links:
                ends = numbers[pair[0]] + link.before, numbers[pair[1]] + link.after
                across.append(LoopClosure(*ends, link.motion, link.covariance))
                owners[id(across[-1])] = pair
    first = graphs[order[0]].poses[0]
    if not inside and not across:
        return Joined(tuple(order), {order[0]: [first]}, numbers, (), {}, None)
    anchor = np.diag([ANCHOR_M**2] * 3 + [ANCHOR_RAD**2] * 3)
    solution = solve([*inside, *across], Placement(first, anchor))
    if len(solution.poses) != begins[-1]:
        raise InputError("session graph: an image has no motion from the one before; map it again")
    rejected = {id(one) for one in solution.rejected}
    factors = tuple(one for one in (*inside, *across) if id(one) not in rejected)
    kept = dict.fromkeys(owners.values(), 0)
    for one in across:
        kept[owners[id(one)]] += id(one) not in rejected
    poses = {
        k: [_pose(solution, numbers[k] + n) for n in range(len(graphs[k].poses))] for k in order
    }
    return Joined(tuple(order), poses, numbers, factors, kept, solution)


def _pose(solution: Solution, number: int) -> Pose3:
    placed = solution.poses[number]
    assert isinstance(placed, Placement)
    return placed.pose
