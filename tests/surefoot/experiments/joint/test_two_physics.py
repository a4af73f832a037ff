"""What the comparison of engines computes: error of odometry per metre, and what differs between two walks."""

import math
from dataclasses import replace

import numpy as np
import pytest

from perception.primitives.errors import InputError
from surefoot.experiments.joint import two_physics


def test_odometry_that_tells_steps_too_long_errs_by_its_share_of_a_metre():
    true = np.tile([0.05, 0.0, 0.0], (50, 1))  # 2.5 m: two whole metres
    found = two_physics.drift_per_metre(true * [1.02, 1.0, 1.0], true)
    np.testing.assert_allclose(found, [[0.02, 0.0], [0.02, 0.0]], atol=1e-12)


def test_untold_turns_add_up_to_a_heading_and_bend_the_path():
    told = np.tile([0.05, 0.0, 0.0], (20, 1))
    turn = math.radians(0.5)
    ((off_m, turned),) = two_physics.drift_per_metre(told, told + np.array([0.0, 0.0, turn]))
    assert turned == pytest.approx(-20 * turn)
    assert off_m == pytest.approx(turn * 0.05 * 19 * 20 / 2, rel=0.01)  # sum of k turns a step


def test_only_the_engine_differs_between_two_walks_of_a_home():
    first, second = (two_physics.home(engine, 2000) for engine in two_physics.ENGINES)
    engine = replace(second.robot.dynamic, engine=first.robot.dynamic.engine)
    assert first != second
    assert first == replace(second, robot=replace(second.robot, dynamic=engine))


def test_a_kinematic_body_has_no_engine():
    with pytest.raises(InputError, match="needs no physics engine; use --body dynamic"):
        two_physics.run(1, print, body="kinematic")
