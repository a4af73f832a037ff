"""Paired differences against another library, against all means of pairs, and over many draws."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy import stats

from surefoot.store.paired import EXACT, fewest, holm, paired, probability


def rng(seed):
    return np.random.default_rng(seed)


def by_all_signs(d):
    """The two-sided p-value by trying every combination of signs; ranks above the middle count as the middle."""
    scores = np.minimum(stats.rankdata(np.abs(d)), len(d) / 2)
    sums = [np.dot(signs, scores) for signs in itertools.product([-1.0, 1.0], repeat=len(d))]
    at = abs(np.dot(np.sign(d), scores))
    return np.mean(np.abs(sums) >= at - 1e-9)


@pytest.mark.parametrize("number", [2, 5, 8, 12])
def test_the_probability_is_that_over_all_signs(number):
    d = rng(number).normal(0.3, 1.0, number)
    assert probability(d) == pytest.approx(by_all_signs(d))
    equal_sizes = np.array([1.0, 1.0, -2.0, 2.0, 3.0, 3.0, -1.0])
    assert probability(equal_sizes) == pytest.approx(by_all_signs(equal_sizes))


def test_beyond_the_exact_distribution_the_probability_goes_on():
    d = rng(1).normal(0.1, 1.0, EXACT + 1)
    beyond, exact = probability(d), probability(d[:EXACT])
    assert beyond == pytest.approx(exact, rel=0.5)
    drawn = np.sign(rng(2).normal(size=(20000, len(d)))) @ np.minimum(stats.rankdata(np.abs(d)), len(d) / 2)  # fmt: skip
    at = abs(np.sign(d) @ np.minimum(stats.rankdata(np.abs(d)), len(d) / 2))
    share = np.mean(np.abs(drawn) >= at)
    assert beyond == pytest.approx(share, abs=4 * np.sqrt(share / 20000))


@pytest.mark.parametrize("number", [7, 13, 30])
def test_the_interval_holds_what_the_test_accepts_and_the_estimate_is_within(number):
    d = rng(number).normal(0.3, 1.0, number)
    found = paired(d)
    assert found.low < found.typical < found.high
    assert probability(d - found.typical) > 0.7
    for bound, inward in ((found.low, 1e-6), (found.high, -1e-6)):
        assert probability(d - bound - inward) > 0.05
        assert probability(d - bound + inward) < 0.05


def test_runs_that_went_astray_do_not_decide():
    d = 0.02 + 0.005 * rng(3).normal(size=40)
    astray = d.copy()
    astray[:5] = -1.0
    assert probability(astray) < 1e-4 < stats.wilcoxon(astray, method="exact").pvalue
    assert abs(paired(astray).typical - 0.02) < 0.003


def test_the_interval_covers_the_true_difference_as_often_as_it_says():
    held = [
        found.low <= 0.2 <= found.high
        for found in (paired(0.2 + rng(seed).standard_t(3, 25)) for seed in range(200))
    ]
    assert np.mean(held) == pytest.approx(0.95, abs=3 * np.sqrt(0.95 * 0.05 / 200))


def test_pairs_without_a_difference_say_nothing():
    found = paired(np.zeros(40))
    assert (found.equal, found.typical, found.probability) == (40, 0.0, 1.0)
    assert probability(np.array([1.0])) == 1.0
    assert paired(np.array([0.0] * 30 + [1.0, 2.0, 3.0])).probability == pytest.approx(0.25)
    assert paired(np.array([1.0, 2.0])).low == -np.inf  # two pairs bound nothing


def test_so_many_pairs_are_needed_as_signs_must_agree():
    for figures, rate in ((1, 0.05), (10, 0.0025)):
        n = fewest(figures, rate)
        assert 2.0 * 0.5**n * figures <= rate < 2.0 * 0.5 ** (n - 1) * figures


def test_holm_multiplies_the_smallest_by_all_and_never_turns_the_order():
    assert holm([0.04, 0.01, 0.03]) == pytest.approx([0.06, 0.03, 0.06])
    assert holm([]) == []
