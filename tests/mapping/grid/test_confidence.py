"""How recently the cells of the terrain map were seen."""

from __future__ import annotations

import numpy as np
import pytest

from mapping.grid.confidence import ConfidenceConfig, ConfidenceLayer
from mapping.grid.egocentric_grid import EgocentricGrid, GridConfig
from perception.primitives.errors import ConfigError, InputError

SMALL = GridConfig(side_m=0.75, cell_m=0.05)


def layer() -> tuple[EgocentricGrid, ConfidenceLayer]:
    grid = EgocentricGrid(SMALL, np.zeros(2))
    return grid, ConfidenceLayer(grid)


def test_a_cell_is_stale_five_seconds_after_it_left_the_view():
    # Seed 001: 150 cycles at 30 Hz from 1 to lambda_cf = 0.85.
    _, confidence = layer()
    confidence.see(np.ones((15, 15), bool))
    for _ in range(149):
        confidence.decay(1 / 30)
    assert not confidence.stale.any()
    for _ in range(2):
        confidence.decay(1 / 30)
    assert confidence.stale.all()


def test_confidence_never_falls_below_zero():
    _, confidence = layer()
    confidence.see(np.ones((15, 15), bool))
    confidence.decay(1e4)
    assert np.all(confidence.values == 0.0)


def test_confidence_scrolls_with_the_grid():
    grid, confidence = layer()
    mask = np.zeros((15, 15), bool)
    mask[7, 9] = True
    confidence.see(mask)
    grid.move(np.array([0.10, -0.05]))
    assert confidence.values[8, 7] == 1.0
    assert confidence.values.sum() == 1.0
    confidence.see(mask)  # now another cell
    assert confidence.values[7, 9] == 1.0
    grid.move(np.array([5.0, 0.0]))
    assert np.all(confidence.values == 0.0)


def test_bad_input_is_refused_with_its_reason():
    _, confidence = layer()
    with pytest.raises(InputError, match=r"array of shape \(3, 3\)"):
        confidence.see(np.zeros((3, 3), bool))
    with pytest.raises(ConfigError, match=r"loss_per_s=-0\.1"):
        ConfidenceConfig(loss_per_s=-0.1)
