"""What was moved between two sessions: volumes of the size of furniture that one saw filled and the other saw free.

In another place the images contradict each other nearly everywhere. In one place where furniture was moved, they do so
in the volumes that it left and filled, and fit around these.

Source: ours; free space by projection as in Newcombe et al. 2011.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ..primitives.pose import Pose3
from ._align_kernels import FREE_SHARE, FREE_SIGMAS
from .alignment import FINEST_GATE_M
from .pyramid import Pyramid

# Ours, as all constants below: chosen on homes of seeds 100 to 104.
STRIDE = 4  # pixels
CELL_M = 0.10
LEAST_POINTS = 5  # in the other session's free space, of a cell
LEAST_SHARE = 0.5  # of the points of a cell that lie there
NEXT_CELLS = 1.8  # distance of cells that touch, also by an edge or a corner
LARGEST_M = 1.6  # longest side: of a chair, a small table or a box, but not of a wall


@dataclass(frozen=True, eq=False)
class Seen:
    """The points of one image off the floor that are in the view of another one.

    Args:
        points: Session axes, m.
        in_free: Whether the other image saw through each.
        hidden: Whether the other image has a surface in front of each.
        surface: The point of the other image on the ray to each, session axes, m.
    """

    points: Float[np.ndarray, "n 3"]
    in_free: Bool[np.ndarray, "n"]
    hidden: Bool[np.ndarray, "n"]
    surface: Float[np.ndarray, "n 3"]


@dataclass(frozen=True, eq=False)
class ComparedImages:
    """Two images, each as the other sees it.

    Args:
        second_in_first: Points of the image of the second session in that of the first.
        first_in_second: The other way round.
        weight: Of the pair among all.
    """

    second_in_first: Seen
    first_in_second: Seen
    weight: float


@dataclass(frozen=True)
class MovedVolume:
    """A volume that only one session saw filled.

    Args:
        contradicting: Share of all compared points of the second session that lie in it, in free space.
        hidden: Share of them that it hides.
    """

    contradicting: float
    hidden: float


def compared_images(
    first: Pyramid, second: Pyramid, T_session_first: Pose3, T_first_second: Pose3, weight: float
) -> ComparedImages:
    """Two images at a motion between them.

    Args:
        first, second: The images.
        T_session_first: Pose of the first, axes of its session.
        T_first_second: The motion.
        weight: Of the pair among all.
    """
    back = T_first_second.inverse()
    return ComparedImages(
        _seen(first, second, T_session_first, T_first_second),
        _seen(second, first, T_session_first @ T_first_second, back),
        weight,
    )


def _seen(target: Pyramid, source: Pyramid, T_session_target: Pose3, T: Pose3) -> Seen:
    """The points of the source in the view of the target; thresholds of free space as in the alignment."""
    to, of = target.levels[0], source.levels[0]
    z, sigma, counts = (a[::STRIDE, ::STRIDE] for a in (of.z, of.sigma, of.counts))
    good = (z > 0.0) & (counts > 0)
    x, y = np.meshgrid(*(slope[::STRIDE] for slope in of.slopes))
    rays = np.stack([x[good], y[good], np.ones(np.count_nonzero(good))], axis=1)
    points, sigma = T.apply(rays * z[good][:, None]), sigma[good]
    camera = to.camera
    ahead = points[:, 2] > 0.05
    depth = np.where(ahead, points[:, 2], 1.0)
    u = np.rint(camera.fx * points[:, 0] / depth + camera.cx)
    v = np.rint(camera.fy * points[:, 1] / depth + camera.cy)
    index = np.flatnonzero(ahead & (u >= 0) & (u < camera.width) & (v >= 0) & (v < camera.height))
    row, column = v[index].astype(np.int64), u[index].astype(np.int64)
    seen = to.z[row, column]
    known = seen > 0.0
    index, row, column, seen = index[known], row[known], column[known], seen[known].astype(float)
    points, along = points[index], seen - points[index, 2]
    margin = FINEST_GATE_M + FREE_SIGMAS * sigma[index] + FREE_SHARE * seen
    x, y = to.slopes
    surface = np.stack([x[column], y[row], np.ones(len(row))], axis=1) * seen[:, None]
    return Seen(
        T_session_target.apply(points),
        along > margin,
        along < -margin,
        T_session_target.apply(surface),
    )


def moved_volumes(compared: Sequence[ComparedImages]) -> list[MovedVolume]:
    """The volumes that only one of two sessions saw filled and that are no larger than furniture, largest share first."""
    total = sum(one.weight for one in compared)
    new = [one.second_in_first for one in compared]
    old = [one.first_in_second for one in compared]
    shares = [
        np.full(len(seen.points), one.weight / total / max(len(seen.points), 1))
        for one, seen in zip(compared, new, strict=True)
    ]
    came = _held(
        _volumes(new),
        np.concatenate([seen.points[seen.in_free] for seen in new]),
        np.concatenate([share[seen.in_free] for share, seen in zip(shares, new, strict=True)]),
    )
    went = _held(
        _volumes(old),
        np.concatenate([seen.surface[seen.hidden] for seen in new]),
        np.concatenate([share[seen.hidden] for share, seen in zip(shares, new, strict=True)]),
    )
    found = [MovedVolume(share, 0.0) for share in came] + [MovedVolume(0.0, s) for s in went]
    return sorted(found, key=lambda one: -one.contradicting - one.hidden)


def _held(
    volumes: Sequence[Int[np.ndarray, "_ 3"]],
    points: Float[np.ndarray, "m 3"],
    shares: Float[np.ndarray, "m"],
) -> list[float]:
    """Sum of the shares of the points in each volume."""
    if not volumes:
        return []
    of = np.repeat(np.arange(len(volumes)), [len(one) for one in volumes])
    tree = cKDTree(np.concatenate(volumes))
    away, nearest = map(np.asarray, tree.query(_cells(points)))
    inside = away == 0.0
    return np.bincount(of[nearest[inside]], shares[inside], len(volumes)).tolist()


def _volumes(seen: Sequence[Seen]) -> list[Int[np.ndarray, "_ 3"]]:
    """Cells of each connected volume that the other session saw free, if it is no larger than furniture."""
    points = np.concatenate([one.points for one in seen])
    in_free = np.concatenate([one.in_free for one in seen])
    cells, of = np.unique(_cells(points), axis=0, return_inverse=True)
    of = of.reshape(-1)
    free, every = np.bincount(of, in_free, len(cells)), np.bincount(of, minlength=len(cells))
    cells = cells[(free >= LEAST_SHARE * every) & (free >= LEAST_POINTS)]
    if not len(cells):
        return []
    pairs = cKDTree(cells).query_pairs(NEXT_CELLS, output_type="ndarray")
    links = coo_array((np.ones(len(pairs), np.int8), tuple(pairs.T)), shape=(len(cells),) * 2)
    count, label = connected_components(links, directed=False)
    parts = [cells[label == k] for k in range(count)]
    return [part for part in parts if np.max(np.ptp(part, axis=0) + 1) * CELL_M <= LARGEST_M]


def _cells(points: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, "n 3"]:
    return np.floor(points / CELL_M).astype(np.int64)
