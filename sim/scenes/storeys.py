"""Two storeys with a flight of stairs between them: a furnished room below, a floor above with a screen before the goal.

A wall ends the lower room, and the flight is the only opening in it; upstairs a parapet runs round the stairwell. The goal
stands behind the screen, on the side that it closes, so that it is not straight ahead of the stairs. Rooms and passages are
those of a Unitree G1, steps what it climbs with level soles; a smaller robot has room, but too short legs.

Source: ours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from perception.primitives.errors import SurefootError
from perception.primitives.pose import Pose2

from ..free_space import clearance_map
from ..scene import Extent, FloorArea, Place, Scene, StaticObject
from ..shapes import Box, Shape, Solid, convex_gap, outline
from .difficulty import USUAL, interpolated_count
from .furniture import model_of, place_piece
from .rooms import WALL_HEIGHT_M, heading_towards, walls
from .stairs import RISER_M, TREAD_M

STEPS = (5, 8)  # ours: of the flight; its height is 0.3 to 0.7 m
WIDTH_M, FLIGHT_M = (4.2, 4.8), (1.5, 1.8)  # ours: of both floors, and of the flight
LOWER_M, UPPER_M = (3.0, 3.6), (3.9, 4.4)  # ours: before the flight, and behind it
SCREEN_M, SCREEN_HIGH_M, PARAPET_M, THICK_M = (1.5, 1.8), 1.8, 0.9, 0.1
"""Ours: the screen behind the flight's end, and its height; height of the parapet; thickness of all three."""
PASSAGE_M = 1.4  # ours: beside the screen
ROOM_M = 0.46  # ours: radius of a disc that passes everywhere: a G1 needs 0.80 m
LANDING_M = 0.65  # ours: before and behind the flight
BELOW, ABOVE = ("sofa", "armchair", "coffee table", "chair", "cartons", "plant", "bin"), (
    "plant", "pouf", "chair", "bin",
)  # fmt: skip
DRAWS, TRIES = 200, 20
APART_M = 0.1  # ours: between pieces
CELL_M = 0.08  # ours: of the check that all can be reached


def storeys(seed: int, difficulty: float = USUAL) -> Scene:
    """A random pair of storeys; more difficult is more furniture."""
    rng = np.random.default_rng([seed, 53])
    for _ in range(DRAWS):
        found = _drawn(seed, difficulty, rng)
        if found is not None:
            return found
    raise SurefootError(
        f"storeys: no draw of {DRAWS} with seed {seed} can be crossed; choose another seed"
    )


