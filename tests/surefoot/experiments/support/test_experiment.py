"""The registry of experiments; experiments with either body or both, and refusal where no robot walks."""

import pytest

from perception.primitives.errors import InputError
from surefoot.experiments.support import experiment
from surefoot.experiments.support.experiment import Experiment, Outcome, Target


def quiet(text):
    pass


def fake_walk(seeds, say, body="kinematic"):
    return Outcome({"falls": 0.0 if body == "kinematic" else 2.0, "runs": float(seeds)}, [body])


WALK = Experiment("test", "t", fake_walk, {"falls": Target("==", 0.0)}, seeds=3, body="kinematic")


@pytest.mark.parametrize(("body", "falls"), [(None, 0.0), ("kinematic", 0.0), ("dynamic", 2.0)])
def test_the_requested_body_walks(body, falls):
    found, outcome = experiment.measure(WALK, quiet, body=body)
    assert outcome.figures == {"falls": falls, "runs": 3.0}
    assert experiment.judge(found, outcome)["passed"] == (falls == 0.0)


def test_both_bodies_have_the_same_targets_and_a_comparison():
    found, outcome = experiment.measure(WALK, quiet, 5, "both")
    result = experiment.judge(found, outcome)
    assert result["figures"]["falls"] == 0.0
    assert result["figures"]["falls_dynamic"] == 2.0
    assert result["targets"] == {"falls": ["==", 0.0], "falls_dynamic": ["==", 0.0]}
    assert not result["passed"]
    assert outcome.table[-2].split() == ["falls", "0", "2"]


def test_a_body_is_refused_where_no_robot_walks():
    with pytest.raises(
        InputError,
        match=r"no robot walks .* these experiments do: .*004-E3, .*INT-1, .*localisation",
    ):
        experiment.measure(experiment.load("004-E2"), quiet, body="dynamic")


@pytest.mark.parametrize("body", ["kinematic", "both"])
def test_the_walking_experiment_refuses_a_body_that_cannot_fall(body):
    chosen = experiment.load("walking")
    assert chosen.body == "dynamic"
    with pytest.raises(InputError, match=r"body=kinematic .* cannot fall; use --body dynamic"):
        experiment.measure(chosen, quiet, 1, body)


@pytest.mark.parametrize("name", experiment.names())
def test_every_experiment_has_a_valid_default_body(name):
    assert experiment.load(name).body in ("", *experiment.BODIES)


def test_combined_parts_keep_all_figures_and_lines_in_order():
    outcome = experiment.combined(({"a": 1.0}, ["first"]), ({"b": 2.0}, ["second", "third"]))
    assert outcome.figures == {"a": 1.0, "b": 2.0}
    assert outcome.table == ["first", "second", "third"]


def test_an_unknown_id_suggests_the_nearest():
    with pytest.raises(InputError, match=r"did you mean 004-features\?"):
        experiment.load("004-feature")
