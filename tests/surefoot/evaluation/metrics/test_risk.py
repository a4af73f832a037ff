"""Claimed risk against contacts that are drawn with known probabilities."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binomtest

from planning.safety.guard_settings import RISK_S
from surefoot.evaluation.metrics.risk import followed_by_contact, tally, wilson
from surefoot.results.tables import Table


def table(**columns) -> Table:
    return Table("a test", {name: [str(cell) for cell in cells] for name, cells in columns.items()})


@pytest.mark.parametrize(("share", "low", "high"), [(1.0, True, True), (3.0, False, True)])
def test_true_claims_lie_in_the_band_and_claims_that_are_too_low_do_not(share, low, high):
    rng = np.random.default_rng(0)
    claimed = rng.uniform(0.0, 0.3, 20000)
    happened = rng.random(len(claimed)) < np.minimum(share * claimed, 1.0)
    found = tally(claimed, happened, RISK_S).classes()
    halves = tally(claimed[:7], happened[:7], RISK_S) + tally(claimed[7:], happened[7:], RISK_S)
    assert [one.decisions for one in halves.classes()] == [one.decisions for one in found]
    assert sum(one.decisions for one in found) == len(claimed)
    assert all(one.in_band for one in found) == low
    sure = tally(np.array([0.0, 1.0]), np.array([False, True]), RISK_S)
    assert sure.classes()[-1].in_band == high


def test_the_band_is_that_of_scipy():
    for count, hits in ((10, 0), (50, 3), (200, 150)):
        expected = binomtest(hits, count).proportion_ci(method="wilson")
        assert wilson(hits / count, float(count)) == pytest.approx(
            (expected.low, expected.high), abs=1e-4
        )


def test_a_decision_is_followed_by_contacts_with_movers_that_begin_within_its_horizon():
    commands = table(stamp_s=[0.0, 2.0, 4.0, 6.0], risk=[0.1, 0.2, "nan", 0.3])
    clearance = table(
        stamp_s=[1.0, 3.0, 3.5, 5.0, 7.0],
        clearance_m=[0.2, -0.01, -0.02, -0.03, 0.4],
        object=["robot 1", "sofa", "robot 1", "robot 1", "robot 1"],
    )
    claimed, happened = followed_by_contact(commands, clearance, ["robot 1"])
    np.testing.assert_array_equal(claimed, [0.1, 0.2, 0.3])
    np.testing.assert_array_equal(happened, [False, True, False])
