"""Intervals by bootstrap over the seeds agree with theory, keep comparisons paired, and are absent where they would lie."""

from __future__ import annotations

import math
import time

import numpy as np

from surefoot.experiments.support.resampling import DRAWS, Record, intervals
from surefoot.experiments.support.trials import run_trials

N = 60


def study(values, group="ours"):
    """Finished trials (seed, group) with these results."""
    return [(seed, group) for seed in range(len(values))], list(values)


def recorded(*studies):
    return Record([(todo, results) for todo, results in studies], waited_s=0.0)


def results(*groups):
    """What an experiment gets for its trials: in a replay, those of the record with other seeds."""
    todo = [(seed, group) for group in groups for seed in range(N)]
    found = list(run_trials(math.pow, todo))
    return [np.array(found[k * N : (k + 1) * N]) for k in range(len(groups))]


def both(first, second):
    return recorded(([(s, g) for g in ("a", "b") for s in range(N)], [*first, *second]))


def test_the_interval_of_a_mean_is_that_of_normal_theory():
    values = np.random.default_rng(3).normal(5.0, 2.0, N)
    run = lambda: {"mean": float(np.mean(results("ours")[0]))}  # noqa: E731
    spans, said = intervals(run, recorded(study(values)), {"mean": float(values.mean())}, 0.0)
    half = 1.96 * values.std(ddof=1) / math.sqrt(N)
    np.testing.assert_allclose(
        spans["mean"], [values.mean() - half, values.mean() + half], atol=0.2 * half
    )
    assert f"trials: {N}, seeds of each kind: at most {N}" in said


def test_two_methods_on_the_same_worlds_stay_paired():
    first = np.random.default_rng(4).normal(5.0, 2.0, N)
    second = first - 1.0 + 0.01 * np.random.default_rng(5).normal(size=N)

    def run():
        a, b = results("a", "b")
        return {"a": float(a.mean()), "gain": float(np.mean(a - b))}

    spans, _ = intervals(run, both(first, second), {"a": float(first.mean()), "gain": float(np.mean(first - second))}, 0.0)  # fmt: skip
    assert spans["a"][1] - spans["a"][0] > 0.5
    assert spans["gain"][1] - spans["gain"][0] < 0.01


def test_an_extreme_a_whole_share_and_a_measured_time_have_no_interval():
    values = np.random.default_rng(6).normal(5.0, 2.0, N)

    def run():
        (found,) = results("ours")
        return {
            "largest": float(found.max()),
            "positive_share": float(np.mean(found > -99.0)),
            "time_s": time.perf_counter(),
            "mean": float(found.mean()),
        }

    figures = {
        "largest": float(values.max()),
        "positive_share": 1.0,
        "time_s": 7.0,
        "mean": float(values.mean()),
    }
    assert list(intervals(run, recorded(study(values)), figures, 0.0)[0]) == ["mean"]


def test_seeds_are_found_in_settings_and_few_seeds_have_no_interval():
    from surefoot.config.schema import Config

    todo = [(Config(seed=seed), None) for seed in range(4)]
    spans, said = intervals(dict, recorded((todo, [1.0] * 4)), {"a": 1.0}, 0.0)
    assert spans == {}
    assert "seeds of each kind: at most 4" in said


def test_an_experiment_that_computes_long_outside_its_trials_is_not_run_again():
    called = []
    record = recorded(study(range(N)))
    spans, said = intervals(lambda: called.append(1) or {}, record, {"a": 1.0}, DRAWS * 10.0)
    assert (spans, called) == ({}, [])
    assert "take too long" in said


def test_without_trials_the_reason_is_said():
    assert "do not run as separate trials" in intervals(dict, Record(), {"a": 1.0}, 1.0)[1]
