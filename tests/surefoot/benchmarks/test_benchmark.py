"""Judgement of benchmarks: the hardest peer counts, and accuracy as well as time."""

import importlib

import numpy as np
import pytest

from surefoot.benchmarks import benchmark
from surefoot.benchmarks.benchmark import Benchmark, Comparison, judge, lines, mean_ratio, race


def judged(ratio=3.0, fair=None, error=0.1):
    measured = Comparison({"ours_ms": 1.0}, {"ratio": ratio}, {"error": error}, fair or {"a": 2.0})
    return judge(Benchmark("x", "X", lambda: measured, {"ratio": 2.5}, {"error": 0.2}), measured)


def test_the_least_ratio_to_a_fair_peer_is_the_hardest():
    result = judged(fair={"slow": 9.0, "quick": 1.3, "middling": 4.0})
    assert result["ratios"]["hardest_ratio"] == 1.3
    assert result["hardest_peer"] == "quick"
    assert result["passed"]
    assert any("the hardest peer is quick" in line for line in lines(result))


@pytest.mark.parametrize(
    "changed", [{"ratio": 2.4}, {"fair": {"quick": 1.1, "slow": 9.0}}, {"error": 0.3}]
)
def test_former_peer_hardest_peer_and_accuracy_must_all_pass(changed):
    assert judged()["passed"]
    assert not judged(**changed)["passed"]


def test_a_bound_of_a_peer_that_is_not_installed_is_left_out():
    measured = Comparison({}, {}, {}, {"a": 2.0}, ["absent"])
    result = judge(Benchmark("x", "X", lambda: measured, {"ratio": 2.5}, {"error": 0.2}), measured)
    assert list(result["targets"]) == ["hardest_ratio"]
    assert result["passed"]
    assert "  peer not installed: absent" in lines(result)


def test_the_mean_of_ratios_is_the_same_whichever_side_is_divided():
    ratios = [0.5, 2.0, 4.0]
    assert mean_ratio(ratios) == pytest.approx(1.0 / mean_ratio([1.0 / r for r in ratios]))


def test_a_short_candidate_is_repeated_and_a_long_one_is_not():
    calls = {"short": 0, "long": 0}

    def short():
        calls["short"] += 1

    def long():
        calls["long"] += 1
        sum(range(200_000))

    times = race({"short": short, "long": long}, rounds=3)
    assert calls["long"] <= 5 + 3 * 4
    assert calls["short"] > 20 * calls["long"]
    assert times["short"] < times["long"]


@pytest.mark.parametrize("name", ["gaze", "univector"])
def test_the_compiled_peer_gives_the_same_numbers_as_the_one_in_numpy(name):
    """Both are peers: the tests of ours have their own references."""
    module = importlib.import_module(f"surefoot.benchmarks.{name}")
    rng = np.random.default_rng(0)
    if name == "gaze":
        places, weights = rng.normal(size=(40, 3)), rng.uniform(size=40)
        rotations = np.linalg.qr(rng.normal(size=(3, 4, 3, 3)))[0]
        given = places, weights, rotations, 0.5, 0.4
    else:
        config = module.fields.FieldConfig()
        centres, radii = rng.uniform(0.0, 3.0, (5, 2)), rng.uniform(0.1, 0.3, 5)
        given = rng.uniform(0.0, 3.0, (300, 2)), np.array([1.0, 2.0]), 0.7, centres, radii, config
    np.testing.assert_allclose(module.compiled(*given), module.in_numpy(*given), atol=1e-9)


def test_the_textbook_filter_in_numpy_and_filterpy_give_the_numbers_of_ours():
    ukf = importlib.import_module("surefoot.benchmarks.ukf")
    steps = ukf.walk(np.random.default_rng(1))
    ours, theirs = (ukf.by(ukf.ukf_engine(name, ukf.START), steps) for name in ukf.ENGINES)
    assert ukf.apart(ours, theirs) < 1e-9
    assert ukf.apart(ours, ukf.in_numpy(steps)) < 1e-9


def test_every_benchmark_has_bounds_on_time_and_all_but_one_on_errors():
    loaded = [benchmark.load(name) for name in benchmark.names()]
    assert all(one.bars for one in loaded)
    assert [one.name for one in loaded if not one.limits] == ["monocular"]  # its error has a bar
