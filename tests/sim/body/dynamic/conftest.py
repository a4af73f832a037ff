"""Pushed bodies on an empty floor."""

import math

import numpy as np
import pytest

from perception.primitives.pose import Pose2
from sim.body.dynamic.config import DynamicConfig
from sim.body.dynamic.walker import DynamicBody
from sim.body.gait import GaitConfig
from sim.body.head import Head, HeadConfig
from sim.body.inertial import ImuConfig
from sim.scene import FloorArea, Scene
from sim.world import World

_EXTENT = (-2.0, -2.0, 2.0, 2.0)
_FLOOR = Scene("floor", 0, _EXTENT, (FloorArea("plaster/white", _EXTENT),), (), (), (), Pose2(), ())


def _pushed(balance, seed, command, share, angle, steps=16):
    """Push a body with 1 N s during a swing of its left foot; no push if the angle is None.

    Returns:
        Planned poses at the end of each step, the last one that of a fall, and whether it fell.
    """
    body_rng, head_rng = (np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(2))
    head, planned = Head(HeadConfig(), head_rng), []
    with World(_FLOOR, "tiny", seed) as world:
        config = DynamicConfig(balance=balance)
        body = DynamicBody(world, GaitConfig(), config, ImuConfig(), head, body_rng)
        for number in range(steps):
            body.walk(command)
            body.start_due_step()
            if number == 5 and angle is not None:
                body.advance(70 + round(60 * share))
                yaw = body.true_pose.yaw + angle
                body.push(10.0 * np.array([math.cos(yaw), math.sin(yaw), 0.0]), 0.1)
            if body.ticks_left:
                body.advance(body.ticks_left)
            planned.append(body.planned_pose)
            if body.fallen:
                break
        fallen = body.fallen
        body.close()
    return planned, fallen


@pytest.fixture
def bare_floor():
    return _FLOOR


@pytest.fixture
def pushed():
    return _pushed
