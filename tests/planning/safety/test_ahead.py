"""Where an obstacle without modes of motion will be, against simulated reversals; what counts as standing."""

from __future__ import annotations

import numpy as np
import pytest

from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import Obstacle
from planning.safety.ahead import Ahead, stands_unseen
from planning.safety.guard_settings import TURNS_EVERY_S
from planning.safety.prediction import MotionPatterns


def obstacle(moving: float = 1.0, radius_m: float = 0.1) -> Obstacle:
    """At (1, 2) m along (0.3, 0.4) m/s, surely, seen 4 s after the clock began."""
    state = Gaussian(np.array([1.0, 2.0, 0.3, 0.4]), 1e-12 * np.eye(4))
    return Obstacle(state, radius_m, 0.4, 1, moving, 4.0)


@pytest.mark.parametrize("unseen_s", [0.0, 5.0])
def test_what_has_no_modes_may_have_reversed_once_since_it_was_seen(unseen_s):
    times = np.array([1.0, 3.0])
    track = obstacle(0.8)
    now = Obstacle(track.after(unseen_s).state, 0.1, 0.4, 1, 0.8, 4.0)
    ahead = Ahead.of(now, 4.0 + unseen_s, times, MotionPatterns())
    np.testing.assert_allclose(ahead.weights.sum(axis=1), 1.0)
    rng = np.random.default_rng(0)
    for k, gone_s in enumerate(times + unseen_s):
        turn_s = rng.exponential(TURNS_EVERY_S, 200000)
        turned = turn_s < gone_s
        assert ahead.weights[k, 2] == pytest.approx(0.8 * turned.mean(), abs=0.005)
        along = 2.0 * turn_s[turned] - gone_s  # seconds of the way out that are left
        places = track.position + along[:, None] * track.velocity
        slack = 0.2 * gone_s * 0.5  # more reverse early than late
        np.testing.assert_allclose(ahead.means[k, 2], places.mean(axis=0), atol=slack)
        np.testing.assert_allclose(ahead.covariances[k, 2], np.cov(places.T), rtol=0.1)
    np.testing.assert_allclose(ahead.means[:, 1], now.position + np.outer(times, now.velocity))
    np.testing.assert_allclose(ahead.means[:, 0], [now.position] * 2)


def test_a_small_thing_that_stands_counts_where_no_cell_shows_it():
    beside, inside = np.array([[1.2, 2.0]]), np.array([[1.05, 2.0]])
    assert stands_unseen(obstacle(0.1), beside)
    assert not stands_unseen(obstacle(0.1), inside)
    assert not stands_unseen(obstacle(0.9), beside)
    assert not stands_unseen(obstacle(0.1, radius_m=0.4), beside)
