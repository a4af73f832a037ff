"""Innovations as their covariance says are no doubt; biased or larger ones are."""

from __future__ import annotations

import numpy as np

from perception.monitoring.agreement import Bias, Surprise

RUNS, LENGTH = 200, 100


def test_consistent_innovations_are_seldom_doubted():
    rng = np.random.default_rng(1)
    doubted = 0
    for _ in range(RUNS):
        bias, surprise = Bias(2, 6), Surprise(2, 6)
        for one in rng.standard_normal((LENGTH, 2)):
            fine = bias.update(one, np.eye(2)) & surprise.update(float(one @ one))
            doubted += not fine
            if not fine:
                break
    assert doubted < 0.05 * RUNS  # each test 1e-4, of 100 windows that overlap


def test_a_bias_of_two_sigma_is_noticed_within_the_window_and_its_end_as_well():
    rng = np.random.default_rng(2)
    noticed, ended = [], []
    for _ in range(RUNS):
        bias = Bias(1, 6)
        for one in rng.standard_normal(20):
            bias.update(np.array([one]), np.eye(1))
        with_bias = [
            bias.update(np.array([2.5 + one]), np.eye(1)) for one in rng.standard_normal(6)
        ]
        noticed.append(not with_bias[-1])
        after = [bias.update(np.array([one]), np.eye(1)) for one in rng.standard_normal(12)]
        ended.append(after[-1])
    assert np.mean(noticed) > 0.95  # sum of six: 6.1 of the 3.9 sigma that it takes
    assert np.mean(ended) > 0.95


def test_one_outlier_is_no_doubt_and_three_are():
    surprise = Surprise(2, 6)
    for _ in range(6):
        assert surprise.update(1.0)
    assert surprise.update(1e6)
    surprise.update(1e6)
    assert not surprise.update(1e6)
    assert surprise.factor > 5.0


def test_joint_innovations_of_any_number_are_seldom_doubted():
    rng = np.random.default_rng(4)
    doubted = 0
    for _ in range(RUNS):
        surprise = Surprise(2, 4)
        for many in rng.integers(1, 7, LENGTH):
            if not surprise.update(float(rng.chisquare(2 * many)), int(many)):
                doubted += 1
                break
    assert doubted < 0.05 * RUNS  # each test 1e-4, of 100 windows that overlap


def test_the_factor_tells_by_how_much_covariances_are_too_small():
    rng = np.random.default_rng(3)
    factors = []
    for _ in range(RUNS):
        surprise = Surprise(2, 6)
        for one in rng.standard_normal((6, 2)):
            surprise.update(5.0 * float(one @ one))
        factors.append(surprise.factor)
    assert 4.0 < np.median(factors) < 6.0


def test_a_doubt_ends_when_innovations_are_as_expected_again():
    surprise = Surprise(2, 6)
    for _ in range(6):
        surprise.update(30.0)
    assert not surprise.agrees
    for _ in range(6):
        surprise.update(2.0)
    assert surprise.agrees
    assert surprise.factor == 1.0
