"""The study of comparisons: its sides are what it says, and few draws give all figures."""

from __future__ import annotations

import numpy as np
import pytest

from surefoot.experiments.joint import comparisons


def ates(side):
    return np.array([row["ate_m"] for row in side.metrics.values()])


def test_two_sides_share_their_sequences_and_differ_by_scatter_and_change():
    first, same = comparisons.side(3, 0), comparisons.side(3, 0)
    np.testing.assert_array_equal(ates(first), ates(same))
    apart = np.log(ates(comparisons.side(3, 1, change=0.5)) / ates(first))
    assert np.median(apart) == pytest.approx(np.log(1.5), abs=0.01)
    assert np.std(np.log(ates(first))) > 50 * comparisons.SCATTER


def test_few_draws_give_every_figure_that_has_a_target(monkeypatch):
    monkeypatch.setattr(comparisons, "MORE_DRAWS", 2)
    monkeypatch.setattr(comparisons, "CHANGES", np.array([0.0, 0.05]))
    outcome = comparisons.run(2, lambda text: None)
    assert set(comparisons.EXPERIMENT.targets) <= set(outcome.figures)
    assert outcome.figures["found"] == outcome.figures["equal"] == 2.0
    assert outcome.figures["smallest_at_0_5_percent"] == 0.05
