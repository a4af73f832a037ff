"""Paired differences against another library, against all means of pairs, and over many draws."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy import stats

from surefoot.store.paired import fewest, holm, paired, probability


def rng(seed):
    return np.random.default_rng(seed)


@pytest.mark.parametrize("number", [1, 5, 12, 40])
def test_the_probability_is_that_of_the_signed_rank_test(number):
    d = rng(number).normal(0.3, 1.0, number)
    assert probability(d) == pytest.approx(stats.wilcoxon(d, method="exact").pvalue, rel=1e-9)


def test_with_equal_sizes_the_probability_is_that_over_all_signs():
    d = np.array([1.0, 1.0, -2.0, 2.0, 3.0, 3.0, -1.0])
    ranks = stats.rankdata(np.abs(d))
    sums = [ranks[np.array(s)].sum() for s in itertools.product([False, True], repeat=len(d))]
    away = abs(ranks[d > 0].sum() - ranks.sum() / 2)
    expected = np.mean([abs(one - ranks.sum() / 2) >= away for one in sums])
    assert probability(d) == pytest.approx(expected)


def test_beyond_the_exact_distribution_the_probability_goes_on():
    d = rng(1).normal(0.1, 1.0, 201)
    assert probability(d) == pytest.approx(stats.wilcoxon(d, method="exact").pvalue, rel=0.02)


@pytest.mark.parametrize("number", [6, 13, 30])
def test_estimate_and_interval_are_means_of_pairs(number):
    d = rng(number).normal(0.3, 1.0, number)
    means = np.sort([(a + b) / 2 for a, b in itertools.combinations_with_replacement(d, 2)])
    found = paired(d)
    assert found.typical == pytest.approx(np.median(means), abs=1e-9)
    assert np.min(np.abs(means - found.low)) < 1e-9
    assert np.min(np.abs(means - found.high)) < 1e-9
    inside, outside = 1e-6, -1e-6
    for bound, sign in (
        (found.low, 1.0),
        (found.high, -1.0),
    ):  # the interval is what the test accepts
        assert probability(d - bound - sign * inside) > 0.05
        assert probability(d - bound - sign * outside) < 0.05


def test_the_interval_covers_the_true_difference_as_often_as_it_says():
    held = [
        found.low <= 0.2 <= found.high
        for found in (paired(0.2 + rng(seed).standard_t(3, 25)) for seed in range(600))
    ]
    assert np.mean(held) == pytest.approx(0.95, abs=3 * np.sqrt(0.95 * 0.05 / 600))


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
