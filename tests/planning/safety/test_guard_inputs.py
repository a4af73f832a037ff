"""What a planner gives to the guard."""

from __future__ import annotations

import numpy as np

from perception.primitives.gaussian import Gaussian
from perception.primitives.motion import Motion
from perception.primitives.obstacle import Obstacle
from planning.safety.guard_inputs import standing_cells, straight_tracks

HERE = Gaussian(np.array([1.0, 0.0, 0.1, 0.0]), 1e-4 * np.eye(4))
CELLS = np.array([[1.0, 0.1], [1.0, 0.3], [0.0, 0.0]])


def test_the_cells_of_moving_tracks_are_left_out():
    mover, box = Obstacle(HERE, 0.2, moving=0.9), Obstacle(HERE, 0.2, moving=0.1)
    np.testing.assert_array_equal(standing_cells(CELLS, [mover], 0.05), CELLS[1:])
    np.testing.assert_array_equal(standing_cells(CELLS, [box], 0.05), CELLS)


def test_moving_tracks_alone_go_straight_on():
    straight = Gaussian(HERE.mean + 0.5, HERE.covariance)
    means, covariances = np.tile(HERE.mean, (5, 1)), np.tile(HERE.covariance, (5, 1, 1))
    rates, fresh = np.zeros((5, 5)), np.eye(2)
    motion = Motion(np.full(5, 0.2), means, covariances, rates, fresh, straight)
    moving, standing = (Obstacle(HERE, 0.2, moving=p, motion=motion) for p in (0.9, 0.1))
    first, second = straight_tracks([moving, standing])
    np.testing.assert_array_equal(first.position, straight.mean[:2])
    assert second is standing
