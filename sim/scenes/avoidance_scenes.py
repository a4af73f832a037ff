"""The configurations of seed 004: a row of cartons across an arena with one passage, one scene per avoidance motion.

Widths of the blocking carton and of the passage are drawn within the class of the motion; further cartons close the
other side. The seed also draws the side.

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
WIDTHS_M = {"S": (0.30, 0.44), "R": (0.58, 1.05), "T": (1.22, 1.32)}
GAPS_M = {"S": (0.22, 0.28), "F": (0.38, 0.50)}


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


def _stopping(rng: np.random.Generator) -> list[tuple[str, float, float, float]]:
    """Cartons from wall to wall with slots too narrow to pass."""
    half, slot = float(rng.uniform(0.25, 0.4)), float(rng.uniform(0.08, 0.15))
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
    spans = [
        ("carton", left, left - width, HEIGHT_M),
        ("neighbour", end + float(rng.uniform(0.15, 0.25)), end, 0.25),
    ]
    if motion[0] != "T":
        right = left - width - 0.12
        spans.append(("other side", right, max(right - 0.35, -OUTER_M), HEIGHT_M))
    return spans
