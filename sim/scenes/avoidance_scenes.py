"""The configurations of seed 004: a row of cartons across an arena with one passage, one scene per avoidance motion.

Widths of the blocking carton and of the passage are drawn evenly over the class of the motion, up to its borders; further
cartons close the other side. The seed also draws the side.

Source: seed 004, section 8 (arena of 2.5 x 3 m, cartons 24 cm deep and 32 cm high); widths are ours, by Table 2.
"""

from __future__ import annotations

import numpy as np

from perception.primitives.pose import Pose2

from ..scene import Scene, StaticObject
from ..shapes import Box
from .rooms import scene_with_tags, walls

MOTIONS = ("ST", "SS", "SF", "RS", "RF", "TS", "TF")
FRONT_M, DEPTH_M, HEIGHT_M = 1.55, 0.24, 0.32
OUTER_M = 1.13  # ours: cartons stand clear of the walls, to be separated from them
# Classes of a body of 0.30 m (seed 004): borders halfway between the centres of the fuzzy sets. Ours: the narrowest carton
# fills the path, the widest one and the widest passage fit into the arena.
WIDTHS_M = {"S": (0.30, 0.50), "R": (0.50, 1.15), "T": (1.15, 1.32)}
GAPS_M = {"S": (0.20, 0.30), "F": (0.30, 0.50)}
SLOT_M = (0.08, 0.20)


def avoidance(motion: str, seed: int) -> Scene:
    """The arena for one motion.

    Args:
        motion: One of `MOTIONS`.
        seed: Draws widths, gaps and the side.
    """
    rng = np.random.default_rng([seed, 40 + MOTIONS.index(motion)])
    extent = (0.0, -1.25, 3.0, 1.25)
    side = 1.0 if rng.integers(2) else -1.0
    spans = _stopping(rng) if motion == "ST" else _passing(motion, rng)
    static_objects = list(walls(extent, ("wall/white", "wall/sage", "wall/cream", "wall/sky")))
    for name, left, right, height in spans:
        centre = (FRONT_M + DEPTH_M / 2, side * (left + right) / 2, height / 2)
        box = Box(centre, (DEPTH_M, left - right, height), 0.0, "cardboard/kraft")
        static_objects.append(StaticObject(name, (box,)))
    return scene_with_tags(
        f"avoidance_{motion.lower()}",
        seed,
        extent,
        "planks/pine",
        tuple(static_objects),
        (),
        Pose2(0.3, 0.0, 0.0),
        ((2.6, 0.0),),
    )


def to_border_m(scene: Scene, motion: str) -> float:
    """Distance of the widths of an arena's carton and passage from the nearest border of the classes, m."""
    boxes = {item.name: item.parts[0] for item in scene.static_objects}
    carton, neighbour = boxes["carton"], boxes["left" if motion == "ST" else "neighbour"]
    assert isinstance(carton, Box)
    assert isinstance(neighbour, Box)
    width, apart = carton.size[1], abs(neighbour.centre[1] - carton.centre[1])
    gap = apart - (width + neighbour.size[1]) / 2
    if motion == "ST":
        return GAPS_M["S"][0] - gap
    off = [abs(width - border) for border in WIDTHS_M["R"]]
    return min(off + [abs(gap - border) for border in GAPS_M["S"]])


def _stopping(rng: np.random.Generator) -> list[tuple[str, float, float, float]]:
    """Cartons from wall to wall with slots too narrow to pass."""
    half, slot = float(rng.uniform(0.25, 0.4)), float(rng.uniform(*SLOT_M))
    return [
        ("carton", half, -half, HEIGHT_M),
        ("left", OUTER_M, half + slot, HEIGHT_M),
        ("right", -half - slot, -OUTER_M, HEIGHT_M),
    ]


def _passing(motion: str, rng: np.random.Generator) -> list[tuple[str, float, float, float]]:
    """Name, left and right end (lateral), and height of each carton; the passage is on the left."""
    width, gap = (float(rng.uniform(*r)) for r in (WIDTHS_M[motion[0]], GAPS_M[motion[1]]))
    left = {"S": 0.12, "R": 0.30 * width, "T": 0.35 * width}[motion[0]]
    end = left + gap
    right = left - width - 0.12
    return [
        ("carton", left, left - width, HEIGHT_M),
        ("neighbour", end + float(rng.uniform(0.15, 0.25)), end, 0.25),
        ("other side", right, max(right - 0.35, -OUTER_M), HEIGHT_M),
    ]
