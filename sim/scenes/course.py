"""The courses of seed 001: static and moving round obstacles in a square room, and via points.

The paper's experiment specifies sixteen obstacles, four of them moving; the seed draws their positions, the size of
the room is ours. Moving obstacles react to nothing, so their segments keep clear of static obstacles and of each
other. A harder course has more obstacles, closer together, and faster moving ones.

Source: seed 001, section V-C; speeds and the hard course from a study of such walks.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from perception.primitives.errors import SurefootError
from perception.primitives.pose import Pose2

from ..scene import MovingObject, Place, Scene, StaticObject
from ..shapes import Cylinder
from .difficulty import USUAL, interpolated, interpolated_count
from .rooms import scene_with_tags, walls

STANDING, MOVING = "teal", "violet"
COLOURS = ("#347a80", "#8654b0")
"""Colours of static and of moving obstacles: seed 001 detects obstacles by colour."""

RADIUS_M = 0.10  # S_o, seed 001
HEIGHT_M = 0.40  # ours: occludes the view of a camera at 0.38 m
DRAWS = 400  # ours


@dataclass(frozen=True)
class CourseKind:
    """Parameters of a course.

    Args:
        name: Of the scene.
        side_m: Side of the room.
        standing, moving: Numbers of static and moving obstacles.
        speeds_mps: Least and greatest speed of moving obstacles.
        length_m: Length of the straight segments from the start through all via points.
        between_m: Least distance between centres of static obstacles.
    """

    name: str
    side_m: float
    standing: int
    moving: int
    speeds_mps: tuple[float, float]
    length_m: float
    between_m: float = 0.60  # ours: the robot passes between any two


SLOW = CourseKind("course", 6.0, 12, 4, (0.03, 0.06), 30.0)
FAST = CourseKind("fast_course", 6.0, 12, 4, (0.03, 0.15), 30.0)
HARD = CourseKind("hard_course", 8.0, 18, 12, (0.05, 0.20), 30.0)

REVERSAL_S = (12.0, 25.0)  # seed 000: 18 to 25 s; ours: some reverse sooner
TO_WALL_M = 0.55  # ours, from centres of static obstacles: the robot passes
LINE_TO_STANDING_M = 0.30  # ours, from a moving obstacle's segment to a static centre
LINE_TO_LINE_M = 0.25  # ours, between segments
LINE_TO_WALL_M = 0.30  # ours
LINE_TO_START_M = 0.60  # ours
VIA_TO_STANDING_M = 0.45  # ours
LEG_M = (1.5, 4.5)  # ours


def course(seed: int, difficulty: float = USUAL) -> Scene:
    """Sixteen obstacles, four of them moving at up to 0.06 m/s."""
    return draw(SLOW, seed, difficulty)


def fast_course(seed: int, difficulty: float = USUAL) -> Scene:
    """The same with moving obstacles of up to 0.15 m/s, 1.5 times the robot's speed."""
    return draw(FAST, seed, difficulty)


def hard_course(seed: int, difficulty: float = USUAL) -> Scene:
    """Thirty obstacles, twelve of them moving at up to 0.20 m/s, twice the robot's speed."""
    return draw(HARD, seed, difficulty)


def draw(kind: CourseKind, seed: int, difficulty: float = USUAL) -> Scene:
    """Draw a course.

    Raises:
        SurefootError: No draw fits the room.
    """
    rng = np.random.default_rng([seed, 5, kind.moving, round(1e3 * kind.speeds_mps[1])])
    kind = _at_difficulty(kind, difficulty)
    for _ in range(DRAWS):
        posts = _posts(kind, rng)
        start = None if posts is None else _start(kind, posts, rng)
        if posts is None or start is None:
            continue
        moving_objects = _moving_objects(kind, posts, start, rng)
        vias = _via_points(kind, posts, start, rng)
        if moving_objects is not None and vias is not None:
            return _built(kind, seed, posts, start, moving_objects, vias)
    raise SurefootError(
        f"{kind.name}: no draw of {DRAWS} with seed {seed} fits the room; choose another seed"
    )


