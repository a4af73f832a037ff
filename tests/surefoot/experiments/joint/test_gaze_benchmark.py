"""The gaze benchmark: the gap that a policy closes, its intervals, and an oracle that sees only what can be seen."""

from __future__ import annotations

import numpy as np
import pytest

from surefoot.experiments.joint.gaze_benchmark import JUDGED, MODES, SCENES, gap_closed, interval
from surefoot.experiments.joint.gaze_coupling import walk_with_gaze


def test_the_gap_is_closed_from_the_fixed_head_to_the_oracle_and_no_further():
    means = {
        (scene, name, figure): value
        for scene in SCENES
        for figure in JUDGED
        for name, value in (("fixed", 5.0), ("oracle", 1.0), ("ours", 2.0), ("lucky", 0.5))
    }
    assert gap_closed(means, "fixed") == 0.0
    assert gap_closed(means, "ours") == pytest.approx(0.75)
    assert gap_closed(means, "oracle") == gap_closed(means, "lucky") == 1.0


def test_a_bootstrap_interval_is_that_of_the_mean():
    values = np.random.default_rng(1).normal(3.0, 2.0, 400)
    mean, low, high = interval(np.append(values, np.nan), np.random.default_rng(0))
    assert mean == pytest.approx(values.mean())
    half = 1.645 * values.std() / np.sqrt(len(values))
    assert (low, high) == pytest.approx((mean - half, mean + half), rel=0.02)


def test_an_oracle_follows_movers_better_than_a_head_that_does_not_turn():
    fixed, oracle = (walk_with_gaze(210, MODES[name]) for name in ("fixed", "oracle"))
    assert oracle.mover_error_m < 0.7 * fixed.mover_error_m
    assert oracle.stale < 0.5 * fixed.stale
    assert oracle.travel_rad > 10.0 * fixed.travel_rad
