"""The first gaze policy: a look round, then the way ahead often enough, and movers not lost from sight."""

from __future__ import annotations

import math

import numpy as np
import pytest

from perception.primitives.errors import ConfigError
from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import Obstacle
from perception.primitives.pose import Pose2
from planning.gaze.sweep import Sweep, SweepConfig

STEP_S = 0.65
VIA = np.array([2.0, 0.0])
CONFIG = SweepConfig()


def mover(x, y, seen_s, vx=0.0, vy=0.0, moving=1.0):
    state = Gaussian(np.array([x, y, vx, vy]), np.eye(4) * 1e-4)
    return Obstacle(state, 0.1, 0.4, 7, moving, seen_s, 0.0)


def surveyed():
    """A sweep that has looked round, and the time."""
    sweep, now = Sweep(CONFIG), 0.0
    while sweep.surveying:
        sweep.next(now, Pose2(), VIA, [])
        now += STEP_S
    return sweep, now


def test_the_first_look_round_covers_the_reach_of_the_neck_without_gaps():
    sweep, pans = Sweep(CONFIG), []
    assert sweep.surveying
    for k in range(len(CONFIG.survey_pans_deg)):
        pans.append(math.degrees(sweep.next(k * STEP_S, Pose2(), VIA, []).pan_rad))
        assert sweep.surveying
    sweep.next(10.0, Pose2(), VIA, [])
    assert not sweep.surveying
    order = np.unique(np.round(pans, 6))
    assert order[0] - 22 <= -100
    assert order[-1] + 22 >= 100
    assert np.diff(order).max() < 44.0  # narrower than the narrowest view


@pytest.mark.parametrize("with_mover", [False, True])
@pytest.mark.parametrize("bearing", np.radians([-60, 0, 35]))
def test_the_walking_direction_is_never_unwatched_for_more_than_two_seconds(bearing, with_mover):
    sweep, now = surveyed()
    via = 2.0 * np.array([math.cos(bearing), math.sin(bearing)])
    seen = now
    for _ in range(60):
        others = [mover(0.0, -0.8, seen_s=now - 5.0)] if with_mover else []
        gaze = sweep.next(now, Pose2(), via, others)
        now += STEP_S
        if abs(gaze.pan_rad - bearing) <= math.radians(CONFIG.view_deg / 2):
            seen = now
        assert now - seen <= 2.0 + 1e-9


def test_between_it_looks_to_both_sides():
    sweep, now = surveyed()
    pans = [sweep.next(now + k * STEP_S, Pose2(), VIA, []).pan_rad for k in range(16)]
    assert max(pans) >= math.radians(60)
    assert min(pans) <= -math.radians(60)


def test_a_mover_unseen_for_more_than_a_second_is_looked_at_next_but_one_at_the_latest():
    sweep, now = surveyed()
    lost = mover(0.8, 0.9, seen_s=now - 1.2)
    wanted = math.atan2(0.9, 0.8)
    pans = [sweep.next(now + k * STEP_S, Pose2(), VIA, [lost]).pan_rad for k in range(2)]
    assert min(abs(pan - wanted) for pan in pans) < math.radians(10)


@pytest.mark.parametrize(
    "other",
    [mover(0.1, 3.0, -10.0), mover(-1.0, 0.0, -10.0), mover(0.1, 1.0, -10.0, moving=0.0)],
    ids=["far", "behind", "standing"],
)
def test_what_is_far_or_out_of_reach_or_stands_changes_nothing(other):
    one, now = surveyed()
    two, _ = surveyed()
    for k in range(12):
        stamp = now + k * STEP_S
        assert one.next(stamp, Pose2(), VIA, [other]) == two.next(stamp, Pose2(), VIA, [])


def test_two_lost_movers_are_looked_for_in_turn():
    sweep, now = surveyed()
    left, right = mover(0.5, 1.2, -30.0), mover(0.5, -1.0, 5.0)
    right = Obstacle(right.state, 0.1, 0.4, 8, 1.0, 5.0, 0.0)
    pans = np.array(
        [sweep.next(now + k * STEP_S, Pose2(), VIA, [left, right]).pan_rad for k in range(12)]
    )
    assert np.any(pans > 1.0)
    assert np.any(pans < -0.8)


def test_no_gaze_exceeds_the_neck_and_the_floor_near_the_feet_is_seen():
    sweep, now = surveyed()
    rng = np.random.default_rng(4)
    for k in range(100):
        robot = Pose2(0.0, 0.0, rng.uniform(-3, 3))
        gaze = sweep.next(now + k * STEP_S, robot, rng.uniform(-2, 2, 2), [mover(0.5, 0.5, -9.0)])
        assert abs(gaze.pan_rad) <= math.radians(90) + 1e-12
        lower, upper = gaze.tilt_rad + math.radians(17.5), gaze.tilt_rad - math.radians(17.5)
        assert 0.38 / math.tan(lower) <= 0.42
        assert upper > 0.0
        assert 0.38 / math.tan(upper) >= 0.9


def test_a_pan_beyond_the_neck_is_refused():
    with pytest.raises(ConfigError, match="range of 90"):
        Sweep(SweepConfig(glance_pans_deg=(120.0,)))