def _at_difficulty(kind: CourseKind, difficulty: float) -> CourseKind:
    """Parameters at a difficulty; the closest pair still lets a disc of 15 cm radius through."""
    number = interpolated(difficulty, 2 / 3, 1.0, 4 / 3)
    speed = interpolated(difficulty, 0.7, 1.0, 1.3)
    slow, fast = kind.speeds_mps
    return replace(
        kind,
        standing=round(number * kind.standing),
        moving=interpolated_count(difficulty, kind.moving // 2, kind.moving, kind.moving * 3 // 2),
        speeds_mps=(speed * slow, speed * fast),
        between_m=kind.between_m * interpolated(difficulty, 1.2, 1.0, 0.9),
    )


def _posts(kind: CourseKind, rng: np.random.Generator) -> Float[np.ndarray, "n 2"] | None:
    found: list[np.ndarray] = []
    for _ in range(60 * kind.standing):
        place = rng.uniform(TO_WALL_M, kind.side_m - TO_WALL_M, 2)
        if all(math.dist(place, other) >= kind.between_m for other in found):
            found.append(place)
        if len(found) == kind.standing:
            return np.round(np.array(found), 3)
    return None


def _start(
    kind: CourseKind, posts: np.ndarray, rng: np.random.Generator
) -> tuple[float, float] | None:
    for _ in range(60):
        place = rng.uniform(0.5, kind.side_m - 0.5, 2)
        if np.hypot(*(posts - place).T).min() >= kind.between_m:
            return round(float(place[0]), 3), round(float(place[1]), 3)
    return None


def _moving_objects(
    kind: CourseKind, posts: np.ndarray, start: Place, rng: np.random.Generator
) -> tuple[MovingObject, ...] | None:
    found: list[MovingObject] = []
    lines: list[np.ndarray] = []
    for _ in range(400 * kind.moving):
        if len(found) == kind.moving:
            break
        speed = float(rng.uniform(*kind.speeds_mps))
        reversal = float(rng.uniform(*REVERSAL_S))
        heading = float(rng.uniform(-math.pi, math.pi))
        begin = rng.uniform(LINE_TO_WALL_M, kind.side_m - LINE_TO_WALL_M, 2)
        ahead = np.array([math.cos(heading), math.sin(heading)])
        line = np.stack([begin, begin + speed * reversal * ahead])
        if not _fits(line, lines, kind, posts, start):
            continue
        lines.append(line)
        body = Cylinder((0.0, 0.0, HEIGHT_M / 2), RADIUS_M, HEIGHT_M, f"plaster/{MOVING}")
        place = float(begin[0]), float(begin[1])
        found.append(
            MovingObject(f"mover {len(found) + 1}", place, heading, speed, reversal, (body,))
        )
    return tuple(found) if len(found) == kind.moving else None


def _fits(
    line: np.ndarray, others: list[np.ndarray], kind: CourseKind, posts: np.ndarray, start: Place
) -> bool:
    if line.min() < LINE_TO_WALL_M or line.max() > kind.side_m - LINE_TO_WALL_M:
        return False
    places = line[0] + np.linspace(0.0, 1.0, 41)[:, None] * (line[1] - line[0])
    if _apart(places, posts) < LINE_TO_STANDING_M:
        return False
    if _apart(places, np.array([start])) < LINE_TO_START_M:
        return False
    for other in others:
        theirs = other[0] + np.linspace(0.0, 1.0, 41)[:, None] * (other[1] - other[0])
        if _apart(places, theirs) < LINE_TO_LINE_M:
            return False
    return True


def _apart(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.linalg.norm(one[:, None] - other[None], axis=-1).min())


def _via_points(
    kind: CourseKind, posts: np.ndarray, start: Place, rng: np.random.Generator
) -> tuple[tuple[float, float], ...] | None:
    """Places until the segments add up to the length; the last one is shortened to fit."""
    path: list[np.ndarray] = [np.array(start)]
    left = kind.length_m
    for _ in range(4000):
        place = rng.uniform(0.5, kind.side_m - 0.5, 2)
        leg = math.dist(place, path[-1])
        if not LEG_M[0] <= leg <= LEG_M[1]:
            continue
        last = left - leg < LEG_M[0]
        if last:
            place = path[-1] + (place - path[-1]) * left / leg
            leg = left
        inside = place.min() >= 0.5 and place.max() <= kind.side_m - 0.5
        if not inside or np.hypot(*(posts - place).T).min() < VIA_TO_STANDING_M:
            continue
        path.append(place)
        left -= leg
        if last:
            return tuple((float(x), float(y)) for x, y in path[1:])
    return None


def _built(
    kind: CourseKind,
    seed: int,
    posts: np.ndarray,
    start: Place,
    moving_objects: tuple[MovingObject, ...],
    vias: tuple[Place, ...],
) -> Scene:
    extent = (0.0, 0.0, kind.side_m, kind.side_m)
    heading = math.atan2(vias[0][1] - start[1], vias[0][0] - start[0])
    building = walls(extent, ("wall/sky", "wall/cream", "wall/sage", "wall/white"))
    standing = tuple(
        StaticObject(
            f"post {k + 1}",
            (
                Cylinder(
                    (float(x), float(y), HEIGHT_M / 2), RADIUS_M, HEIGHT_M, f"plaster/{STANDING}"
                ),
            ),
        )
        for k, (x, y) in enumerate(posts)
    )
    return scene_with_tags(
        kind.name,
        seed,
        extent,
        "planks/oak",
        building + standing,
        moving_objects,
        Pose2(*start, heading),
        vias,
        tags=24,
        low=True,
    )
