"""The four evaluations: closed forms of the paper, bounds, and monotony in each term."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.primitives.errors import ConfigError
from perception.primitives.gaussian import deviation
from planning.gaze.evaluations import (
    EvaluationConfig,
    of_map,
    of_obstacles,
    of_self,
    of_way,
)

CONFIG = EvaluationConfig()
counts = st.integers(0, 5000)
sizes = st.floats(1e-3, 2.0)


@given(counts, counts)
def test_psi_lm_orders_as_the_printed_ratio_and_is_bounded(stale, fresh):
    psi = of_map(stale, fresh)
    assert 0.0 <= psi <= 1.0
    if fresh:
        ratio = stale / fresh
        assert psi == pytest.approx(ratio / (1.0 + ratio))
        assert of_map(stale, fresh, literal=True) == min(ratio, 1.0)
        assert of_map(stale + 1, fresh) > psi
    elif stale:
        assert psi == of_map(stale, 0, literal=True) == 1.0


def test_psi_sf_uses_the_worst_axis_of_the_position_and_not_the_heading():
    turned = np.array([[math.cos(0.6), -math.sin(0.6)], [math.sin(0.6), math.cos(0.6)]])
    P = np.zeros((3, 3))
    P[:2, :2] = turned @ np.diag([0.04**2, 0.01**2]) @ turned.T
    P[2, 2] = 9.0
    assert of_self(P, CONFIG) == pytest.approx(0.4)
    assert of_self(100.0 * P, CONFIG) == 1.0
    assert deviation(P[:2, :2]) == pytest.approx(0.04)


def test_psi_ob_is_deviation_times_speed_over_distance():
    # sigma 0.05 m, 0.2 m/s, 1 m away: 0.01 m/s, half of T_o
    one = of_obstacles(
        np.array([[0.6, 0.8]]),
        np.array([[0.0, -0.2]]),
        np.array([np.diag([0.05, 0.02]) ** 2]),
        CONFIG,
    )
    np.testing.assert_allclose(one, [0.5])


@given(sizes, sizes, sizes)
def test_psi_ob_never_falls_with_deviation_speed_or_nearness(sigma, speed, away):
    def psi(sigma: float, speed: float, away: float) -> float:
        covariance = np.eye(2)[None] * sigma**2
        return float(
            of_obstacles(np.array([[away, 0.0]]), np.array([[speed, 0.0]]), covariance, CONFIG)[0]
        )

    here = psi(sigma, speed, away)
    assert 0.0 <= here <= 1.0
    assert psi(1.5 * sigma, speed, away) >= here
    assert psi(sigma, 1.5 * speed, away) >= here
    assert psi(sigma, speed, away / 1.5) >= here
    assert psi(sigma, 0.0, away) == 0.0


def test_psi_way_is_the_free_distance_by_its_threshold():
    places, radii = np.array([[0.8, 0.0], [0.0, 1.5]]), np.array([0.3, 0.2])
    assert of_way(places, radii, CONFIG) == pytest.approx(0.5)
    assert of_way(places[1:], radii[1:], CONFIG) == 1.0
    assert of_way(np.array([[0.1, 0.0]]), np.array([0.3]), CONFIG) == 0.0
    assert of_way(np.zeros((0, 2)), np.zeros(0), CONFIG) == 1.0


def test_impossible_thresholds_are_refused():
    with pytest.raises(ConfigError, match="farthest_m"):
        EvaluationConfig(nearest_m=2.0)
    with pytest.raises(ConfigError, match="self_sigma_m"):
        EvaluationConfig(self_sigma_m=0.0)
