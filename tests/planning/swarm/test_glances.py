"""Looking aside: only for who is near, lost and beside; never twice running; never past him."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.primitives.errors import ConfigError
from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import Obstacle
from perception.primitives.pose import Pose2
from planning.swarm.glances import GlanceConfig, Glances

ROBOT = Pose2(1.0, 2.0, 0.5)


def mover(away, bearing, seen_s=0.0):
    place = ROBOT.apply(away * np.array([math.cos(bearing), math.sin(bearing)]))
    return Obstacle(
        Gaussian(np.array([*place, 0.06, 0.0]), np.eye(4) * 1e-4), 0.04, moving=1.0, seen_s=seen_s
    )


def glancing(**changed):
    return Glances(GlanceConfig(**changed), 0.15, 0.10)


def pan(*movers, stamp_s=2.0):
    return glancing().next(ROBOT, movers, stamp_s)


@given(st.floats(0.3, 1.2), st.floats(40.0, 115.0), st.sampled_from([-1.0, 1.0]))
def test_who_is_lost_beside_comes_into_a_view_of_90_degrees(away, degrees, side):
    bearing = side * math.radians(degrees)
    assert abs(bearing - pan(mover(away, bearing))) < math.radians(45.0 + 1e-6)


@pytest.mark.parametrize(
    "calm",
    [mover(0.8, 0.1), mover(0.8, 3.0), mover(2.0, 1.2), mover(0.8, 1.2, seen_s=1.9)],
    ids=["ahead", "behind", "far", "just seen"],
)
def test_for_nobody_else_the_head_turns(calm):
    assert pan(calm) == 0.0


def test_after_a_glance_the_head_looks_ahead_for_a_step():
    glances = glancing()
    pans = [glances.next(ROBOT, [mover(0.8, 1.2)], 2.0 + 0.65 * k) for k in range(6)]
    assert [value > 0.0 for value in pans] == [True, False] * 3


def test_the_nearest_is_looked_for_first():
    assert pan(mover(1.0, 1.2), mover(0.5, -1.2)) < 0.0


def test_who_is_near_is_looked_for_before_who_was_lost_for_longer():
    near, lost = mover(0.35, -1.0, seen_s=1.35), mover(0.75, 1.0, seen_s=0.05)
    assert pan(near, lost) < 0.0


def test_who_was_lost_for_long_is_looked_for_before_who_is_somewhat_nearer():
    near, lost = mover(0.6, -1.0, seen_s=1.35), mover(0.75, 1.0, seen_s=-1.0)
    assert pan(near, lost) > 0.0


def test_it_can_be_switched_off():
    assert glancing(enabled=False).next(ROBOT, [mover(0.8, 1.2)], 2.0) == 0.0


def test_an_angle_that_is_none_is_refused():
    with pytest.raises(ConfigError, match="from_deg"):
        GlanceConfig(from_deg=0.0)


def test_who_waits_looks_to_both_sides_by_turns_and_ahead_between():
    looks = glancing()
    pans = [looks.next(ROBOT, [], 0.65 * k, waits=True) for k in range(8)]
    assert all(pan == 0.0 for pan in pans[1::2])
    aside = np.degrees(pans[::2])
    np.testing.assert_allclose(np.abs(aside), GlanceConfig().most_deg)
    assert (np.sign(aside[1:]) == -np.sign(aside[:-1])).all()


def test_who_waits_looks_first_for_whom_it_has_lost():
    found = glancing().next(ROBOT, [mover(0.8, -1.2)], 2.0, waits=True)
    assert -1.2 <= found < -0.6
