"""The zero moment point: inside the stance foot, and between the feet in double support."""

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from planning.commands import WalkCommand
from sim.body.gait import Gait, GaitConfig
from sim.body.pendulum import GRAVITY_MPS2

CONFIG = GaitConfig()
OMEGA = math.sqrt(GRAVITY_MPS2 / CONFIG.com_height_m)
HALF_LENGTH_M, HALF_WIDTH_M, OUTWARD_M = 0.052, 0.033, 0.005  # DARwIn-OP

commands = st.builds(
    WalkCommand,
    st.floats(-0.03, 0.08),
    st.floats(-0.02, 0.02),
    st.floats(-math.radians(14), math.radians(14)),
)


def zero_moment_points(step, capture):
    """p = xi - xi' / w in the middle of every tick, from the mass centre and its velocity; and xi at the end."""
    after = step.com + step.com_velocity / OMEGA
    before = np.vstack([capture, after[:-1]])
    growth = math.exp(OMEGA * CONFIG.tick_s)
    return (after - growth * before) / (1.0 - growth), after[-1]


def inside(point, foot, side, margin):
    """Whether a point lies inside the sole of a foot (x, y, yaw)."""
    c, s = math.cos(foot[2]), math.sin(foot[2])
    x, y = point - foot[:2]
    ahead, left = c * x + s * y, c * y - s * x - side * OUTWARD_M
    return abs(ahead) <= HALF_LENGTH_M + margin and abs(left) <= HALF_WIDTH_M + margin


@settings(max_examples=25, deadline=None)
@given(st.lists(commands, min_size=4, max_size=8))
def test_zmp_stays_inside_the_stance_foot(asked):
    gait, capture = Gait(CONFIG), np.zeros(2)
    for command in asked:
        step = gait.step(command)
        points, capture = zero_moment_points(step, capture)
        if not step.stepping:
            continue
        side = -step.swing
        feet = step.left if side > 0 else step.right
        for k in range(step.double_support_ticks, step.ticks):
            assert inside(points[k], feet[k], side, 1e-6)


@settings(max_examples=25, deadline=None)
@given(commands)
def test_zmp_moves_straight_from_foot_to_foot_in_a_steady_walk(command):
    gait, capture = Gait(CONFIG), np.zeros(2)
    for number in range(8):
        step = gait.step(command)
        points, capture = zero_moment_points(step, capture)
        if number < 6 or not step.stepping:
            continue
        first, last = points[0], points[step.double_support_ticks - 1]
        way = last - first
        for k in range(step.double_support_ticks):
            share = k / (step.double_support_ticks - 1)
            np.testing.assert_allclose(points[k], first + share * way, atol=2e-3)
