"""Larger scenes: an office full of desks, and a hall that people cross."""

from __future__ import annotations

import math

import numpy as np

from perception.primitives.errors import SurefootError
from perception.primitives.pose import Pose2

from ..free_space import ClearanceMap, clearance_map
from ..scene import Extent, MovingObject, Place, Scene, StaticObject
from ..shapes import Box, Cylinder, Shape
from .difficulty import USUAL, Span, interpolated, interpolated_count, interpolated_span
from .furniture import model_of, place_piece
from .rooms import scene_with_tags, walls

OFFICE_M = (0.0, 0.0, 7.0, 5.0)
HALL_M = (0.0, 0.0, 8.0, 5.0)
DRAWS = 60  # ours
WALKER_RADIUS_M = 0.28  # ours: body of 0.15 and a margin for planning
PEOPLE = (2, 5, 6)  # ours: in the hall, at difficulty 0, 0.5 and 1
PERSON_RADIUS_M = 0.18  # ours
PERSON_HEIGHT_M = 1.60  # ours
SPEEDS_MPS = (0.04, 0.12)  # ours: scaled to a small robot of 0.1 m/s


_CLOTHES = ("navy", "rust", "plum", "teal", "mustard")


def office(seed: int, difficulty: float = USUAL) -> Scene:
    """Two rows of desks with chairs, shelves at the walls, and bins in the aisle.

    In a harder office the rows stand closer to the middle of the room and more bins lie between them.
    """
    rng = np.random.default_rng([seed, 40])
    extent = OFFICE_M
    start, goals = Pose2(0.5, 2.5, 0.0), ((6.5, 2.5), (6.4, 0.5), (0.6, 4.5))
    rows = interpolated_span(difficulty, (1.25, 3.75), (1.15, 3.85), (1.05, 3.95))
    for _ in range(DRAWS):
        static_objects = [*walls(extent, ("wall/white", "wall/sky", "wall/cream", "wall/sage"))]
        for k, (x, y) in enumerate((x, y) for y in rows for x in (1.7, 3.5, 5.3)):
            shift = rng.uniform(-0.12, 0.12, 2)
            place = (x + float(shift[0]), y + float(shift[1]))
            static_objects.append(StaticObject(f"desk {k + 1}", _desk(place)))
            towards_aisle = 1.0 if y < 2.5 else -1.0
            seat = (place[0] + float(rng.uniform(-0.3, 0.3)), place[1] + towards_aisle * 0.55)
            chair = place_piece(model_of("chair"), seat, float(rng.uniform(-math.pi, math.pi)), rng)
            static_objects.append(StaticObject(f"chair {k + 1}", chair.parts, chair.albedo))
        static_objects.append(
            place_piece(model_of("bookshelf"), (3.5, extent[3] - 0.18), -math.pi / 2, rng)
        )
        for k in range(interpolated_count(difficulty, 1, 3, 5)):
            place = (float(rng.uniform(1.2, 5.8)), float(rng.uniform(2.2, 2.8)))
            litter = place_piece(model_of("bin"), place, float(rng.uniform(-math.pi, math.pi)), rng)
            static_objects.append(StaticObject(f"bin {k + 1}", litter.parts, litter.albedo))
        if _can_be_walked(extent, static_objects, start, goals):
            return scene_with_tags(
                "office",
                seed,
                extent,
                "tiles/grey",
                tuple(static_objects),
                (),
                start,
                goals,
                tags=24,
            )
    raise SurefootError(
        f"office: no draw of {DRAWS} with seed {seed} can be crossed; choose another seed"
    )


def hall(seed: int, difficulty: float = USUAL) -> Scene:
    """A bare hall with two pillars and a bench, where people walk back and forth between the long walls.

    In a harder hall more people walk faster and closer together between more pillars.
    """
    rng = np.random.default_rng([seed, 41])
    extent = HALL_M
    start, goals = Pose2(0.6, 2.5, 0.0), ((7.4, 2.5), (7.2, 0.6))
    static_objects = [*walls(extent, ("wall/cream", "wall/white", "wall/sky", "wall/white"))]
    for k, x in enumerate(np.linspace(2.6, 5.4, interpolated_count(difficulty, 1, 2, 3))):
        y = float(rng.uniform(1.8, 3.2))
        static_objects.append(
            StaticObject(
                f"pillar {k + 1}", (Cylinder((float(x), y, 1.2), 0.18, 2.4, "plaster/grey"),)
            )
        )
    bench = Box((4.0, 4.6, 0.21), (1.4, 0.38, 0.42), 0.0, "wood/walnut")
    static_objects.append(StaticObject("bench", (bench,)))
    spots = ((start.x, start.y), *goals)
    for _ in range(DRAWS):
        people = _people(static_objects, spots, difficulty, rng)
        if len(people) == interpolated_count(difficulty, *PEOPLE):
            return scene_with_tags(
                "hall",
                seed,
                extent,
                "tiles/grey",
                tuple(static_objects),
                people,
                start,
                goals,
                tags=24,
            )
    raise SurefootError(
        f"hall: in no draw of {DRAWS} with seed {seed} do all people keep apart; choose another seed"
    )


