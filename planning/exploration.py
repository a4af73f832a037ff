"""Exploration: targets at frontiers of the known ground, then at the ground seen longest ago.

A frontier is a border between known free ground and unknown ground. The robot goes to the reachable frontier with the
largest length by path cost; without frontiers it visits the ground seen longest ago. A target that was visited, or that
cannot be reached in time, is left alone for a while.

Source: seed 003, section 5 and experiment E6 (wander and explore at home); frontiers: B. Yamauchi, "A
frontier-based approach for autonomous exploration" (CIRA 1997); gain and patience ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import ndimage, sparse

from perception.primitives.errors import ConfigError
from perception.primitives.robot_model import DARWIN_OP, RobotModel
from perception.primitives.settings import setting

# all ours
BODY_M = 0.22  # half the width of the narrowest passage of a DARwIn-OP; grows with the body
SETTLE_M = 0.80  # a metre of path costs as much as this length of frontier gains
ARRIVE_M = 0.30  # distance at which a target is reached
SHUN_S, SHUN_M = 150.0, 0.50  # how long a target is left alone, and everything this near to it
PROGRESS_M = 0.1  # least reduction of the remaining path that is progress
STAND_M = 0.6  # largest distance from the middle of a frontier to a reachable cell
SIGHT_M = 0.4  # a frontier without cells this near to its target is gone
SAMPLES = 200  # candidates among the cells to see again


@dataclass(frozen=True)
class ExplorationConfig:
    """Frontiers that count, and patience on the way to them."""

    least_frontier_m: float = (
        0.20  # ours: gaps of the sensor; length below which a frontier is ignored
    )
    ahead_m: float = (
        1.20  # ours: the local map holds it; largest distance of the next goal along the path
    )
    patience_s: float = setting(
        45.0, "s", "time without progress after which a target is given up", "ours"
    )

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"exploration: {name}={value} must be positive and finite")


@dataclass(frozen=True)
class ExplorationMap:
    """The map for exploration.

    Args:
        occupied: Occupied cells, [row (y), column (x)].
        known: Seen cells.
        updated_s: Stamp of the last sight of each cell, s.
        origin: Lower left corner of cell [0, 0], world frame, m.
        cell_m: Side of a cell.
    """

    occupied: Bool[np.ndarray, "rows columns"]
    known: Bool[np.ndarray, "rows columns"]
    updated_s: Float[np.ndarray, "rows columns"]
    origin: Float[np.ndarray, "2"]
    cell_m: float

    def cell(self, place: Float[np.ndarray, "2"]) -> tuple[int, int]:
        """[row, column] of a point, clipped to the map."""
        column, row = np.floor((place - self.origin) / self.cell_m).astype(int)
        rows, columns = self.known.shape
        return int(np.clip(row, 0, rows - 1)), int(np.clip(column, 0, columns - 1))

    def places(self, cells: Int[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """Middles of cells [row, column], m."""
        return np.asarray(self.origin + (cells[:, ::-1] + 0.5) * self.cell_m)

    def passable(self, body_m: float) -> Bool[np.ndarray, "rows columns"]:
        """Known free cells at least half a body away from occupied cells."""
        clearance = ndimage.distance_transform_edt(~self.occupied) * self.cell_m
        return np.asarray(self.known & ~self.occupied & (clearance >= body_m))

    def frontier(self) -> Bool[np.ndarray, "rows columns"]:
        """Known free cells with an unknown neighbour."""
        unknown = ndimage.binary_dilation(
            np.pad(~self.known, 1, constant_values=True), np.ones((3, 3), bool)
        )
        return np.asarray(self.known & ~self.occupied & unknown[1:-1, 1:-1])


@dataclass
class _Target:
    place: Float[np.ndarray, "2"]
    fresh: bool  # a frontier, not ground to see again
    best_m: float = math.inf  # shortest remaining path so far
    best_s: float = 0.0  # stamp of that


class Explorer:
    """Chooses targets; remembers the present one and those to leave alone."""

    def __init__(
        self, config: ExplorationConfig | None = None, robot: RobotModel = DARWIN_OP
    ) -> None:
        self._config = config or ExplorationConfig()
        self._body_m = robot.breadth * BODY_M
        self._target: _Target | None = None
        self._shunned: list[tuple[Float[np.ndarray, "2"], float]] = []
        self.visited = 0
        """Number of targets reached or seen from a distance."""

    def goal(
        self, ground: ExplorationMap, here: Float[np.ndarray, "2"], stamp_s: float
    ) -> Float[np.ndarray, "2"]:
        """The present goal on the path to the target, world frame, m; `here` without a target."""
        self._shunned = [(place, until) for place, until in self._shunned if until > stamp_s]
        paths = _Paths(ground, here, self._body_m)
        if self._target is not None and self._is_done(self._target, ground, paths, here, stamp_s):
            self._target = None
        if self._target is None:
            self._target = self._choose(ground, paths, stamp_s)
        if self._target is None:
            return here
        return paths.ahead(self._target.place, self._config.ahead_m)

    def _is_done(
        self,
        target: _Target,
        ground: ExplorationMap,
        paths: _Paths,
        here: Float[np.ndarray, "2"],
        stamp_s: float,
    ) -> bool:
        if float(np.hypot(*(target.place - here))) < ARRIVE_M:
            self.visited += 1
            self._shun(target, stamp_s)  # everything visible from there has been seen
            return True
        if target.fresh and not _near(ground, ground.frontier(), target.place):
            self.visited += 1
            return True
        left = paths.length(target.place)
        if left < target.best_m - PROGRESS_M:
            target.best_m, target.best_s = left, stamp_s
        if not math.isfinite(left) or stamp_s - target.best_s > self._config.patience_s:
            self._shun(target, stamp_s)
            return True
        return False

    def _shun(self, target: _Target, stamp_s: float) -> None:
        self._shunned.append((target.place, stamp_s + SHUN_S))

    def _choose(self, ground: ExplorationMap, paths: _Paths, stamp_s: float) -> _Target | None:
        best = self._best_frontier(ground, paths)
        if best is not None:
            return _Target(best, True, paths.length(best), stamp_s)
        longest = self._longest_unseen(ground, paths)
        return None if longest is None else _Target(longest, False, paths.length(longest), stamp_s)

    def _best_frontier(
        self, ground: ExplorationMap, paths: _Paths
    ) -> Float[np.ndarray, "2"] | None:
        frontier = ground.frontier()
        labels = ndimage.label(frontier, np.ones((3, 3)))[0][frontier]
        by_label = np.argwhere(frontier)[np.argsort(labels, kind="stable")]
        best, found = 0.0, None
        for cells in np.split(by_label, np.cumsum(np.bincount(labels))[1:-1]):
            length = len(cells) * ground.cell_m
            if length < self._config.least_frontier_m:
                continue
            stand = paths.nearest(cells)
            if stand is None or self._is_shunned(stand):
                continue
            gain = length / (SETTLE_M + paths.length(stand))
            if gain > best:
                best, found = gain, stand
        return found

    def _longest_unseen(
        self, ground: ExplorationMap, paths: _Paths
    ) -> Float[np.ndarray, "2"] | None:
        cells = np.argwhere(np.isfinite(paths.metres) & (paths.metres > ARRIVE_M))
        order = np.argsort(ground.updated_s[tuple(cells.T)], kind="stable")
        for place in ground.places(cells[order[:: max(1, len(order) // SAMPLES)]]):
            if not self._is_shunned(place):
                return np.asarray(place)
        return None

    def _is_shunned(self, place: Float[np.ndarray, "2"]) -> bool:
        near = SHUN_M
        return any(float(np.hypot(*(place - other))) < near for other, _ in self._shunned)


class _Paths:
    """Shortest paths from one point to every passable cell, with straight and diagonal steps."""

    def __init__(self, ground: ExplorationMap, here: Float[np.ndarray, "2"], body_m: float) -> None:
        self._ground = ground
        passable = ground.passable(body_m)
        start = ground.cell(here)
        rows, columns = np.ogrid[: passable.shape[0], : passable.shape[1]]
        around = np.hypot(rows - start[0], columns - start[1]) * ground.cell_m <= 1.5 * body_m
        passable |= around & ~ground.occupied  # the robot can leave the place where it stands
        self._index = np.full(passable.shape, -1)
        self._cells = np.argwhere(passable)
        self._index[tuple(self._cells.T)] = np.arange(len(self._cells))
        self.metres = np.full(passable.shape, np.inf)
        """Length of the path to each cell; infinite without one."""
        self._before: np.ndarray = np.zeros(0, np.int32)
        if self._index[start] < 0:
            return
        graph = _lattice(self._index, ground.cell_m)
        lengths, before = sparse.csgraph.dijkstra(
            graph, indices=self._index[start], return_predecessors=True
        )
        self.metres[tuple(self._cells.T)] = lengths
        self._before = before

    def length(self, place: Float[np.ndarray, "2"]) -> float:
        """Length of the path to a point, m."""
        return float(self.metres[self._ground.cell(place)])

    def nearest(self, cells: Int[np.ndarray, "n 2"]) -> Float[np.ndarray, "2"] | None:
        """The reachable point nearest to the middle of some cells; None beyond STAND_M."""
        middle = cells[np.argmin(np.hypot(*(cells - cells.mean(axis=0)).T))]
        reach = math.ceil(STAND_M / self._ground.cell_m)
        low = np.maximum(middle - reach, 0)
        row, column = (slice(*ends) for ends in zip(low, middle + reach + 1, strict=True))
        near = np.argwhere(np.isfinite(self.metres[row, column])) + low
        away = np.hypot(*(near - middle).T) * self._ground.cell_m
        if not np.any(away <= STAND_M):
            return None
        return self._ground.places(near[np.argmin(away)][None])[0]

    def ahead(self, place: Float[np.ndarray, "2"], most_m: float) -> Float[np.ndarray, "2"]:
        """The point at most `most_m` along the path to a point."""
        at = self._index[self._ground.cell(place)]
        if at < 0 or not math.isfinite(self.length(place)):
            return place
        lengths = self.metres[tuple(self._cells.T)]
        if lengths[at] <= most_m:
            return place
        while lengths[at] > most_m:
            at = self._before[at]
        return self._ground.places(self._cells[at][None])[0]


def _lattice(index: Int[np.ndarray, "rows columns"], cell_m: float) -> sparse.csr_array:
    """Graph of passable cells, eight neighbours, edges in metres, both directions."""
    ends, weights = [], []
    for i, j in ((0, 1), (1, 0), (1, 1), (1, -1)):
        rows, columns = index.shape
        a = index[: rows - i, max(0, -j) : columns - max(0, j)]
        b = index[i:, max(0, j) : columns + min(0, j)]
        both = (a >= 0) & (b >= 0)
        ends.append(np.stack([a[both], b[both]]))
        weights.append(np.full(int(both.sum()), cell_m * math.hypot(i, j)))
    first, second = np.concatenate(ends, axis=1).astype(np.int32)  # all that scipy 1.11 accepts
    weight = np.concatenate(weights)
    count = int(index.max()) + 1
    graph = sparse.coo_array((weight, (first, second)), shape=(count, count))
    return (graph + graph.T).tocsr()


def _near(
    ground: ExplorationMap, cells: Bool[np.ndarray, "rows columns"], place: Float[np.ndarray, "2"]
) -> bool:
    """Whether one of the cells lies within SIGHT_M of a point."""
    row, column = ground.cell(place)
    reach = round(SIGHT_M / ground.cell_m)
    return bool(
        cells[
            max(row - reach, 0) : row + reach + 1, max(column - reach, 0) : column + reach + 1
        ].any()
    )
