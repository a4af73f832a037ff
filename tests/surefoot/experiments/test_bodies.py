"""Either body can walk an experiment, or both beside each other; where nothing walks none can be asked for."""

import pytest

from perception.primitives.errors import InputError
from surefoot.experiments.support import experiment
from surefoot.experiments.support.experiment import Experiment, Outcome, Target


def quiet(text):
    pass


def limp(seeds, say, body="kinematic"):
    return Outcome({"falls": 0.0 if body == "kinematic" else 2.0, "runs": float(seeds)}, [body])


WALK = Experiment("test", "t", limp, {"falls": Target("==", 0.0)}, seeds=3, body="kinematic")


@pytest.mark.parametrize(("body", "falls"), [(None, 0.0), ("kinematic", 0.0), ("dynamic", 2.0)])
def test_the_body_asked_for_walks(body, falls):
    found, outcome = experiment.measure(WALK, quiet, body=body)
    assert outcome.figures == {"falls": falls, "runs": 3.0}
    assert experiment.judge(found, outcome)["passed"] == (falls == 0.0)


def test_both_are_held_to_the_same_targets_and_stand_beside_each_other():
    found, outcome = experiment.measure(WALK, quiet, 5, "both")
    result = experiment.judge(found, outcome)
    assert result["figures"]["falls"] == 0.0
    assert result["figures"]["falls_dynamic"] == 2.0
    assert result["targets"] == {"falls": ["==", 0.0], "falls_dynamic": ["==", 0.0]}
    assert not result["passed"]
    assert outcome.table[-2].split() == ["falls", "0", "2"]


def test_where_nothing_walks_no_body_can_be_asked_for():
    with pytest.raises(
        InputError, match=r"nothing walks .* these do: .*INT-1, localisation, 004-E3"
    ):
        experiment.measure(experiment.load("004-E2"), quiet, body="dynamic")


@pytest.mark.parametrize("body", ["kinematic", "both"])
def test_the_trial_of_the_walk_itself_takes_no_body_that_cannot_fall(body):
    chosen = experiment.load("walking")
    assert chosen.body == "dynamic"
    with pytest.raises(InputError, match=r"body=kinematic .* cannot fall; take --body dynamic"):
        experiment.measure(chosen, quiet, 1, body)


@pytest.mark.parametrize("name", experiment.names())
def test_every_experiment_knows_its_default_body(name):
    assert experiment.load(name).body in ("", *experiment.BODIES)
