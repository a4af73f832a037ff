"""Rooms: the finished map of a walk divided into rooms, the doorways between them, and floors of joined rooms.

The clearance of a free cell is its distance to the nearest cell that is not free. Rooms are hills of the clearance, and
doorways the saddles between them: cells are taken from the highest clearance downwards, a cell without neighbours begins
a room, and one where two rooms meet joins them, unless it is a doorway: much narrower than the smaller of both, and no
wider than a doorway may be. Furniture makes saddles too, but hardly narrower than the floor beside it.

The map is one of probabilities, and so are the sizes: a cell that is free with a probability has a part in the variance
of an area and, beside a doorway, of a width.

Source: rooms by distance transform and watershed as compared by Bormann et al. 2016 (ICRA); joining by the height of
saddles: topological persistence, Edelsbrunner et al. 2002. The rule for doorways is ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Int
from scipy import ndimage

from .world_map import WorldMap

FREE_BELOW = 0.5  # as for planners: a cell of a lower probability can be walked on
SPECK_CELLS = 3  # ours: fewer occupied cells amid the floor are noise
HOLE_M2 = 0.10  # ours: unseen floor this small, as under the robot's chin, is floor
WIDEST_M = 0.95  # ours: doorways of homes are 0.6 to 0.9 m wide
NARROWER = (
    0.72  # ours: clearance of a doorway by that of the smaller room; maps of seeds 100 to 103
)
LEAST_M2 = 1.5  # ours: a smaller part of the floor is no room
WALL_M, WALL_SHARE = 0.30, 0.65  # ours: a wall goes on so far behind a jamb, in this share of cells
ASIDE_CELLS = 4  # ours: which may be beside the line, as door leaves hide corners
FACING = 0.7  # ours: cosine of the angle between the directions to the two jambs, turned round
AROUND = np.ones((3, 3), np.bool_)

Saddles = dict[tuple[int, int], tuple[int, int]]
"""Two hills, the lower number first, and [row, column] of the highest saddle between them."""


@dataclass(frozen=True)
class Room:
    """A room.

    Args:
        number: Its label, from 1.
        centre: Place with the largest clearance, world frame, m.
        area_m2, sigma_m2: Free floor that was seen, with standard deviation.
    """

    number: int
    centre: tuple[float, float]
    area_m2: float
    sigma_m2: float


@dataclass(frozen=True)
class Door:
    """An opening between two rooms.

    Args:
        rooms: Their numbers, the lower one first.
        centre: Its middle, world frame, m.
        jambs: The nearest cells on both sides that are not free, world frame, m.
        width_m, sigma_m: Between the jambs, with standard deviation.
    """

    rooms: tuple[int, int]
    centre: tuple[float, float]
    jambs: tuple[tuple[float, float], tuple[float, float]]
    width_m: float
    sigma_m: float


@dataclass(frozen=True, eq=False)
class RoomMap:
    """The rooms of a map.

    Args:
        labels: Number of the room of every cell; 0 for none.
        origin: Lower left corner of cell [0, 0], world frame, m.
        cell_m: Side of a cell, m.
        rooms: In the order of their numbers.
        doors: In the order of their rooms.
        floors: Numbers of the rooms that are joined by doors, for each storey, the largest first.
    """

    labels: Int[np.ndarray, "rows columns"]
    origin: Float[np.ndarray, "2"]
    cell_m: float
    rooms: tuple[Room, ...]
    doors: tuple[Door, ...]
    floors: tuple[tuple[int, ...], ...]


def rooms_of(world: WorldMap) -> RoomMap:
    """The rooms of a world map; see `find`."""
    return find(world.probability, world.known, world.origin, world.cell_m)


def find(
    probability: Float32[np.ndarray, "rows columns"],
    known: Bool[np.ndarray, "rows columns"],
    origin: Float[np.ndarray, "2"],
    cell_m: float,
) -> RoomMap:
    """Divide a map into rooms.

    Args:
        probability: Of an obstacle in each cell.
        known: Whether the cell was seen.
        origin: Lower left corner of cell [0, 0], world frame, m.
        cell_m: Side of a cell, m.
    """
    free = _floor(probability, known, cell_m)
    standing = known & ~free
    clearance = ndimage.distance_transform_edt(np.pad(free, 1))[1:-1, 1:-1] * cell_m
    hills, saddles = _joined(*_divide(clearance, standing, cell_m), clearance, cell_m)
    numbers = {int(hill): k + 1 for k, hill in enumerate(np.unique(hills[hills > 0]))}
    labels = np.zeros_like(hills)
    for hill, number in numbers.items():
        labels[hills == hill] = number
    variance = np.where(known, probability * (1.0 - probability), 0.0)
    rooms = []
    for number in numbers.values():
        inside = labels == number
        row, column = np.unravel_index(np.argmax(np.where(inside, clearance, -1.0)), labels.shape)
        x, y = _places(np.array([[row, column]]), origin, cell_m)[0].tolist()
        area, sigma = inside.sum() * cell_m**2, math.sqrt(variance[inside].sum()) * cell_m**2
        rooms.append(Room(number, (x, y), float(area), sigma))
    doors = []
    for (one, other), cell in saddles.items():
        first, second = sorted((numbers[one], numbers[other]))
        jambs = _jambs(cell, free, cell_m)
        assert jambs is not None  # else it were no doorway
        doors.append(_door((first, second), jambs, variance, origin, cell_m))
    doors.sort(key=lambda door: door.rooms)
    return RoomMap(labels, origin, cell_m, tuple(rooms), tuple(doors), _floors(rooms, doors))


def _floor(
    probability: Float32[np.ndarray, "rows columns"],
    known: Bool[np.ndarray, "rows columns"],
    cell_m: float,
) -> Bool[np.ndarray, "rows columns"]:
    """Free floor without specks and small holes."""
    free = known & (probability < FREE_BELOW)
    occupied, _ = ndimage.label(known & ~free, AROUND)
    free |= known & (np.bincount(occupied.ravel())[occupied] < SPECK_CELLS)
    unseen, _ = ndimage.label(~known)
    small = np.bincount(unseen.ravel())[unseen] * cell_m**2 < HOLE_M2
    beside = ndimage.binary_dilation(free, AROUND)
    walled = np.zeros(unseen.max() + 1, np.bool_)  # holes that touch something that stands
    walled[np.unique(unseen[ndimage.binary_dilation(known & ~free, AROUND)])] = True
    return np.asarray(free | (~known & small & beside & ~walled[unseen]))


def _divide(
    clearance: Float[np.ndarray, "rows columns"],
    standing: Bool[np.ndarray, "rows columns"],
    cell_m: float,
) -> tuple[Int[np.ndarray, "rows columns"], Saddles]:
    """Hills of the clearance, from 1, and the highest saddle between each two that meet in a doorway."""
    rows, columns = clearance.shape
    labels = np.zeros((rows, columns), np.int64)
    order = np.argsort(-clearance, axis=None, kind="stable")
    parent, peak = [0], [0.0]
    saddles: Saddles = {}

    def root(hill: int) -> int:
        while parent[hill] != hill:
            hill = parent[hill]
        return hill

    for flat in order[: np.count_nonzero(clearance > 0.0)].tolist():
        row, column = divmod(flat, columns)
        height = float(clearance[row, column])
        part = np.s_[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2]
        around = labels[part]
        if not around.any():
            labels[row, column] = len(parent)
            parent.append(len(parent))
            peak.append(height)
            continue
        uphill = np.argmax(np.where(around > 0, clearance[part], -1.0))
        labels[row, column] = around.ravel()[uphill]
        hills = {root(hill) for hill in around[around > 0].tolist()}
        first, *others = sorted(hills, key=lambda hill: (-peak[hill], hill))
        for other in others:
            pair = (min(first, other), max(first, other))
            if pair in saddles:
                continue
            narrow = height < NARROWER * peak[other] and 2.0 * height - cell_m <= WIDEST_M
            if narrow and _in_wall((row, column), clearance, standing, cell_m):
                saddles[pair] = (row, column)
            else:
                parent[other] = first
                saddles = _merged(saddles, other, first, clearance)
    roots = np.array([root(hill) for hill in range(len(parent))])
    return roots[labels], saddles


def _merged(
    saddles: Saddles, one: int, into: int, clearance: Float[np.ndarray, "rows columns"]
) -> Saddles:
    """The saddles after one hill has become part of another; into none (0), its saddles are gone."""
    moved: Saddles = {}
    for (a, b), cell in saddles.items():
        a, b = (into if a == one else a), (into if b == one else b)
        pair = (min(a, b), max(a, b))
        if a == b or 0 in pair:
            continue
        if pair not in moved or clearance[cell] > clearance[moved[pair]]:
            moved[pair] = cell
    return moved


def _in_wall(
    cell: tuple[int, int],
    clearance: Float[np.ndarray, "rows columns"],
    standing: Bool[np.ndarray, "rows columns"],
    cell_m: float,
) -> bool:
    """Whether the line across a saddle goes on in a thin wall behind both of its jambs."""
    jambs = _jambs(cell, clearance > 0.0, cell_m)
    if jambs is None:
        return False
    along = (jambs[1] - jambs[0]) / np.hypot(*(jambs[1] - jambs[0]))
    outward, aside = np.mgrid[: round(WALL_M / cell_m), -ASIDE_CELLS : ASIDE_CELLS + 1]
    across, size = np.array([-along[1], along[0]]), np.array(standing.shape) - 1
    for jamb, ahead in ((jambs[0], -along), (jambs[1], along)):
        cells = jamb + outward[..., None] * ahead + aside[..., None] * across
        rows, columns = np.moveaxis(np.clip(np.rint(cells).astype(int), 0, size), -1, 0)
        if standing[rows, columns].mean(axis=0).max() < WALL_SHARE:
            return False
    return True


def _joined(
    hills: Int[np.ndarray, "rows columns"],
    saddles: Saddles,
    clearance: Float[np.ndarray, "rows columns"],
    cell_m: float,
) -> tuple[Int[np.ndarray, "rows columns"], Saddles]:
    """The same without small hills: each joined with its neighbour across the highest saddle, or left out."""
    hills = hills.copy()
    areas = np.bincount(hills.ravel()) * cell_m**2
    areas[0] = 0.0
    while (small := np.flatnonzero((areas > 0.0) & (areas < LEAST_M2))).size:
        one = int(small[np.argmin(areas[small])])
        beside = [(clearance[cell], pair) for pair, cell in saddles.items() if one in pair]
        into = sum(max(beside)[1]) - one if beside else 0
        hills[hills == one] = into
        areas[into] += areas[one] if into else 0.0
        areas[one] = 0.0
        saddles = _merged(saddles, one, into, clearance)
    return hills, saddles


def _jambs(
    cell: tuple[int, int], free: Bool[np.ndarray, "rows columns"], cell_m: float
) -> Int[np.ndarray, "2 2"] | None:
    """[row, column] of the nearest cells that are not free, on both sides of a saddle; None without a second."""
    reach = math.ceil(WIDEST_M / cell_m)
    low = np.maximum(np.array(cell) - reach, 0)
    part = free[low[0] : cell[0] + reach + 1, low[1] : cell[1] + reach + 1]
    there = np.argwhere(~part) + low
    away = there - np.array(cell)
    distance = np.hypot(*away.T)
    first = int(np.argmin(distance))
    across = -away @ away[first] / np.maximum(distance * distance[first], 1e-9)
    if not (across > FACING).any():
        return None
    second = int(np.argmin(np.where(across > FACING, distance, np.inf)))
    return there[[first, second]]


def _door(
    rooms: tuple[int, int],
    jambs: Int[np.ndarray, "2 2"],
    variance: Float[np.ndarray, "rows columns"],
    origin: Float[np.ndarray, "2"],
    cell_m: float,
) -> Door:
    """The opening between two jambs; cells on the line between them are doubtful as the map says."""
    ends = _places(jambs, origin, cell_m)
    apart = float(np.hypot(*(ends[1] - ends[0])))
    share = np.linspace(0.0, 1.0, 1 + 2 * round(apart / cell_m))[:, None]
    line = np.unique(np.rint(jambs[0] + share * (jambs[1] - jambs[0])).astype(int), axis=0)
    doubt = float(variance[line[:, 0], line[:, 1]].sum())
    sigma = cell_m * math.sqrt(doubt + 2.0 / 12.0)  # and where in its cell each jamb ends
    x, y = ends.mean(axis=0).tolist()
    a, b = ((float(px), float(py)) for px, py in ends)
    return Door(rooms, (x, y), (a, b), apart - cell_m, sigma)


def _floors(rooms: list[Room], doors: list[Door]) -> tuple[tuple[int, ...], ...]:
    """Numbers of the rooms that doors join, the largest group first."""
    group = {room.number: room.number for room in rooms}
    for door in doors:
        old, new = (group[number] for number in door.rooms)
        group = {number: new if one == old else one for number, one in group.items()}
    floors = [
        tuple(number for number, one in group.items() if one == name)
        for name in dict.fromkeys(group.values())
    ]
    return tuple(sorted(floors, key=lambda floor: (-len(floor), floor)))


def _places(
    cells: Int[np.ndarray, "n 2"], origin: Float[np.ndarray, "2"], cell_m: float
) -> Float[np.ndarray, "n 2"]:
    """Middles of cells [row, column], world frame, m."""
    return np.asarray(origin + (cells[:, ::-1] + 0.5) * cell_m)
