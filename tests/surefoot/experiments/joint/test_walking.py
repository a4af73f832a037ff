"""A short version of the walking experiment: random commands within the gait limits cause no fall."""

import pytest

from surefoot.experiments.joint import walking


@pytest.mark.parametrize("seed", [0, 1])
def test_thirty_random_commands_are_walked_without_a_fall(seed):
    walked = walking.walk(walking.TRIALS[0], seed, commands=30)
    assert not walked.fallen
    assert walked.steps == 30
