"""Values that a body asks for."""

import pytest

from sim.robot_config import RobotConfig
from sim.robots import catalogue
from surefoot.config.presets import fitted
from surefoot.config.schema import Config


@pytest.mark.parametrize("name", catalogue.names())
def test_no_longer_steps_are_planned_than_a_body_takes(name):
    robot, found = catalogue.load(name), {}
    for body in ("kinematic", "dynamic"):
        config = fitted(Config(robot=RobotConfig(model=name, body=body)))
        gait = config.robot_model.gait
        found[body] = gait.max_speed_mps * gait.step_s
        assert gait.cruise_mps <= gait.max_speed_mps
    gait = robot.model.gait
    assert found["kinematic"] == pytest.approx(gait.max_speed_mps * gait.step_s)
    assert found["dynamic"] <= robot.dynamic.step_m + 1e-12
