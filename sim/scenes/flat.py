"""The flat: four rooms in a ring with doorways, open door leaves, and people who walk through them.

Each room has its own floor, furniture and walls. The start is in one room, the goals are in the other three, the first
of them two doorways away in either direction, so a person in one doorway leaves the other route open. A harder flat
has narrower doorways, leaves less open, more furniture, and more and faster people.

Source: ours; doorways of homes are 0.6 to 0.9 m wide.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from perception.primitives.errors import SurefootError
from perception.primitives.pose import Pose2

from ..free_space import ClearanceMap, clearance_map
from ..scene import Extent, FloorArea, MovingObject, Place, Scene, StaticObject
from ..shapes import Box, Shape
from .difficulty import USUAL, interpolated, interpolated_count, interpolated_span
from .furniture import Piece, furnish, model_of
from .home import free_spot, with_numbered_names
from .public_places import PERSON_RADIUS_M, path_of, person
from .rooms import WALL_HEIGHT_M, WALL_THICKNESS_M, heading_towards, walls
from .tags import place_tags

EXTENT = (0.0, 0.0, 7.2, 5.6)
DOOR_HEIGHT_M = 2.0
LEAF_M = 0.04  # ours: thickness
WALKER_RADIUS_M = 0.20  # ours: body of 0.15 and the guard's margin; fits a doorway of 0.5 m
DRAWS = 100  # ours
ROOM_DRAWS = 20  # ours
GOAL_M = 0.32  # ours: clearance at start and goals, for turning
TAGS = 44  # ours: the dictionary has 50

NEEDED = {
    "living room": ("sofa", "bookshelf", "armchair", "plant", "coffee table"),
    "kitchen": ("kitchen", "chair", "bin", "sideboard", "chair"),
    "bedroom": ("cupboard", "pouf", "plant", "cartons", "armchair"),
    "study": ("bookshelf", "chair", "cartons", "bin", "pouf"),
}
FLOORS = {"living room": "planks/oak", "kitchen": "tiles/grey", "bedroom": "planks/pine"}
_RUGS = {"living room": ("rug/teal", "rug/rust"), "bedroom": ("rug/plum", "rug/navy")}
_APPROACH_M = 0.25  # ours: kept free on both sides of a doorway


@dataclass(frozen=True)
class Doorway:
    """An opening in an inner wall, with its door leaf.

    Args:
        middle: (x, y), m.
        width_m: Between the jambs.
        along_x: Whether the wall runs along x, else along y.
        hinge, side: -1 or 1: jamb of the hinge, and side of the wall to which the leaf opens.
        open_rad: Opening angle of the leaf.
    """

    middle: Place
    width_m: float
    along_x: bool
    hinge: int
    side: int
    open_rad: float

    @property
    def along(self) -> np.ndarray:
        """Unit vector along the wall."""
        return np.array([1.0, 0.0]) if self.along_x else np.array([0.0, 1.0])

    @property
    def across(self) -> np.ndarray:
        """Unit vector through the doorway."""
        return np.array([0.0, 1.0]) if self.along_x else np.array([1.0, 0.0])

    @property
    def leaf(self) -> Box:
        """The open door leaf."""
        swung = math.sin(self.open_rad) * self.side * self.across
        ahead = swung - math.cos(self.open_rad) * self.hinge * self.along
        jamb = np.array(self.middle) + self.hinge * self.width_m / 2 * self.along
        hung = jamb + self.side * WALL_THICKNESS_M / 2 * self.across
        x, y = (float(v) for v in hung + ahead * self.width_m / 2)
        yaw = math.atan2(float(ahead[1]), float(ahead[0]))
        size = (self.width_m, LEAF_M, DOOR_HEIGHT_M)
        return Box((x, y, DOOR_HEIGHT_M / 2), size, yaw, "wood/cream")

    @property
    def approach(self) -> Box:
        """The opening and the ground on both sides of it."""
        depth = WALL_THICKNESS_M + 2 * _APPROACH_M
        across = (self.width_m, depth) if self.along_x else (depth, self.width_m)
        return Box((*self.middle, 1.0), (*across, 2.0))


@dataclass(frozen=True)
class _Plan:
    """Rooms counter-clockwise from the south-west, and the doorway from each to the next."""

    rooms: tuple[Extent, ...]
    doorways: tuple[Doorway, ...]
    building: tuple[StaticObject, ...]
    space: ClearanceMap


@dataclass(frozen=True)
class _Layout:
    static_objects: tuple[StaticObject, ...]
    space: ClearanceMap
    start: Pose2
    goals: tuple[Place, ...]


def flat(seed: int, difficulty: float = USUAL) -> Scene:
    """The flat of a seed.

    Raises:
        SurefootError: No draw can be crossed.
    """
    rng = np.random.default_rng([seed, 42])
    for _ in range(DRAWS):
        plan = _plan(rng, difficulty)
        names = [str(name) for name in rng.permutation(list(NEEDED))]
        layout = _lay_out(plan, names, rng, difficulty)
        people = None if layout is None else _people(plan, layout, rng, difficulty)
        if layout is None or people is None:
            continue
        plates, landmarks = place_tags(
            EXTENT, layout.static_objects, layout.start, TAGS, others=layout.goals
        )
        return Scene(
            "flat",
            seed,
            EXTENT,
            _flooring(plan, names, rng),
            layout.static_objects + plates,
            people,
            landmarks,
            layout.start,
            layout.goals,
        )
    raise SurefootError(
        f"flat: no draw of {DRAWS} with seed {seed} can be crossed; choose another seed"
    )


def _plan(rng: np.random.Generator, difficulty: float) -> _Plan:
    x0, y0, x1, y1 = EXTENT
    half = WALL_THICKNESS_M / 2
    x, west, east = (float(rng.uniform(*ends)) for ends in ((3.3, 3.9), (2.5, 3.1), (2.5, 3.1)))
    low, high = min(west, east) - half, max(west, east) + half
    doorways = (
        draw_doorway(x, (y0, low), False, rng, difficulty),
        draw_doorway(east, (x + half, x1), True, rng, difficulty),
        draw_doorway(x, (high, y1), False, rng, difficulty),
        draw_doorway(west, (x0, x - half), True, rng, difficulty),
    )
    rooms = (
        (x0, y0, x - half, west - half),
        (x + half, y0, x1, east - half),
        (x + half, east + half, x1, y1),
        (x0, west + half, x - half, y1),
    )
    south, right, north, left = doorways
    inner = (
        *inner_wall(x, (y0, y1), False, (south, north), "wall/cream"),
        *inner_wall(east, (x + half, x1), True, (right,), "wall/sky"),
        *inner_wall(west, (x0, x - half), True, (left,), "wall/sage"),
    )
    leaves = (StaticObject("door", (doorway.leaf,), 0.6, wall=True) for doorway in doorways)
    outer = walls(EXTENT, ("wall/sky", "wall/cream", "wall/sage", "wall/white"))
    building = (*outer, *inner, *leaves)
    space = clearance_map(EXTENT, [part for item in building for part in item.parts])
    return _Plan(rooms, doorways, building, space)


def draw_doorway(
    at: float, ends: tuple[float, float], along_x: bool, rng: np.random.Generator, difficulty: float
) -> Doorway:
    """A doorway between the ends of a wall, its leaf clear of both corners."""
    width = float(
        rng.uniform(*interpolated_span(difficulty, (0.80, 0.90), (0.65, 0.80), (0.50, 0.60)))
    )
    open_deg = float(
        rng.uniform(*interpolated_span(difficulty, (100.0, 130.0), (90.0, 120.0), (85.0, 105.0)))
    )
    swung = width * max(0.0, -math.cos(math.radians(open_deg)))
    corner = width / 2 + max(0.30, swung + 0.05)
    along = float(rng.uniform(ends[0] + corner, ends[1] - corner))
    hinge, side = (int(sign) for sign in rng.choice((-1, 1), 2))
    middle = (along, at) if along_x else (at, along)
    return Doorway(middle, width, along_x, hinge, side, math.radians(open_deg))


def inner_wall(
    at: float,
    ends: tuple[float, float],
    along_x: bool,
    doorways: tuple[Doorway, ...],
    material: str,
) -> list[StaticObject]:
    """Pieces of an inner wall beside and above its doorways, given in rising order."""
    jambs = [ends[0]]
    for doorway in doorways:
        along = doorway.middle[0 if along_x else 1]
        jambs += [along - doorway.width_m / 2, along + doorway.width_m / 2]
    jambs.append(ends[1])
    pieces = []
    for k, (begin, end) in enumerate(itertools.pairwise(jambs)):
        bottom = DOOR_HEIGHT_M if k % 2 else 0.0
        middle, height = (begin + end) / 2, WALL_HEIGHT_M - bottom
        place = (middle, at) if along_x else (at, middle)
        size = (end - begin, WALL_THICKNESS_M) if along_x else (WALL_THICKNESS_M, end - begin)
        box = Box((*place, bottom + height / 2), (*size, height), 0.0, material)
        pieces.append(StaticObject("wall", (box,), 0.75, wall=True))
    return pieces


def _lay_out(
    plan: _Plan, names: list[str], rng: np.random.Generator, difficulty: float
) -> _Layout | None:
    """Furniture, start and goals; None if they are incompatible."""
    pieces: list[Piece] = []
    for room, name in zip(plan.rooms, names, strict=True):
        found = _furnish(plan, room, name, pieces, rng, difficulty)
        if found is None:
            return None
        pieces += found
    static_objects = plan.building + tuple(with_numbered_names(pieces))
    space = _space(plan, pieces)
    spots = [
        free_spot(space, (room[0], room[2]), (room[1], room[3]), GOAL_M, rng) for room in plan.rooms
    ]
    first = int(rng.integers(4))
    places = [spots[(first + turn) % 4] for turn in (0, 2, 1, 3)]
    start, *goals = (place for place in places if place is not None)
    if len(goals) < 3:
        return None
    path = space.path(start, goals[0], WALKER_RADIUS_M)
    reach = space.reachable(start, WALKER_RADIUS_M)
    if path is None or not all(reach[space.cell(goal)] for goal in goals):
        return None
    heading = heading_towards(start, tuple(path[min(12, len(path) - 1)]))
    return _Layout(static_objects, space, Pose2(*start, heading), tuple(goals))


def _furnish(
    plan: _Plan,
    room: Extent,
    name: str,
    others: list[Piece],
    rng: np.random.Generator,
    difficulty: float,
) -> list[Piece] | None:
    """Furniture of one room that keeps all doorways connected; None if none was found."""
    kept_free: tuple[Shape, ...] = tuple(
        shape for doorway in plan.doorways for shape in (doorway.leaf, doorway.approach)
    )
    wanted = tuple(
        model_of(kind) for kind in NEEDED[name][: interpolated_count(difficulty, 2, 4, 5)]
    )
    passage_m = interpolated(difficulty, 0.66, 0.58, 0.50)
    least = interpolated_count(difficulty, 1, 3, 3)
    for _ in range(ROOM_DRAWS):
        pieces = furnish(room, StaticObject("doors", kept_free), wanted, rng, passage_m, least)
        if pieces is None:
            continue
        space = _space(plan, others + pieces)
        reach = space.reachable(plan.doorways[0].middle, WALKER_RADIUS_M)
        if all(reach[space.cell(doorway.middle)] for doorway in plan.doorways):
            return pieces
    return None


def _space(plan: _Plan, pieces: list[Piece]) -> ClearanceMap:
    """Clearance among building and furniture."""
    still = clearance_map(EXTENT, [part for piece in pieces for part in piece.static_object.parts])
    free = np.minimum(plan.space.clearance, still.clearance)
    return ClearanceMap(still.origin, still.cell_m, free)


def _people(
    plan: _Plan, layout: _Layout, rng: np.random.Generator, difficulty: float
) -> tuple[MovingObject, ...] | None:
    """People who each walk back and forth through a doorway of their own; None if they do not fit."""
    speeds = interpolated_span(difficulty, (0.02, 0.04), (0.03, 0.06), (0.05, 0.09))
    found: list[MovingObject] = []
    number = interpolated_count(difficulty, 1, 2, 3)
    for index in rng.permutation(len(plan.doorways)):
        doorway = plan.doorways[index]
        for _ in range(ROOM_DRAWS):
            sense = 1.0 if rng.integers(2) else -1.0
            before, behind = (float(d) for d in rng.uniform(0.6, 1.2, 2))
            speed = float(rng.uniform(*speeds))
            x, y = (float(v) for v in np.array(doorway.middle) - sense * before * doorway.across)
            heading = math.atan2(*(sense * doorway.across[::-1]))
            length = before + behind
            one = person(len(found), (x, y), heading, speed, length / speed)
            if _keeps_clear(one, layout, found):
                found.append(one)
                break
        if len(found) == number:
            return tuple(found)
    return None


def _keeps_clear(one: MovingObject, layout: _Layout, others: list[MovingObject]) -> bool:
    """Whether a person's segment is free, away from start and goals, and always leaves another route."""
    line = path_of(one)
    start = (layout.start.x, layout.start.y)
    if any(layout.space.at(place) < PERSON_RADIUS_M + 0.01 for place in line):
        return False
    if any(math.dist(place, start) < 0.9 for place in line):
        return False
    if any(math.dist(place, goal) < 0.65 for place in line for goal in layout.goals):
        return False
    if any(math.dist(a, b) < 0.6 for other in others for a in line for b in path_of(other)):
        return False
    for place in line[::2]:
        blocked = layout.space.with_disc(place, PERSON_RADIUS_M)
        reach = blocked.reachable(start, WALKER_RADIUS_M)
        if not all(reach[blocked.cell(goal)] for goal in layout.goals):
            return False
    return True


def _flooring(plan: _Plan, names: list[str], rng: np.random.Generator) -> tuple[FloorArea, ...]:
    areas = [FloorArea("planks/walnut", EXTENT)]
    for room, name in zip(plan.rooms, names, strict=True):
        if name in FLOORS:
            areas.append(FloorArea(FLOORS[name], room))
        if name in _RUGS:
            x = float(rng.uniform(room[0] + 0.4, room[2] - 2.0))
            y = float(rng.uniform(room[1] + 0.3, room[3] - 1.4))
            rug = str(rng.choice(_RUGS[name]))
            areas.append(FloorArea(rug, (x, y, x + 1.6, y + 1.1)))
    return tuple(areas)