def _drawn(seed: int, difficulty: float, rng: np.random.Generator) -> Scene | None:
    """One draw; None if it cannot be crossed."""
    width, flight = rng.uniform(*WIDTH_M), rng.uniform(*FLIGHT_M)
    riser, tread = rng.uniform(*RISER_M), rng.uniform(*TREAD_M)
    steps = int(rng.integers(STEPS[0], STEPS[1] + 1))
    foot = float(rng.uniform(*LOWER_M))  # x where the flight begins
    head = foot + (steps - 1) * tread  # and where the upper floor does
    high, end = steps * riser, head + rng.uniform(*UPPER_M)
    middle = float(rng.uniform(flight / 2, width - flight / 2))
    low, far = middle - flight / 2, middle + flight / 2
    treads = [_block(foot + k * tread, foot + (k + 1) * tread, low, far, 0.0, (k + 1) * riser)
              for k in range(steps - 1)]  # fmt: skip
    upper = [_block(head, end, 0.0, width, 0.0, high)]
    screen_x = head + float(rng.uniform(*SCREEN_M))
    left = bool(rng.integers(2))  # the side of the passage
    sides = (0.0, width - PASSAGE_M) if left else (PASSAGE_M, width)
    screen = _block(screen_x, screen_x + THICK_M, *sides, high, high + SCREEN_HIGH_M, "wall/sage")
    shut, rails = [], []
    for a, b, edge in ((0.0, low, low - THICK_M), (far, width, far)):
        if b - a > THICK_M:
            shut.append(_block(foot, foot + THICK_M, a, b, 0.0, WALL_HEIGHT_M, "wall/cream"))
            upper.append(_block(foot, head, a, b, 0.0, high))
            rails.append(
                _block(foot, head, edge, edge + THICK_M, high, high + PARAPET_M, "wood/oak")
            )
    ground = [
        StaticObject("flight", tuple(treads), 0.6, ground=True),
        StaticObject("upper floor", tuple(upper), 0.6, ground=True),
    ]
    still = [StaticObject("screen", (screen,), 0.7)]
    if rails:
        still += [
            StaticObject("partition", tuple(shut), 0.75, wall=True),
            StaticObject("parapet", tuple(rails), 0.6),
        ]
    behind = (screen_x + THICK_M, 0.0, end, width)
    goal = (
        float(rng.uniform(behind[0] + 0.8, end - 0.8)),
        float(rng.uniform(0.8, 1.3)) if left else width - float(rng.uniform(0.8, 1.3)),
    )
    extent = (0.0, 0.0, float(end), float(width))
    below = _furniture(BELOW, interpolated_count(difficulty, 1, 3, 5), (0.2, 0.0, foot - 0.2, width), 0.0, (), rng)  # fmt: skip
    above = _furniture(ABOVE, interpolated_count(difficulty, 0, 2, 3), (head, 0.0, end, width), high, still, rng)  # fmt: skip
    place = (float(rng.uniform(0.6, 0.9)), float(rng.uniform(0.7, width - 0.7)))
    before, top = (foot - LANDING_M, middle), (head + LANDING_M, middle)
    under = (0.0, 0.0, foot, extent[3])
    over = (float(head), 0.0, extent[2], extent[3])
    if not (_passes(under, below, place, before) and _passes(over, [*still, *above], top, goal)):
        return None
    heading = heading_towards(place, before) + float(rng.uniform(-0.3, 0.3))
    building = walls(extent, ("wall/cream", "wall/sky", "wall/white", "wall/sky"))
    return Scene(
        "storeys", seed, extent, (FloorArea("planks/oak", extent),),
        (*building, *ground, *still, *below, *above), (), (), Pose2(*place, heading), (goal,),
    )  # fmt: skip


def _block(
    x0: float, x1: float, y0: float, y1: float, z0: float, z1: float, material: str = "planks/pine"
) -> Box:
    """An upright box by its sides."""
    centre = (float(x0 + x1) / 2, float(y0 + y1) / 2, float(z0 + z1) / 2)
    return Box(centre, (float(x1 - x0), float(y1 - y0), float(z1 - z0)), 0.0, material)


def _furniture(
    kinds: Sequence[str],
    count: int,
    extent: Extent,
    floor_m: float,
    beside: Sequence[StaticObject],
    rng: np.random.Generator,
) -> list[StaticObject]:
    """Pieces at random places of a floor, apart from each other and from what is there; those that do not fit are left out."""
    found: list[StaticObject] = []
    for kind in rng.choice(kinds, count, replace=False):
        model = model_of(str(kind))
        inset = math.hypot(*model.footprint) / 2
        for _ in range(TRIES):
            place = (
                float(rng.uniform(extent[0] + inset, extent[2] - inset)),
                float(rng.uniform(extent[1] + inset, extent[3] - inset)),
            )
            piece = place_piece(model, place, float(rng.uniform(-math.pi, math.pi)), rng)
            rings = [outline(part) for part in piece.parts]
            there = [outline(part) for item in (*beside, *found) for part in item.parts]
            if min((convex_gap(a, b) for a in rings for b in there), default=1.0) > APART_M:
                parts = tuple(_raised(part, floor_m) for part in piece.parts)
                found.append(replace(piece, parts=parts))
                break
    return found


def _raised(part: Shape, by_m: float) -> Shape:
    assert not isinstance(part, Solid)  # furniture is made of boxes and cylinders
    x, y, z = part.centre
    return replace(part, centre=(x, y, z + float(by_m)))


def _passes(extent: Extent, still: Sequence[StaticObject], start: Place, goal: Place) -> bool:
    """Whether a disc of `ROOM_M` gets from one place of a floor to another."""
    shapes = [part for item in still for part in item.parts]
    space = clearance_map(extent, shapes, CELL_M, math.inf)
    reach = space.reachable(start, ROOM_M)
    return bool(reach[space.cell(goal)])
