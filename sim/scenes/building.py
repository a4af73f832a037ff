"""The building: the flat scaled to twenty rooms along two corridors.

Four rows of five rooms; a corridor lies between the first two rows and another one between the last two. Every room has
a doorway to its corridor, and the rooms at both ends of the inner rows have one to each other, so that the corridors and
these rooms form a loop. The goals are round tours through all rooms; a small robot walks one in half an hour.

Each room has its furniture, floor and tags of its own; some have a person who walks to and fro. A harder building has
narrower doorways, leaves less open, more furniture, and more and faster people. Source: ours.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from perception.primitives.errors import SurefootError
from perception.primitives.landmark import Landmark
from perception.primitives.pose import Pose2

from ..free_space import ClearanceMap, clearance_map
from ..scene import Extent, FloorArea, MovingObject, Place, Scene, StaticObject
from ..shapes import distance
from .difficulty import USUAL, interpolated, interpolated_count, interpolated_span
from .flat import FLOORS, NEEDED, ROOM_DRAWS, WALKER_RADIUS_M, Doorway, draw_doorway, inner_wall
from .furniture import Piece, furnish, model_of
from .home import free_spot, with_numbered_names
from .public_places import PERSON_RADIUS_M, path_of, person
from .rooms import WALL_THICKNESS_M, walls
from .tags import place_tags

COLUMNS = 5  # rooms of a row
ROOM_M = (2.8, 2.6)  # ours: usual width, and depth
CORRIDOR_M = 1.4  # ours: width; offices have 1.2 to 2 m
SHIFT_M = 0.2  # ours: of a wall between two rooms of a row
TOURS = 4  # ours: more than an hour holds
GOAL_M = 0.34  # ours: clearance at goals, for turning
BESIDE_M = 0.45  # ours: distance of a place in front of a doorway from the wall
ROOM_TAGS, CORRIDOR_TAGS = 10, 22  # ours: 244 of 250
_COLOURS = ("wall/cream", "wall/sky", "wall/sage", "wall/white")


@dataclass(frozen=True)
class Room:
    """A room with its doorways; the first leads to its corridor.

    Args:
        extent: Between its walls, m.
        doorways: Of this room.
        front: Place in its corridor in front of its doorway, m.
    """

    extent: Extent
    doorways: tuple[Doorway, ...]
    front: Place


@dataclass(frozen=True)
class _Furnished:
    pieces: list[Piece]
    space: ClearanceMap
    spot: Place


def building(seed: int, difficulty: float = USUAL) -> Scene:
    """The building of a seed.

    Raises:
        SurefootError: A room cannot be furnished.
    """
    rng = np.random.default_rng([seed, 43])
    rooms, corridors, doorways, inside = _plan(rng, difficulty)
    names = [str(name) for name in rng.permutation(list(NEEDED) * COLUMNS)]
    furnished = [
        _furnish(room, name, rng, difficulty) for room, name in zip(rooms, names, strict=True)
    ]
    people = _people(rooms, furnished, rng, difficulty)
    pieces = with_numbered_names([piece for one in furnished for piece in one.pieces])
    extent = (0.0, 0.0, rooms[-1].extent[2], rooms[-1].extent[3])
    still = (*walls(extent, _COLOURS), *inside, *pieces)
    start = Pose2(corridors[0][0] + 0.6, _middle(corridors[0]), 0.0)
    places = [(one.extent, furnished[k].spot, ROOM_TAGS) for k, one in enumerate(rooms)]
    places += [(one, (start.x, _middle(one)), CORRIDOR_TAGS) for one in corridors]
    plates, landmarks = _tags(places, still)
    return Scene(
        "building",
        seed,
        extent,
        _flooring(rooms, names, extent),
        still + plates,
        people,
        landmarks,
        start,
        TOURS * _tour(rooms, [one.spot for one in furnished]),
        rooms=(*(one.extent for one in rooms), *corridors),
        doorways=tuple((*one.middle, one.width_m) for one in doorways),
    )


def _plan(
    rng: np.random.Generator, difficulty: float
) -> tuple[list[Room], tuple[Extent, Extent], list[Doorway], list[StaticObject]]:
    """Rooms row by row from the south, corridors, all doorways, and the inner walls with door leaves."""
    wide, deep = ROOM_M
    t, right = WALL_THICKNESS_M, COLUMNS * (wide + WALL_THICKNESS_M) - WALL_THICKNESS_M
    rows: list[tuple[float, float]] = []
    corridors: list[tuple[float, float]] = []
    at = 0.0
    for kind in "rcrrcr":  # rows and corridors from the south
        height = deep if kind == "r" else CORRIDOR_M
        (rows if kind == "r" else corridors).append((at, at + height))
        at += height + t
    halls = tuple((0.0, low, right, high) for low, high in corridors)
    rooms: list[Room] = []
    inside: list[StaticObject] = []
    for row, (low, high) in enumerate(rows):
        shifts = rng.uniform(-SHIFT_M, SHIFT_M, COLUMNS - 1)
        cuts = [(k + 1) * (wide + t) - t / 2 + float(shift) for k, shift in enumerate(shifts)]
        edges = [-t / 2, *cuts, right + t / 2]
        above = row % 2 == 0  # the corridor is north of the first and the third row
        wall_y = high + t / 2 if above else low - t / 2
        own = []
        for a, b in itertools.pairwise(edges):
            extent = (a + t / 2, low, b - t / 2, high)
            door = draw_doorway(wall_y, (extent[0], extent[2]), True, rng, difficulty)
            door = replace(door, side=-1 if above else 1)  # it opens into the room
            own.append(Room(extent, (door,), (door.middle[0], _middle(halls[row // 2]))))
        wall = inner_wall(
            wall_y, (0.0, right), True, tuple(one.doorways[0] for one in own), _COLOURS[row]
        )
        inside += wall
        for k, cut in enumerate(cuts):
            inside += inner_wall(cut, (low, high), False, (), _COLOURS[(row + k) % 4])
        rooms += own
    passages = []
    for column in (0, COLUMNS - 1):
        south, north = rooms[COLUMNS + column], rooms[2 * COLUMNS + column]
        ends = (max(south.extent[0], north.extent[0]), min(south.extent[2], north.extent[2]))
        door = draw_doorway(south.extent[3] + t / 2, ends, True, rng, difficulty)
        passages.append(door)
        rooms[COLUMNS + column] = replace(south, doorways=(*south.doorways, door))
        rooms[2 * COLUMNS + column] = replace(north, doorways=(*north.doorways, door))
    inside += inner_wall(rows[1][1] + t / 2, (0.0, right), True, tuple(passages), "wall/cream")
    doorways = [one.doorways[0] for one in rooms] + passages
    inside += [StaticObject("door", (one.leaf,), 0.6, wall=True) for one in doorways]
    return rooms, (halls[0], halls[1]), doorways, inside


def _furnish(room: Room, name: str, rng: np.random.Generator, difficulty: float) -> _Furnished:
    """Furniture of a room that leaves its doorways and a spot to turn connected."""
    kept_free = tuple(shape for one in room.doorways for shape in (one.leaf, one.approach))
    wanted = tuple(
        model_of(kind) for kind in NEEDED[name][: interpolated_count(difficulty, 2, 3, 5)]
    )
    passage_m = interpolated(difficulty, 0.72, 0.66, 0.50)
    radius_m = interpolated(difficulty, 0.24, 0.24, WALKER_RADIUS_M)
    entries = [beside(one, room) for one in room.doorways]
    x0, y0, x1, y1 = room.extent
    for _ in range(10 * ROOM_DRAWS):
        pieces = furnish(
            room.extent, StaticObject("doors", kept_free), wanted, rng, passage_m, least=1
        )
        if pieces is None:
            continue
        parts = [part for piece in pieces for part in piece.static_object.parts]
        space = clearance_map(room.extent, parts + [one.leaf for one in room.doorways])
        spot = free_spot(space, (x0, x1), (y0, y1), GOAL_M, rng)
        if spot is None or min(math.dist(spot, entry) for entry in entries) < 0.5:
            continue
        reach = space.reachable(spot, radius_m)
        if all(reach[space.cell(entry)] for entry in entries):
            return _Furnished(pieces, space, spot)
    raise SurefootError(f"building: no {name} can be crossed; choose another seed")


def beside(doorway: Doorway, room: Room) -> Place:
    """The place in a room in front of its doorway, m."""
    south = doorway.middle[1] < _middle(room.extent)
    return (doorway.middle[0], doorway.middle[1] + (BESIDE_M if south else -BESIDE_M))


def _middle(extent: Extent) -> float:
    """y of the middle, m."""
    return (extent[1] + extent[3]) / 2


def _tour(rooms: Sequence[Room], spots: Sequence[Place]) -> tuple[Place, ...]:
    """Goals of a round tour: east through the southern rooms, back west through the northern ones."""
    last = COLUMNS - 1
    south, inner, far, north = (range(COLUMNS * row, COLUMNS * (row + 1)) for row in range(4))
    goals: list[Place] = []

    def visit(k: int) -> None:
        goals.extend((rooms[k].front, spots[k], rooms[k].front))

    def cross(a: int, b: int) -> None:
        door = rooms[a].doorways[1]
        goals.extend((rooms[a].front, spots[a], beside(door, rooms[a]), beside(door, rooms[b])))
        goals.extend((spots[b], rooms[b].front))

    visit(south[0])
    for column in range(1, COLUMNS):
        visit(south[column])
        if column < last:
            visit(inner[column])
    cross(inner[last], far[last])
    visit(north[last])
    for column in range(last - 1, 0, -1):
        visit(far[column])
        visit(north[column])
    visit(north[0])
    cross(far[0], inner[0])
    return tuple(goals)


def _people(
    rooms: Sequence[Room],
    furnished: Sequence[_Furnished],
    rng: np.random.Generator,
    difficulty: float,
) -> tuple[MovingObject, ...]:
    """People who walk to and fro in rooms of their own, off the spots and the doorways; as many as fit."""
    speeds = interpolated_span(difficulty, (0.02, 0.04), (0.03, 0.06), (0.05, 0.09))
    number = interpolated_count(difficulty, 2, 5, 8)
    found: list[MovingObject] = []
    for k in rng.permutation(len(rooms)):
        if len(found) == number:
            break
        room, own = rooms[k], furnished[k]
        x0, y0, x1, y1 = room.extent
        kept = [own.spot, *(beside(one, room) for one in room.doorways)]
        for _ in range(ROOM_DRAWS):
            place = (float(rng.uniform(x0, x1)), float(rng.uniform(y0, y1)))
            heading, length = float(rng.uniform(-math.pi, math.pi)), float(rng.uniform(0.6, 1.2))
            speed = float(rng.uniform(*speeds))
            one = person(len(found), place, heading, speed, length / speed)
            if _keeps_clear(one, own.space, kept):
                found.append(one)
                break
    return tuple(found)


def _keeps_clear(one: MovingObject, space: ClearanceMap, kept: Sequence[Place]) -> bool:
    """Whether a person's segment is free, off all these places, and never parts one of them from another."""
    line = path_of(one)
    if any(space.at(place) < PERSON_RADIUS_M + 0.02 for place in line):
        return False
    if any(math.dist(place, goal) < 0.65 for place in line for goal in kept):
        return False
    for place in line[::3]:
        blocked = space.with_disc(place, PERSON_RADIUS_M)
        reach = blocked.reachable(kept[0], WALKER_RADIUS_M)
        if not all(reach[blocked.cell(goal)] for goal in kept):
            return False
    return True


def _tags(
    places: Sequence[tuple[Extent, Place, int]], still: Sequence[StaticObject]
) -> tuple[tuple[StaticObject, ...], tuple[Landmark, ...]]:
    """Tags of all rooms: extent, a free place and greatest number of each."""
    plates: list[StaticObject] = []
    landmarks: list[Landmark] = []
    for extent, spot, count in places:
        x0, y0, x1, y1 = extent
        corners = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])
        centre = corners.mean(axis=0)[None]
        reach = WALL_THICKNESS_M + float(np.hypot(x1 - x0, y1 - y0)) / 2
        near = tuple(
            item
            for item in still
            if min(float(distance(part, centre)[0]) for part in item.parts) < reach
        )
        own, marks = place_tags(extent, near, Pose2(*spot), count, first=len(landmarks))
        plates += own
        landmarks += marks
    return tuple(plates), tuple(landmarks)


def _flooring(rooms: Sequence[Room], names: Sequence[str], extent: Extent) -> tuple[FloorArea, ...]:
    own = zip(rooms, names, strict=True)
    areas = (FloorArea(FLOORS[name], room.extent) for room, name in own if name in FLOORS)
    return (FloorArea("planks/walnut", extent), *areas)
