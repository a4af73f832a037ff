"""Figures of footprints on outlines whose overlaps are known on paper."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from surefoot.evaluation.metrics.footprints import outline_metrics, over_free_share, poses_inside
from surefoot.evaluation.metrics.maps import FREE, OCCUPIED, GridMap

SQUARE = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]


def footprint(ring: list[list[float]], seen: int = 4) -> dict[str, Any]:
    sides = [{"seen": k < seen, "sigma_m": 0.01 if k < seen else None} for k in range(len(ring))]
    return {"outline_m": ring, "sides": sides}


def thing(ring: list[list[float]], *seen: float) -> dict[str, Any]:
    return {"parts_m": [ring], "sides": [{"length_m": 1.0, "seen": share} for share in seen]}


def moved(x: float) -> list[list[float]]:
    return [[a + x, b] for a, b in SQUARE]


def test_the_share_over_free_cells_is_exact_for_a_turned_outline():
    state = np.full((20, 20), OCCUPIED)
    state[:, 10:] = FREE  # x > 0
    grid = GridMap(state, np.array([-1.0, -1.0]), 0.1)
    diamond = footprint([[-0.5, 0.0], [0.0, -0.5], [0.5, 0.0], [0.0, 0.5]])
    assert over_free_share([diamond], grid) == pytest.approx(0.5, abs=1e-5)
    assert over_free_share([], grid) == 0.0


def test_a_place_in_two_footprints_counts_once():
    places = np.array([[0.75, 0.5], [0.25, 0.5], [2.5, 0.5]])
    assert poses_inside([footprint(SQUARE), footprint(moved(0.5))], places) == 2


def test_overlap_is_that_of_two_squares_half_a_side_apart():
    figures = outline_metrics([footprint(moved(0.5))], [thing(SQUARE, 1.0, 1.0, 0.0, 0.0)])
    assert figures["footprint_iou_median"] == pytest.approx(1 / 3, abs=0.02)


def test_objects_seen_from_one_side_do_not_count_and_those_without_footprint_count_as_nothing():
    assert outline_metrics([footprint(SQUARE)], [thing(SQUARE, 1.0, 0.7, 0.0, 0.0)]) == {}
    figures = outline_metrics([], [thing(SQUARE, 1.0, 1.0, 0.0, 0.0)])
    assert figures == {
        "footprint_objects": 1.0,
        "footprint_iou_median": 0.0,
        "footprint_iou_min": 0.0,
    }


def test_sides_count_as_right_within_two_standard_deviations():
    wide = [[0.0, 0.0], [1.05, 0.0], [1.05, 1.0], [0.0, 1.0]]  # one side 5 cm, 5 sigma, too far out
    figures = outline_metrics([footprint(wide)], [thing(SQUARE, 1.0, 1.0, 0.0, 0.0)])
    assert figures["footprint_sides"] == 4.0
    assert figures["footprint_sides_in_2sigma"] == pytest.approx(0.75)
