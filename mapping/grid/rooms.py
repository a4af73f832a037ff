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

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int
from scipy import ndimage

from .hills import divide, jambs_of, joined, walls
from .world_map import WorldMap

FREE_BELOW = 0.5  # as for planners: a cell of a lower probability can be walked on
SPECK_CELLS = 3  # ours: fewer occupied cells amid the floor are noise
HOLE_M2 = 0.10  # ours: unseen floor this small, as under the robot's chin, is floor
AROUND = np.ones((3, 3), np.bool_)


@dataclass(frozen=True, eq=False)
class Room:
    """A room.

    Args:
        number: Its label, from 1.
        centre: Place with the largest clearance, world frame, m.
        area_m2, sigma_m2: Free floor that was seen, with standard deviation.
        outline: Through the middles of the cells at its border, world frame, m; holes are not cut out.
    """

    number: int
    centre: tuple[float, float]
    area_m2: float
    sigma_m2: float
    outline: Float[np.ndarray, "n 2"]


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
    standing = walls(known & ~free, cell_m)
    clearance = ndimage.distance_transform_edt(np.pad(free, 1))[1:-1, 1:-1] * cell_m
    hills, saddles = joined(*divide(clearance, standing, cell_m), clearance, cell_m)
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
        outline = _places(_outline(inside), origin, cell_m)
        rooms.append(Room(number, (x, y), float(area), sigma, outline))
    doors = []
    for (one, other), cell in saddles.items():
        first, second = sorted((numbers[one], numbers[other]))
        jambs = jambs_of(cell, free, cell_m)
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
    walled = np.zeros(unseen.max(initial=0) + 1, np.bool_)  # holes that touch something that stands
    walled[np.unique(unseen[ndimage.binary_dilation(known & ~free, AROUND)])] = True
    return np.asarray(free | (~known & small & beside & ~walled[unseen]))


def _outline(inside: Bool[np.ndarray, "rows columns"]) -> Int[np.ndarray, "n 2"]:
    """[row, column] of the corners of the longest border of a region."""
    borders, _ = cv2.findContours(
        inside.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE
    )
    longest = max(borders, key=cv2.contourArea)
    return np.asarray(longest, np.int64).reshape(-1, 2)[:, ::-1]


def _door(
    rooms: tuple[int, int],
    jambs: Int[np.ndarray, "2 2"],
    variance: Float[np.ndarray, "rows columns"],
    origin: Float[np.ndarray, "2"],
    cell_m: float,
) -> Door:
    """The opening between two jambs; cells on the line between them are doubtful as the map says.

    A cell is occupied if a part of it is, so a jamb ends anywhere in its cell: in the middle on average.
    """
    ends = _places(jambs, origin, cell_m)
    apart = float(np.hypot(*(ends[1] - ends[0])))
    share = np.linspace(0.0, 1.0, 1 + 2 * round(apart / cell_m))[:, None]
    line = np.unique(np.rint(jambs[0] + share * (jambs[1] - jambs[0])).astype(int), axis=0)
    doubt = float(variance[line[:, 0], line[:, 1]].sum())
    sigma = cell_m * math.sqrt(doubt + 2.0 / 12.0)  # and where in its cell each jamb ends
    x, y = ends.mean(axis=0).tolist()
    a, b = ((float(px), float(py)) for px, py in ends)
    return Door(rooms, (x, y), (a, b), apart, sigma)


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
