"""A scene whose movers follow other laws than it was drawn with: laws, sizes and speeds by the seed.

Source: ours; a small robot moves at 0.03 to 0.15 m/s, people a little faster, as in the hall.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ..free_space import clearance_map
from ..scene import TO_AND_FRO, Legs, MovingObject, Scene
from ..shapes import Cylinder
from .ground import Ground
from .law import LAWS, MIXED, MoversConfig

ROBOT_MPS, PERSON_MPS = (0.03, 0.15), (0.04, 0.18)
WIDER, HIGHER = (0.8, 1.25), (0.85, 1.15)  # ours: size of a mover over the drawn one
PERSON_M = 1.0  # ours: who is taller is a person
EMPTY_M = 0.12  # ours: radius of the movers of a scene that has none
EMPTY_COUNT = 3  # ours: of these movers
TO_START_M = 1.0  # ours: of these movers
_HEAD = 0.08
_LEG_M, _LEGS_APART, _SWING_M = 0.75, 1.0, 0.08
"""Height of the legs, m; distance between them in radii of the trunk; swing, half a step of 16 cm."""
_LEG_RADIUS = 0.32  # in radii of the trunk


def populated(scene: Scene, config: MoversConfig) -> Scene:
    """The scene with its movers as configured; the same scene for the defaults.

    A scene without movers gets three small robots, if another law than to and fro is asked for.
    """
    movers = scene.moving_objects
    if config.law != TO_AND_FRO:
        rng = np.random.default_rng([scene.seed, 21])
        movers = movers or _drawn(scene, rng)
        names = [str(name) for name in rng.choice(LAWS, len(movers))]
        if config.law != MIXED:
            names = [config.law] * len(movers)
        movers = tuple(_varied(one, name, rng) for one, name in zip(movers, names, strict=True))
    if config.legs:
        movers = tuple(_on_legs(one) for one in movers)
    return scene if movers is scene.moving_objects else replace(scene, moving_objects=movers)


def _varied(one: MovingObject, law: str, rng: np.random.Generator) -> MovingObject:
    """A mover with another law, speed and size, on the same segment."""
    wide, high = float(rng.uniform(*WIDER)), float(rng.uniform(*HIGHER))
    speed = float(rng.uniform(*(PERSON_MPS if one.height_m > PERSON_M else ROBOT_MPS)))
    length = one.speed_mps * one.reversal_s
    parts = tuple(
        replace(
            part,
            centre=(part.centre[0] * wide, part.centre[1] * wide, part.centre[2] * high),
            radius=part.radius * wide,
            height=part.height * high,
        )
        for part in one.parts
    )
    return replace(one, law=law, parts=parts, speed_mps=speed, reversal_s=length / speed)


def _on_legs(one: MovingObject) -> MovingObject:
    """A person whose trunk stands on two legs; small robots stay as they are."""
    if one.height_m <= PERSON_M or one.legs is not None:
        return one
    trunk, *rest = one.parts
    wide = trunk.radius
    legs = Legs(_LEG_RADIUS * wide, _LEG_M, _LEGS_APART * wide, _SWING_M, trunk.material)
    height = trunk.top_m - _LEG_M
    upper = replace(trunk, centre=(0.0, 0.0, _LEG_M + height / 2), height=height)
    return replace(one, parts=(upper, *rest), legs=legs)


def _drawn(scene: Scene, rng: np.random.Generator) -> tuple[MovingObject, ...]:
    """Small robots at free places away from the start, as many as have room."""
    space = clearance_map(scene.extent, [part for _, part in scene.static_shapes])
    start = (scene.start.x, scene.start.y)
    first = scene.goals[0] if scene.goals else start
    ground = Ground(space, EMPTY_M * WIDER[1], first, start, scene.goals)
    found: list[MovingObject] = []
    for k, colour in enumerate(("orange", "lime", "violet")[:EMPTY_COUNT]):
        for _ in range(60):
            place = ground.place(rng)
            away = [math.dist(place, other.start) for other in found]
            if min([math.dist(place, start) - TO_START_M, *(d - 0.6 for d in away)]) > 0.0:
                break
        else:
            continue  # no room for one more
        height = float(rng.uniform(0.40, 0.50))
        body = Cylinder(
            (0.0, 0.0, (height - _HEAD) / 2), EMPTY_M, height - _HEAD, f"stripes/{colour}"
        )
        top = Cylinder((0.0, 0.0, height - _HEAD / 2), 0.7 * EMPTY_M, _HEAD, "stripes/slate")
        headings = rng.uniform(-math.pi, math.pi, 6).tolist()
        length, heading = max((_line_m(ground, place, one), one) for one in headings)
        found.append(
            MovingObject(f"robot {k + 1}", place, heading, 0.05, length / 0.05, (body, top))
        )
    return tuple(found)


def _line_m(ground: Ground, place: tuple[float, float], heading: float) -> float:
    """Length of a free segment from a place, 0.1 to 1.5 m."""
    c, s = math.cos(heading), math.sin(heading)
    length = 0.1
    while length < 1.5 and ground.allows(
        place[0] + c * (length + 0.1), place[1] + s * (length + 0.1)
    ):
        length += 0.1
    return length
