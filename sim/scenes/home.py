"""The furnished home: a living and a dining room with a wide opening, drawn by the seed.

Furniture is placed along the walls first, then inside the rooms; small robots move back and forth across the path to
the first goal. Layouts that a body of 28 cm radius cannot cross at every position of the robots are drawn again. A
harder home has more pieces, narrower passages, a longer partition, and more and faster robots. For a broader robot the
rooms and passages grow with it, and the furniture stays as it is. Source: ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from perception.primitives.errors import SurefootError
from perception.primitives.pose import Pose2

from ..free_space import ClearanceMap, clearance_map
from ..rendering.textures import MOST_TAGS
from ..scene import Extent, FloorArea, MovingObject, Place, Scene, StaticObject
from ..shapes import Box, distance
from .difficulty import USUAL, interpolated, interpolated_count, interpolated_span
from .furniture import CATALOGUE, LEAST_PIECES, PASSAGE_M, Model, Piece, furnish
from .rooms import heading_towards, small_robot, walls
from .tags import place_tags
from .walker import SMALL, Walker

SIZE_M = (6.4, 5.0)  # ours; this and all lengths below for a breadth of 1
WALKER_RADIUS_M = 0.28  # ours: body of 0.15 and a margin for planning
DRAWS = 200  # ours: seeds 0 to 19 need one to three
_MOVER_RADIUS_M = 0.10
_COLOURS = ("orange", "lime", "violet", "navy", "red")


@dataclass(frozen=True)
class _Layout:
    walker: Walker
    static_objects: tuple[StaticObject, ...]
    space: ClearanceMap
    path: np.ndarray
    start: Place
    goals: tuple[Place, ...]


def home(seed: int, difficulty: float = USUAL, walker: Walker = SMALL) -> Scene:
    """The home of a seed, for a robot."""
    b = walker.breadth
    extent = (0.0, 0.0, b * SIZE_M[0], b * SIZE_M[1])
    rng = np.random.default_rng([seed, 1])
    for _ in range(DRAWS):
        layout = _lay_out(rng, difficulty, extent, walker)
        moving_objects = None if layout is None else _set_going(layout, rng, difficulty)
        if layout is None or moving_objects is None:
            continue
        if not _worth_crossing(layout, moving_objects, difficulty):
            continue
        heading = heading_towards(layout.start, tuple(layout.path[min(12, len(layout.path) - 1)]))
        start = Pose2(*layout.start, heading)
        plates, landmarks = place_tags(
            extent,
            layout.static_objects,
            start,
            count=min(MOST_TAGS, round(24 * b)),
            cell_m=0.25 * b,
        )
        return Scene(
            "home",
            seed,
            extent,
            _flooring(rng, extent, b),
            layout.static_objects + plates,
            moving_objects,
            landmarks,
            start,
            layout.goals,
        )
    raise SurefootError(
        f"home: no draw of {DRAWS} with seed {seed} can be crossed; choose another seed"
    )


def _flooring(rng: np.random.Generator, extent: Extent, b: float) -> tuple[FloorArea, ...]:
    _, y0, x1, y1 = extent
    rug = str(rng.choice(["rug/teal", "rug/rust", "rug/plum", "rug/navy"]))
    x, y = float(rng.uniform(0.9, 1.3)), float(rng.uniform(1.4, 2.0))
    return (
        FloorArea("planks/oak", extent),
        FloorArea("tiles/grey", (4.7 * b, y0, x1, y1)),
        FloorArea(rug, (x, y, x + 1.7, y + 1.2)),
    )


def _lay_out(
    rng: np.random.Generator, difficulty: float, extent: Extent, walker: Walker
) -> _Layout | None:
    """Furniture, start and goals; None if they are incompatible."""
    b, radius_m = walker.breadth, walker.breadth * WALKER_RADIUS_M
    partition_y = b * float(
        rng.uniform(*interpolated_span(difficulty, (0.6, 1.0), (1.0, 1.5), (1.5, 2.0)))
    )
    partition_x = b * float(rng.uniform(3.1, 3.7))
    from_south = bool(rng.integers(2))
    middle = partition_y / 2 if from_south else extent[3] - partition_y / 2
    partition = StaticObject(
        "wall",
        (Box((partition_x, middle, 1.2), (0.12, partition_y, 2.4), 0.0, "wall/cream"),),
        0.75,
        wall=True,
    )
    building = (*walls(extent, ("wall/sky", "wall/cream", "wall/sage", "wall/white")), partition)
    pieces = furnish(
        extent,
        partition,
        _models(difficulty),
        rng,
        b * interpolated(difficulty, 0.80, PASSAGE_M, 0.60),
        interpolated_count(difficulty, 6, LEAST_PIECES, 11),
    )
    if pieces is None:
        return None
    static_objects = building + tuple(with_numbered_names(pieces))
    space = clearance_map(
        extent,
        [*partition.parts, *(p for t in pieces for p in t.static_object.parts)],
        top_m=walker.top_m,
    )

    def spot(x: tuple[float, float], y: tuple[float, float]) -> Place | None:
        return free_spot(space, (b * x[0], b * x[1]), (b * y[0], b * y[1]), b * 0.36, rng)

    start, first = spot((0.4, 1.9), (0.4, 4.6)), spot((4.9, 6.0), (0.4, 4.6))
    if start is None or first is None or math.dist(start, first) < 4.0 * b:
        return None
    path = space.path(start, first, radius_m)
    reach = space.reachable(start, radius_m)
    others = [spot(*box) for box in (((2.2, 4.6), (1.6, 4.4)), ((0.4, 2.2), (0.4, 4.6)))]
    if path is None or any(goal is None or not reach[space.cell(goal)] for goal in others):
        return None
    goals = (first, *(goal for goal in others if goal is not None))
    return _Layout(walker, static_objects, space, path, start, goals)


def _models(difficulty: float) -> tuple[Model, ...]:
    """Furniture of a home; a hard one has the small pieces twice."""
    small = tuple(model for model in CATALOGUE[7:12])
    most = len(CATALOGUE)
    return (CATALOGUE + small)[: interpolated_count(difficulty, 8, most, most + len(small))]


def with_numbered_names(pieces: list[Piece]) -> list[StaticObject]:
    """The pieces as static objects, numbered where a name occurs more than once."""
    names = [piece.static_object.name for piece in pieces]
    found = []
    for k, piece in enumerate(pieces):
        number = f" {names[: k + 1].count(names[k])}" if names.count(names[k]) > 1 else ""
        found.append(replace(piece.static_object, name=names[k] + number))
    return found


def free_spot(
    space: ClearanceMap,
    x_range: tuple[float, float],
    y_range: tuple[float, float],
    clearance_m: float,
    rng: np.random.Generator,
) -> tuple[float, float] | None:
    """A random place within the ranges with that clearance; None if 60 draws find none."""
    for _ in range(60):
        place = (round(float(rng.uniform(*x_range)), 2), round(float(rng.uniform(*y_range)), 2))
        if space.at(place) >= clearance_m:
            return place
    return None


def _set_going(
    layout: _Layout, rng: np.random.Generator, difficulty: float
) -> tuple[MovingObject, ...] | None:
    """Small robots, usually three, clear of furniture, start and goals, that never block the path."""
    moving_objects: list[MovingObject] = []
    for k, colour in enumerate(_COLOURS[: interpolated_count(difficulty, 1, 3, 5)]):
        for _ in range(60):
            candidate = _draw_robot(k, colour, layout, rng, difficulty)
            if _keeps_clear(candidate, layout, moving_objects):
                moving_objects.append(candidate)
                break
        else:
            return None
    return tuple(moving_objects)


def _draw_robot(
    k: int, colour: str, layout: _Layout, rng: np.random.Generator, difficulty: float
) -> MovingObject:
    """The first two cross or follow the path, the others are anywhere."""
    speeds = interpolated_span(difficulty, (0.02, 0.04), (0.03, 0.06), (0.05, 0.09))
    speed, reversal = float(rng.uniform(*speeds)), float(rng.uniform(15.0, 25.0))
    heading, b = float(rng.uniform(-math.pi, math.pi)), layout.walker.breadth
    if k < 2:
        share = rng.uniform(0.25, 0.5) if k == 0 else rng.uniform(0.5, 0.75)
        middle = layout.path[int(share * (len(layout.path) - 1))] + rng.normal(0, 0.15, 2)
    else:
        middle = b * np.array([rng.uniform(0.5, 5.9), rng.uniform(0.5, 4.5)])
    half = speed * reversal / 2
    start = (
        float(middle[0] - half * math.cos(heading)),
        float(middle[1] - half * math.sin(heading)),
    )
    height = float(rng.uniform(0.40, 0.50))
    return small_robot(f"robot {k + 1}", start, heading, speed, reversal, colour, height)


def _keeps_clear(moving_object: MovingObject, layout: _Layout, others: list[MovingObject]) -> bool:
    b = layout.walker.breadth
    line = [
        (x, y)
        for x, y, _, _ in (
            moving_object.state(s) for s in np.linspace(0.0, moving_object.reversal_s, 12)
        )
    ]
    if any(layout.space.at(place) < _MOVER_RADIUS_M + 0.10 for place in line):
        return False
    if any(math.dist(place, layout.start) < 0.9 * b for place in line):
        return False
    if any(math.dist(place, goal) < 0.55 * b for place in line for goal in layout.goals):
        return False
    for other in others:
        ends = [other.state(s)[:2] for s in np.linspace(0.0, other.reversal_s, 12)]
        if any(math.dist(here, there) < 0.6 * b for here in line for there in ends):
            return False
    for place in line[::2]:  # it can be passed at every position
        reach = layout.space.with_disc(place, _MOVER_RADIUS_M).reachable(
            layout.start, b * WALKER_RADIUS_M
        )
        if not all(reach[layout.space.cell(goal)] for goal in layout.goals):
            return False
    return True


def _worth_crossing(
    layout: _Layout, moving_objects: tuple[MovingObject, ...], difficulty: float
) -> bool:
    """Whether there are enough obstacles near the path: usually six within a metre, two of them moving."""
    near_m = layout.walker.breadth
    standing = sum(
        min(float(distance(part, layout.path).min()) for part in item.parts) < near_m
        for item in layout.static_objects
        if not item.wall
    )
    moving = sum(
        min(
            float(np.hypot(*(layout.path - np.array(moving_object.state(s)[:2])).T).min())
            for s in np.linspace(0.0, moving_object.reversal_s, 12)
        )
        < near_m
        for moving_object in moving_objects
    )
    enough = interpolated_count(difficulty, 3, 6, 8), interpolated_count(difficulty, 1, 2, 2)
    return standing + moving >= enough[0] and moving >= enough[1]
