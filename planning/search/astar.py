"""A* on the terrain map.

F(k) = E(k) + C(k): E is the length of the path to node k plus alpha times the potential integrated along it, C an estimate
of the rest. C is the length of the shortest lattice path at the least cost of the map, the largest admissible estimate
without obstacles: the path costs as much as Dijkstra's, with a third of the nodes that the straight distance expands.
If the goal lies outside the map, C is the straight distance.

Source: seed 003, section 3 (evaluation function, equation lost) and ambiguities 3 to 5.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Bool, Float, Int

from perception.primitives.errors import InputError
from perception.primitives.robot_model import DARWIN_OP, RobotModel

from . import _lattice_kernels as kernels
from ._potential_kernels import free_disc
from .path import Path as Path
from .path import Terrain as Terrain
from .path import clearance
from .path import lattice_cost as lattice_cost
from .potential import Reach, SearchConfig, terrain
from .shortcuts import shortcut, start_at

BUCKET = 0.25
"""Ours: width of a bucket of the queue, in cells, for which nodes are seldom expanded twice."""

MOST_PRICES = 1e6
"""Ours: largest cost divided by the width of a bucket, which limits the number of buckets."""


def prepare(
    probability: Float[np.ndarray, "rows columns"],
    unknown: Bool[np.ndarray, "rows columns"],
    origin: Float[np.ndarray, "2"],
    cell_m: float,
    start_xy: Float[np.ndarray, "2"],
    config: SearchConfig,
    penalty: Float[np.ndarray, "rows columns"] | None = None,
    robot: RobotModel = DARWIN_OP,
) -> Terrain:
    """Potential and blocked cells of a map; unseen cells round the start count as free.

    Args:
        probability: p of every cell.
        unknown: Cells never seen.
        origin: Lower left corner of cell [0, 0], world frame, m.
        cell_m: Side of a cell.
        start_xy: Position of the robot, world frame, m.
        config: Margins and weights.
        penalty: Added to the potential, not negative; None for zero.
        robot: Scale of the lengths.
    """
    seen, hidden = probability.copy(), unknown.copy()
    x, y = ((start_xy - origin) / cell_m - 0.5).tolist()
    free_disc(seen, hidden, x, y, Reach.of(config, robot).start_m, cell_m)
    strength, blocked = terrain(seen, hidden, cell_m, config, robot)
    if penalty is not None:
        strength = strength + penalty
    hard = ~hidden & (seen >= config.p_solid)
    return Terrain(1.0 + config.alpha * strength, blocked, hard, origin.astype(np.float64), cell_m)


def find_path(
    probability: Float[np.ndarray, "rows columns"],
    unknown: Bool[np.ndarray, "rows columns"],
    origin: Float[np.ndarray, "2"],
    cell_m: float,
    start_xy: Float[np.ndarray, "2"],
    goal_xy: Float[np.ndarray, "2"],
    config: SearchConfig,
    robot: RobotModel = DARWIN_OP,
) -> Path | None:
    """The cheapest path over the map, with shortcuts.

    A goal outside the map is approached through the border cell of least F on its sides of the map, or through any
    border cell if these cannot be reached. A blocked start or goal moves to the nearest free node.

    Args:
        probability: p of every cell [row, column], rows along y, columns along x.
        unknown: Cells never seen; they have p_unknown and do not block.
        origin: Lower left corner of cell [0, 0], world frame, m.
        cell_m: Side of a cell.
        start_xy, goal_xy: World frame, m.
        config: Margins and weights.
        robot: Scale of the lengths.

    Returns:
        The path; None if there is none.

    Raises:
        InputError: Start or goal is not finite, the start lies outside the map, or the map is malformed.

    Source: seed 003, section 3 and ambiguities 3 to 5.
    """
    _check(probability, origin, cell_m, start_xy, goal_xy)
    ground = prepare(probability, unknown, origin, cell_m, start_xy, config, None, robot)
    return search(ground, start_xy, goal_xy, config, robot)


def search(
    ground: Terrain,
    start_xy: Float[np.ndarray, "2"],
    goal_xy: Float[np.ndarray, "2"],
    config: SearchConfig,
    robot: RobotModel = DARWIN_OP,
) -> Path | None:
    """`find_path` on a prepared map."""
    start = _nearest_free(ground, start_xy)
    if start is None:
        return None
    x, y = ground.to_cells(goal_xy)
    rows, columns = ground.blocked.shape
    if -0.5 <= x < columns - 0.5 and -0.5 <= y < rows - 0.5:
        target = _nearest_free(ground, goal_xy)
        assert target is not None, "there is one beside the start"
        cells = cheapest(ground.price, ground.blocked, start, target, config.literal)
    else:
        cells = _leave(ground, start, (float(y), float(x)), config.literal)
    if cells is None:
        return None
    return _path(ground, cells, start_xy, goal_xy, Reach.of(config, robot).turn_m)


def cheapest(
    price: Float[np.ndarray, "rows columns"],
    blocked: Bool[np.ndarray, "rows columns"],
    start: tuple[int, int],
    goal: tuple[int, int],
    literal: bool = False,
) -> Int[np.ndarray, "n 2"] | None:
    """The cheapest path on the 8-neighbour lattice between two nodes; `lattice_cost` is its cost.

    Args:
        price: Cost per cell of path at each node, at least 1.
        blocked: Nodes that the body cannot enter.
        start, goal: [row, column] on the map.
        literal: Rank nodes by L + alpha U(k) + C with the potential of the node only; not optimal.

    Returns:
        Cells [row, column] from start to goal; None if there is no path, or either of them is blocked.
    """
    if blocked[start]:
        return None
    aim = float(goal[0]), float(goal[1])
    return _run(price, blocked, start, aim, np.array([goal]), True, literal)


def _leave(
    ground: Terrain, start: tuple[int, int], goal: tuple[float, float], literal: bool
) -> np.ndarray | None:
    """Cells to the border cell of least F on the sides of the goal, or else on any side."""
    for exits in (_facing(ground.blocked.shape, goal), _border(ground.blocked.shape)):
        open_exits = np.argwhere(exits & ~ground.blocked)
        cells = _run(ground.price, ground.blocked, start, goal, open_exits, False, literal)
        if cells is not None:
            return cells
    return None


def _facing(shape: tuple[int, ...], goal: tuple[float, float]) -> np.ndarray:
    """Border cells on the sides of the goal."""
    rows, columns = shape
    exits = np.zeros((rows, columns), np.bool_)
    exits[0, :] |= goal[0] < -0.5
    exits[-1, :] |= goal[0] >= rows - 0.5
    exits[:, 0] |= goal[1] < -0.5
    exits[:, -1] |= goal[1] >= columns - 0.5
    return exits


def _border(shape: tuple[int, ...]) -> np.ndarray:
    exits = np.zeros(shape, np.bool_)
    exits[[0, -1], :] = True
    exits[:, [0, -1]] = True
    return exits


def _run(
    price: np.ndarray,
    blocked: np.ndarray,
    start: tuple[int, int],
    goal: tuple[float, float],
    exits: np.ndarray,
    on_lattice: bool,
    literal: bool,
) -> np.ndarray | None:
    """Cells [row, column] from the start to the best exit; None if none can be reached."""
    wide = price.shape[1] + 2
    first = (start[0] + 1) * wide + start[1] + 1
    aim = goal[0] + 1.0, goal[1] + 1.0
    leaves = (exits[:, 0] + 1) * wide + exits[:, 1] + 1
    ground, least, dearest = kernels.bordered(price, blocked)
    if literal:
        found, _, state = kernels.search_literal(ground, wide, first, aim, leaves)
    else:
        width = max(BUCKET, dearest / MOST_PRICES)
        found, _, state = kernels.search(
            ground, wide, (least, dearest), first, aim, leaves, on_lattice, width
        )
    return None if found < 0 else np.asarray(kernels.trace(state, wide, first, found))


def _path(
    ground: Terrain,
    cells: np.ndarray,
    start_xy: np.ndarray,
    goal_xy: np.ndarray,
    turn_m: float,
) -> Path:
    """The path over these cells; it begins and ends at the given points if their cells are free."""
    price, blocked = ground.price, ground.blocked
    line = cells[:, ::-1].astype(np.float64)
    line = start_at(line, ground.to_cells(start_xy), price, blocked)
    line = start_at(line[::-1], ground.to_cells(goal_xy), price, blocked)[::-1]
    if len(line) == 1:
        line = np.vstack([line, line])
    kept = shortcut(line, price, blocked)
    return Path(ground, cells, line, kept, goal_xy, turn_m)


def _nearest_free(ground: Terrain, xy: np.ndarray) -> tuple[int, int] | None:
    """The nearest free cell, preferably with a free line of sight; None if all are blocked."""
    rows, columns = ground.blocked.shape
    here = ground.to_cells(xy)
    row = min(max(math.floor(here[1] + 0.5), 0), rows - 1)
    column = min(max(math.floor(here[0] + 0.5), 0), columns - 1)
    if not ground.blocked[row, column]:
        return row, column
    free = np.argwhere(~ground.blocked)
    if not len(free):
        return None
    order = np.argsort(np.hypot(*(free[:, ::-1] - here).T), kind="stable")
    for index in order[:200]:  # farther ones are not better than the nearest
        line = np.array([here, free[index, ::-1]], np.float64)
        if clearance(line, ground.solid) > 0.5:
            return int(free[index, 0]), int(free[index, 1])
    return int(free[order[0], 0]), int(free[order[0], 1])


def _check(
    probability: np.ndarray,
    origin: np.ndarray,
    cell_m: float,
    start_xy: np.ndarray,
    goal_xy: np.ndarray,
) -> None:
    for name, xy in (("start", start_xy), ("goal", goal_xy), ("origin", origin)):
        if not np.isfinite(xy).all():
            raise InputError(f"search: {name} {xy} must be finite world coordinates in m")
    rows, columns = probability.shape
    x, y = (start_xy - origin) / cell_m
    if not (0 <= x < columns and 0 <= y < rows):
        raise InputError(
            f"search: the start {start_xy} lies outside the map of {columns * cell_m:g} x "
            f"{rows * cell_m:g} m at {origin}; move the map with the robot"
        )
