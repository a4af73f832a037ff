"""The gait: the pendulum in closed form, and footsteps at the commanded poses."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from perception.primitives.errors import ConfigError
from perception.primitives.pose import Pose2
from planning.commands import WalkCommand
from sim.body.gait import Gait, GaitConfig
from sim.body.pendulum import GRAVITY_MPS2, Phase, capture_point_before, pendulum

CONFIG = GaitConfig()
TICKS = 130  # 0.65 s at 5 ms


def walk(commands: list[WalkCommand]) -> list:
    gait = Gait(CONFIG)
    return [gait.step(command) for command in commands]


def test_a_periodic_pendulum_step_ends_in_its_initial_state():
    # seed 000: x0' = a (1 + cosh(T/T_c)) / (T_c sinh(T/T_c)) carries -a to +a with the same speed
    height, seconds, a = 0.25, 0.30, 0.02
    T_c = math.sqrt(height / GRAVITY_MPS2)
    speed = a * (1 + math.cosh(seconds / T_c)) / (T_c * math.sinh(seconds / T_c))
    position, after = pendulum(-a, speed, 0.0, seconds, height)
    assert position == pytest.approx(a, abs=1e-12)
    assert after == pytest.approx(speed, abs=1e-12)


def test_pendulum_agrees_with_numerical_integration():
    x, v, dt = -0.02, 0.13, 1e-5
    for _ in range(30_000):
        a = GRAVITY_MPS2 / 0.25 * (x - 0.005)
        x, v = x + v * dt + a * dt * dt / 2, v + a * dt
    position, velocity = pendulum(-0.02, 0.13, 0.005, 0.3, 0.25)
    assert position == pytest.approx(x, abs=2e-5)
    assert velocity == pytest.approx(v, abs=2e-4)


@given(st.tuples(*[st.floats(-0.2, 0.2)] * 6), st.floats(0.05, 0.6), st.floats(4.0, 8.0))
def test_capture_point_solves_its_differential_equation(values, duration, omega):
    start, end, after = (np.array(values[k : k + 2]) for k in (0, 2, 4))
    phase = Phase(start, end, duration)
    remaining, h = duration / 2, 1e-5
    here, earlier, later = (
        capture_point_before(after, phase, remaining + d, omega) for d in (0.0, h, -h)
    )
    zmp = (start + end) / 2
    np.testing.assert_allclose((later - earlier) / (2 * h), omega * (here - zmp), atol=1e-5)
    np.testing.assert_allclose(capture_point_before(after, phase, 0.0, omega), after, atol=1e-15)


def test_mass_centre_follows_the_pendulum_with_a_zmp_inside_the_feet():
    steps = walk([WalkCommand(0.0455)] * 12)
    com = np.concatenate([s.com for s in steps[4:]])
    velocity = np.concatenate([s.com_velocity for s in steps[4:]])
    np.testing.assert_allclose(
        np.diff(com, axis=0) / 0.005, (velocity[1:] + velocity[:-1]) / 2, atol=5e-4
    )
    acceleration = (com[2:] - 2 * com[1:-1] + com[:-2]) / 0.005**2
    zmp = com[1:-1] - acceleration * CONFIG.com_height_m / GRAVITY_MPS2
    left = np.concatenate([s.left for s in steps[4:]])[1:-1]
    right = np.concatenate([s.right for s in steps[4:]])[1:-1]
    # in single support the ZMP is 4 mm inward of the stance ankle
    single = np.concatenate([np.arange(TICKS) > 75 for _ in steps[4:]])[1:-1]
    single &= np.roll(single, -3) & np.roll(single, 3)
    away = np.minimum(
        np.linalg.norm(zmp - left[:, :2], axis=1), np.linalg.norm(zmp - right[:, :2], axis=1)
    )
    assert away[single].max() < 0.006
    # and always between the feet
    assert np.all(zmp[:, 1] < np.maximum(left[:, 1], right[:, 1]) + 0.002)
    assert np.all(zmp[:, 1] > np.minimum(left[:, 1], right[:, 1]) - 0.002)


def test_mass_centre_is_continuous_when_commands_change():
    rng = np.random.default_rng(0)
    commands = [
        WalkCommand(*(rng.uniform([-0.03, -0.02, -0.24], [0.07, 0.02, 0.24]))) for _ in range(60)
    ]
    steps = walk(commands)
    velocity = np.concatenate([s.com_velocity for s in steps])
    com = np.concatenate([s.com for s in steps])
    assert np.abs(np.diff(velocity, axis=0)).max() < 0.03  # 6 m/s^2 over a tick
    middle = np.concatenate([s.body for s in steps])[:, :2]
    assert np.linalg.norm(com - middle, axis=1).max() < 0.09  # stays near the feet


turns = st.floats(-math.radians(14), math.radians(14))
commands = st.builds(WalkCommand, st.floats(-0.03, 0.08), st.floats(-0.02, 0.02), turns)


@settings(max_examples=30, deadline=None)
@given(st.lists(commands, min_size=1, max_size=8))
def test_feet_land_at_the_commanded_poses(asked):
    steps = walk([*asked, WalkCommand(), WalkCommand()])
    frame = Pose2()
    for command in asked:
        limited = frame @ Pose2(command.forward_m, command.lateral_m, command.turn_rad)
        frame = limited
    x, y, yaw = steps[-1].body[-1]
    turned = max(abs(c.turn_rad) for c in asked)
    if turned < 1e-6:  # rotation in place may need a wider step than commanded
        np.testing.assert_allclose([x, y], [frame.x, frame.y], atol=1e-9)
    assert math.remainder(yaw - frame.yaw, 2 * math.pi) == pytest.approx(0.0, abs=1e-9)


def test_feet_keep_the_minimum_distance():
    rng = np.random.default_rng(1)
    gait = Gait(CONFIG)
    for _ in range(200):
        step = gait.step(WalkCommand(*rng.uniform([-0.03, -0.06, -0.3], [0.08, 0.06, 0.3])))
        left, right = Pose2(*step.left[-1]), Pose2(*step.right[-1])
        stance, swing, side = (right, left, 1) if step.swing > 0 else (left, right, -1)
        assert side * (stance.inverse() @ swing).y >= CONFIG.narrowest_m - 1e-3


def test_gait_stands_without_a_command():
    for step in walk([WalkCommand()] * 3):
        assert not step.stepping
        assert np.all(step.body == 0.0)
        assert np.abs(step.com).max() < 1e-12


def test_commands_beyond_the_limits_are_clipped():
    walked = walk([WalkCommand(1.0, 0.0, 0.0)] * 6)
    stride = walked[-1].body[-1, 0] - walked[-2].body[-1, 0]
    assert stride == pytest.approx(CONFIG.forward_limit_m, abs=1e-9)
    turned = walk([WalkCommand(0.0, 0.0, 3.0)] * 6)
    turn = turned[-1].body[-1, 2] - turned[-2].body[-1, 2]
    assert turn == pytest.approx(math.radians(14.0), abs=1e-9)


def test_lateral_motion_of_the_walk_agrees_with_measurements():
    steps = walk([WalkCommand(0.0455)] * 20)[4:]
    sway = np.concatenate([s.com[:, 1] - s.body[:, 1] for s in steps])
    assert 0.018 < sway.std() < 0.030  # 27 mm on the dynamic walker
    assert np.abs(sway).max() < 0.037


def test_an_invalid_tick_is_refused():
    with pytest.raises(ConfigError, match="tick_s=0"):
        GaitConfig(tick_s=0.0)


@pytest.mark.parametrize("astray", [0.02, -0.05])
def test_a_recovery_step_is_extended_and_the_next_one_is_as_commanded(astray):
    gait, other = Gait(CONFIG), Gait(CONFIG)
    for one in (gait, other):
        one.step(WalkCommand(0.03))
    pushed, usual = gait.step(WalkCommand(0.03), astray), other.step(WalkCommand(0.03))
    foot = "left" if usual.swing > 0 else "right"
    moved = getattr(pushed, foot)[-1] - getattr(usual, foot)[-1]
    assert moved == pytest.approx([astray, 0.0, 0.0], abs=1e-12)
    later, usual = gait.step(WalkCommand(0.03)), other.step(WalkCommand(0.03))
    assert later.body[-1] - usual.body[-1] == pytest.approx([astray, 0.0, 0.0], abs=1e-12)


def test_a_recovery_step_stays_within_its_limits():
    for astray, most in ((0.5, CONFIG.rescue_forward_m), (-0.5, -CONFIG.rescue_back_m)):
        gait = Gait(CONFIG)
        step = gait.step(WalkCommand(), astray)
        assert step.stepping
        assert (step.left if step.swing > 0 else step.right)[-1, 0] == pytest.approx(most)


def test_the_gait_continues_from_an_early_landing():
    gait = Gait(CONFIG)
    gait.step(WalkCommand(0.04))
    step = gait.step(WalkCommand(0.04))
    tick = step.double_support_ticks + 25
    gait.land(step, tick)
    there = (step.left if step.swing > 0 else step.right)[tick]
    following = gait.step(WalkCommand(0.04))
    assert following.swing == -step.swing
    stands = following.left if step.swing > 0 else following.right
    assert stands == pytest.approx(np.tile(there, (following.ticks, 1)), abs=1e-12)
    # the zero moment point stays in it, xi' = w (xi - p), slightly inward of its ankle
    omega = math.sqrt(GRAVITY_MPS2 / CONFIG.com_height_m)
    before, after = (following.com + following.com_velocity / omega)[-2:]
    growth = math.exp(omega * CONFIG.tick_s)
    zmp = (after - growth * before) / (1.0 - growth)
    inside = there[:2] - [0.0, step.swing * CONFIG.zmp_inward_m]
    assert zmp == pytest.approx(inside, abs=1e-9)
