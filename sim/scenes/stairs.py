"""A walkway of several levels, too high above the floor to leave it: a flight up to a platform and one down again, a kerb, a trench.

Not in the catalogue: the planners of `surefoot simulate` keep to one level. Risers and treads are drawn for the Unitree G1,
whose legs step up 14 cm and down 10 cm.

Source: ours.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from perception.primitives.errors import InputError
from perception.primitives.pose import Pose2

from ..scene import FloorArea, Scene, StaticObject
from ..shapes import Box

KINDS = ("stairs", "kerb", "trench")
RISER_M, TREAD_M, STEPS, WIDTH_M = (0.05, 0.09), (0.30, 0.36), (2, 5), (1.0, 1.6)
AWAY_M, PLATFORM_M, BEYOND_M = (0.6, 1.0), (0.8, 1.2), 1.5
TRENCH_M, HIGH_M = (0.3, 0.6), 0.6
MATERIAL = "plain/sage"


@dataclass(frozen=True)
class Level:
    """A stretch of level ground across the whole width: from and to x, and its height, m."""

    start_m: float
    end_m: float
    height_m: float


@dataclass(frozen=True)
class Terrain:
    """Levels one after another, from behind the robot to beyond its goal, and half of their width, m."""

    levels: tuple[Level, ...]
    half_m: float

    def scene(self, name: str, seed: int) -> Scene:
        """Boxes on a floor; the robot starts at the origin, on the first level."""
        rng = np.random.default_rng([seed, 52])
        first, last = self.levels[0].start_m, self.levels[-1].end_m
        extent = (first - 0.5, -self.half_m - 1.5, last + 0.5, self.half_m + 1.5)
        boxes = tuple(
            StaticObject(
                f"level {k}",
                (
                    Box(
                        ((one.start_m + one.end_m) / 2, 0.0, one.height_m / 2),
                        (one.end_m - one.start_m, 2 * self.half_m, one.height_m),
                        0.0,
                        MATERIAL,
                    ),
                ),
                float(rng.uniform(0.4, 0.8)),
                ground=True,
            )
            for k, one in enumerate(self.levels)
            if one.height_m > 0.0
        )
        start = Pose2(0.0, float(rng.uniform(-0.1, 0.1)), float(rng.uniform(-0.08, 0.08)))
        goal = (last - BEYOND_M / 2, 0.0)
        floor = (FloorArea("plain/oak", extent),)
        return Scene(name, seed, extent, floor, boxes, (), (), start, (goal,))


def terrain(kind: str, seed: int) -> Terrain:
    """Random levels of a kind.

    Raises:
        InputError: The kind is unknown.
    """
    if kind not in KINDS:
        raise InputError(f"terrain {kind!r} is unknown; choose {', '.join(KINDS)}")
    rng = np.random.default_rng([seed, 51, KINDS.index(kind)])
    away, half = rng.uniform(*AWAY_M), rng.uniform(*WIDTH_M) / 2
    riser, tread = rng.uniform(*RISER_M), rng.uniform(*TREAD_M)
    steps = int(rng.integers(STEPS[0], STEPS[1] + 1))
    platform, trench = rng.uniform(*PLATFORM_M), rng.uniform(*TRENCH_M)
    if kind == "stairs":
        up = [k * riser for k in range(steps + 1)]
        heights = [*up, *up[-2::-1]]
        lengths = [tread] * (steps - 1) + [platform] + [tread] * (steps - 1) + [BEYOND_M]
    elif kind == "kerb":
        heights, lengths = [0.0, riser], [BEYOND_M]
    else:
        heights, lengths = [0.0, -HIGH_M, 0.0], [trench, BEYOND_M]
    ends = np.cumsum([away, *lengths]).tolist()
    starts = [-1.0, *ends[:-1]]
    levels = tuple(
        Level(start, end, HIGH_M + height)
        for start, end, height in zip(starts, ends, heights, strict=True)
    )
    return Terrain(levels, float(half))
