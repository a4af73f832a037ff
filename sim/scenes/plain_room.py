"""A room without texture: plain walls, floor and boxes, for colour detection where stereo fails.

Source: seed 003, section 9 (limits of stereo); the room is ours.
"""

from __future__ import annotations

import numpy as np

from perception.primitives.pose import Pose2

from ..scene import Scene, StaticObject
from ..shapes import Box
from .rooms import scene_with_tags, walls

BOX_M = (0.28, 0.28, 0.30)


def plain_room(seed: int) -> Scene:
    """3 x 3.6 m; a box on the straight path to the goal and one on each side, drawn by the seed."""
    rng = np.random.default_rng([seed, 5])
    extent = (0.0, 0.0, 3.6, 3.0)
    building = walls(extent, ("plain/cream", "plain/sky", "plain/sage", "plain/sky"))
    middles = (
        (1.6, 1.5 + float(rng.uniform(-0.15, 0.15))),
        (float(rng.uniform(2.2, 2.6)), float(rng.uniform(0.5, 0.7))),
        (float(rng.uniform(2.2, 2.6)), float(rng.uniform(2.3, 2.5))),
    )
    boxes = tuple(
        StaticObject(
            f"box {k + 1}",
            (
                Box(
                    (*middle, BOX_M[2] / 2), BOX_M, float(rng.uniform(-0.5, 0.5)), f"plain/{colour}"
                ),
            ),
        )
        for k, (middle, colour) in enumerate(zip(middles, ("teal", "plum", "navy"), strict=True))
    )
    return scene_with_tags(
        "plain_room",
        seed,
        extent,
        "plain/oak",
        building + boxes,
        (),
        Pose2(0.6, 1.5, 0.0),
        ((3.0, 1.5),),
        low=True,
    )
