"""Where a robot stands when time begins, against what it is told of that."""

from __future__ import annotations

import numpy as np
import pytest

from perception.primitives.pose import wrap_angle
from sim import scenes
from sim.robot import RobotConfig, SimulatedRobot
from sim.world import World
from surefoot.runs import start_covariance


@pytest.mark.parametrize("body", ["kinematic", "dynamic"])
def test_whoever_walks_stands_about_its_mark_as_it_is_told(body):
    """One of these bodies twists by four degrees on its soles before it has settled."""
    off = []
    for seed in range(4):
        scene, config = scenes.load("home", seed), RobotConfig(body=body)
        with World(scene, "tiny", seed) as world, SimulatedRobot(world, config, seed) as robot:
            error = robot.body.true_pose.vector - scene.start.vector
        error[2] = wrap_angle(error[2])
        off.append(error @ np.linalg.solve(start_covariance(config), error))
    assert max(off) < 16.3  # chi-square, 99.9 %