def _desk(place: Place) -> tuple[Shape, ...]:
    """A top on two side panels, 1.2 m wide and 0.6 m deep."""
    x, y = place
    top = Box((x, y, 0.70), (1.2, 0.6, 0.04), 0.0, "wood/pine")
    sides = (Box((x + s * 0.57, y, 0.34), (0.04, 0.56, 0.68), 0.0, "wood/pine") for s in (-1, 1))
    return (top, *sides)


def _people(
    static_objects: list[StaticObject],
    spots: tuple[Place, ...],
    difficulty: float,
    rng: np.random.Generator,
) -> tuple[MovingObject, ...]:
    """People placed one after the other; fewer than wanted if there is no room."""
    shapes = [part for item in static_objects if not item.wall for part in item.parts]
    space = clearance_map(HALL_M, shapes)
    speeds = interpolated_span(difficulty, (0.03, 0.08), SPEEDS_MPS, (0.06, 0.18))
    apart_m = interpolated(difficulty, 0.8, 0.6, 0.42)
    people: tuple[MovingObject, ...] = ()
    for k in range(interpolated_count(difficulty, *PEOPLE)):
        for _ in range(DRAWS):
            one = _person(k, HALL_M, rng, speeds)
            if _keeps_apart(one, people, space, spots, apart_m):
                people = (*people, one)
                break
        else:
            break
    return people


def _person(
    k: int, extent: tuple[float, ...], rng: np.random.Generator, speeds_mps: Span
) -> MovingObject:
    """A person who walks from one long wall to the other, nearly straight across."""
    x = float(rng.uniform(1.4, extent[2] - 1.4))
    margin = PERSON_RADIUS_M + 0.15
    upwards = bool(rng.integers(2))
    y = margin if upwards else extent[3] - margin
    heading = (1.0 if upwards else -1.0) * (math.pi / 2 + float(rng.uniform(-0.3, 0.3)))
    length = (extent[3] - 2 * margin - 0.8) / abs(math.sin(heading))
    speed = float(rng.uniform(*speeds_mps))
    return person(k, (x, y), heading, speed, length / speed)


def person(
    k: int, start: Place, heading_rad: float, speed_mps: float, reversal_s: float
) -> MovingObject:
    """Person number k, from 0, walking back and forth, with clothes by number."""
    trunk = Cylinder(
        (0.0, 0.0, 0.72), PERSON_RADIUS_M, 1.44, f"fabric/{_CLOTHES[k % len(_CLOTHES)]}"
    )
    head = Cylinder((0.0, 0.0, PERSON_HEIGHT_M - 0.08), 0.09, 0.16, "plaster/clay")
    name = f"person {k + 1}"
    return MovingObject(name, start, heading_rad, speed_mps, reversal_s, (trunk, head), 0.5)


def _keeps_apart(
    one: MovingObject,
    others: tuple[MovingObject, ...],
    space: ClearanceMap,
    spots: tuple[Place, ...],
    apart_m: float,
) -> bool:
    """Whether a person's segment stays clear of the others', of start and goals, and of objects."""
    line = path_of(one)
    if any(math.dist(place, spot) < 0.7 for place in line for spot in spots):
        return False
    if any(space.at(place) < PERSON_RADIUS_M + 0.1 for place in line):
        return False
    return all(
        math.dist(a, b) > apart_m for other in map(path_of, others) for a in line for b in other
    )


def path_of(moving_object: MovingObject) -> list[Place]:
    """Places along a moving object's segment, (x, y), m."""
    return [
        moving_object.state(float(s))[:2] for s in np.linspace(0.0, moving_object.reversal_s, 25)
    ]


def _can_be_walked(
    extent: Extent, static_objects: list[StaticObject], start: Pose2, goals: tuple[Place, ...]
) -> bool:
    shapes = [part for item in static_objects if not item.wall for part in item.parts]
    space = clearance_map(extent, shapes)
    reach = space.reachable((start.x, start.y), WALKER_RADIUS_M)
    return all(bool(reach[space.cell(goal)]) for goal in goals)
