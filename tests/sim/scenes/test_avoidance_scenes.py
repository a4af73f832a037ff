"""The arenas of seed 004: each has the passage of its motion and no other."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from planning.avoidance.fams import FamsConfig, select
from sim.scenes import catalogue
from sim.scenes.avoidance_scenes import MOTIONS
from sim.shapes import Box

WALL_M = 1.25


def _spans(motion: str, seed: int) -> dict[str, tuple[float, float]]:
    scene = catalogue.load(f"avoidance_{motion.lower()}", seed)
    found = {}
    for item in scene.static_objects:
        box = item.parts[0]
        if isinstance(box, Box) and box.material.startswith("cardboard"):
            found[item.name] = (box.centre[1] + box.size[1] / 2, box.centre[1] - box.size[1] / 2)
    return found


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("seed", range(15))
def test_true_width_and_gap_select_the_motion(motion, seed):
    spans = _spans(motion, seed)
    left, right = spans.pop("carton")
    gaps = [high for high, _ in spans.values()], [low for _, low in spans.values()]
    on_left = min([low - left for low in gaps[1] if low >= left], default=WALL_M - left)
    on_right = min([right - high for high in gaps[0] if high <= right], default=right + WALL_M)
    asked = {
        MOTIONS[int(select(_one(left - right), _one(gap), FamsConfig())[0])]
        for gap in (on_left, on_right)
    }
    assert motion in asked


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("seed", range(15))
def test_cartons_overlap_neither_each_other_nor_the_walls(motion, seed):
    spans = sorted(_spans(motion, seed).values(), reverse=True)
    assert spans[0][0] < WALL_M
    assert spans[-1][1] > -WALL_M
    assert all(above[1] > below[0] for above, below in itertools.pairwise(spans))
    assert all(high > low for high, low in spans)


def _one(value):
    return np.array([value], dtype=float)
