"""Where a robot stands when time begins, against what it is told of that."""

from __future__ import annotations

import numpy as np
import pytest

from perception.filtering.models import GYRO_BIAS
from perception.localisation.filter import PoseFilter
from perception.localisation.localiser_noise import GYRO_BIAS_SIGMA_RADPS
from perception.primitives.frame import Imu, StepOdometry
from perception.primitives.gaussian import Gaussian
from perception.primitives.pose import Pose2, wrap_angle
from sim.robot import SimulatedRobot
from sim.robot_config import RobotConfig
from sim.scenes import catalogue
from sim.world import World
from surefoot.config.presets import WALKED_LOCALISER
from surefoot.run.simulate import start_covariance


@pytest.mark.parametrize("body", ["kinematic", "dynamic"])
def test_whoever_walks_stands_about_its_mark_as_it_is_told(body):
    """One of these bodies twists by four degrees on its soles before it has settled."""
    off = []
    for seed in range(4):
        scene, config = catalogue.load("home", seed), RobotConfig(body=body)
        with World(scene, "tiny", seed) as world, SimulatedRobot(world, config, seed) as robot:
            error = robot.body.true_pose.vector - scene.start.vector
        error[2] = wrap_angle(error[2])
        off.append(error @ np.linalg.solve(start_covariance(config), error))
    assert max(off) < 16.3  # chi-square, 99.9 %


def test_who_twists_while_standing_is_followed_by_the_gyro_and_teaches_it_no_bias():
    """Ten degrees a second, gone in two: what a body does on its soles before they are at rest."""
    localiser = PoseFilter(
        Gaussian(np.zeros(3), start_covariance(RobotConfig(body="dynamic"))), (), WALKED_LOCALISER
    )
    dt, heading = 0.2, 0.0
    for k in range(20):
        rate = np.radians(10.0) * np.exp(-k * dt / 0.7)
        heading += rate * dt
        gyro = Imu(np.array([0.0, 0.0, rate + 0.001]), np.array([0.0, 0.0, 9.81]))
        localiser.predict(StepOdometry(Pose2(), 0.0), gyro, dt)
    assert np.degrees(abs(localiser.state.mean[2] - heading)) < 2.0
    assert abs(localiser.state.mean[GYRO_BIAS]) < 3.0 * GYRO_BIAS_SIGMA_RADPS
