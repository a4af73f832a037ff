"""The experiments on egocentric grid and path search meet their targets on a few seeds."""

from __future__ import annotations

import numpy as np
import pytest

from planning.search.potential import SearchConfig
from surefoot.experiments.seed_003.path_search import (
    SIDE,
    costs_m,
    prepared_terrain,
    solve,
    terrains,
    violations,
)
from surefoot.experiments.seed_003.path_smoothing import arc_radii_m
from surefoot.experiments.support import experiment, random_terrain


def quiet(text: str) -> None:
    """No progress in tests."""


@pytest.mark.parametrize(("identity", "seeds"), [("003-E4", 12), ("003-E5", 12)])
def test_the_targets_are_met(identity, seeds):
    found = experiment.load(identity)
    result = experiment.judge(found, found.run(seeds, quiet))
    assert result["passed"], result["figures"]


def test_the_grid_equals_a_fixed_map_and_the_printed_rule_drifts():
    found = experiment.load("003-E3")
    result = experiment.judge(found, found.run(1, quiet))
    assert result["passed"], result["figures"]
    assert result["figures"]["literal_error_m"] > 0.3  # the specification: 0.65 m after 1000 steps


def test_a_violation_of_the_clearance_is_found():
    config = SearchConfig()
    grid = terrains(3)[2]
    path = solve(grid, grid.goal, config).path
    assert path is not None
    assert violations(path, grid, config) == 0
    row, column = path.cells[len(path.cells) // 2]
    grid.probability[row, column] = 0.9
    grid.unknown[row, column] = False
    assert violations(path, grid, config) > 0


def test_the_reference_cost_of_a_straight_path_is_its_length():
    grid = random_terrain.Grid(
        np.zeros((SIDE, SIDE)), np.zeros((SIDE, SIDE), bool), np.full(2, 0.525), np.full(2, 3.025)
    )
    reached = costs_m(prepared_terrain(grid, SearchConfig()), (10, 10))
    assert reached[10, 60] == pytest.approx(50 * 0.05)
    assert reached[60, 60] == pytest.approx(50 * 0.05 * np.sqrt(2))


def test_the_radius_of_a_known_arc_is_measured():
    angles = np.arange(0.0, 1.0, 0.2)
    arc = 0.19 * np.column_stack([np.sin(angles), 1 - np.cos(angles)])
    np.testing.assert_allclose(arc_radii_m(np.vstack([[-1.0, 0.0], arc])), 0.19)
