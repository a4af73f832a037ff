"""The clock of a run follows the stamps, and never goes back."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from perception.monitoring.clock import RunClock

STEP = (0.45, 0.20)  # intervals of a walking robot: the second ends with a footstep


def walk_stamps(count: int) -> list[tuple[float, tuple[bool, float]]]:
    """Stamps of a walk, and what ends there: a frame at which a footstep is due or not, and the share made."""
    ends = np.cumsum(np.resize(STEP, count))
    return [
        (float(s), (number % 2 == 1, 0.8 if number % 2 else 0.2)) for number, s in enumerate(ends)
    ]


def test_without_a_fault_the_time_is_the_stamp_to_the_bit_and_nothing_is_missing():
    clock = RunClock()
    for stamp, due in walk_stamps(40):
        assert clock.read(stamp, due) == stamp
        assert clock.missing_s == 0.0
        assert not clock.set_back


def test_any_lost_frame_of_a_step_is_missed_and_its_time_is_known():
    for lost in (20, 21):
        clock = RunClock()
        frames = walk_stamps(40)
        for number, (stamp, due) in enumerate(frames):
            if number == lost:
                continue
            clock.read(stamp, due)
            expected = STEP[lost % 2] if number == lost + 1 else 0.0
            assert abs(clock.missing_s - expected) < 1e-9


def test_a_clock_that_is_set_back_goes_on_by_the_usual_interval():
    clock = RunClock()
    times = []
    for number, (stamp, due) in enumerate(walk_stamps(40)):
        times.append(clock.read(stamp - (1000.0 if number >= 20 else 0.0), due))
        assert clock.set_back == (number == 20)
        assert clock.missing_s == 0.0
    np.testing.assert_allclose(times, [stamp for stamp, _ in walk_stamps(40)], atol=1e-9)


def test_a_clock_that_is_set_ahead_counts_as_missing_time():
    clock = RunClock()
    for number, (stamp, due) in enumerate(walk_stamps(40)):
        clock.read(stamp + (1.0 if number >= 20 else 0.0), due)
        assert abs(clock.missing_s - (1.0 if number == 20 else 0.0)) < 1e-9


def test_a_new_pace_becomes_usual():
    clock = RunClock()
    stamps = [*np.arange(0.0, 3.0, 0.1), *np.arange(3.0, 13.0, 0.5)]
    missing = []
    for stamp in stamps:
        clock.read(float(stamp), (False, 0.0))
        missing.append(clock.missing_s)
    assert sum(one > 0.0 for one in missing) < 8
    assert missing[-1] == 0.0


def test_a_robot_that_walks_stands_and_makes_quick_steps_misses_nothing():
    """Standing and quick steps have frames closer together than those of a long step."""
    clock, stamp = RunClock(), 0.0
    long, quick, stands = (0.45, 0.2, 0.8), (0.2, 0.1, 0.9), (0.2, 0.0, 0.0)
    for first_s, first, second in (long, quick, long, stands, quick, long):
        for number in range(24):
            due = number % 2 == 1
            stamp += 0.2 if due else first_s
            clock.read(stamp, (due, second if due else first))
            assert clock.missing_s == 0.0


def test_a_robot_that_stands_as_long_as_a_long_step_takes_misses_nothing():
    """Its steps last longer than it stood at first: a Talos, which surveys and then walks."""
    clock, stamp = RunClock(), 0.0
    short, walks, long = (
        ((0.45, 0.2), (0.0, 0.0)),
        ((0.65, 0.2), (0.8, 0.2)),
        ((0.65, 0.2), (0.0, 0.0)),
    )
    for intervals, shares in (short, walks, long):
        for number in range(24):
            stamp += intervals[number % 2]
            clock.read(stamp, (number % 2 == 1, shares[number % 2]))
            assert clock.missing_s == 0.0


@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    st.lists(
        st.tuples(st.floats(-1e6, 1e6), st.tuples(st.booleans(), st.floats(0.0, 1.0))), max_size=30
    )
)
def test_time_never_goes_back_whatever_the_stamps(frames):
    clock = RunClock()
    times = [clock.read(stamp, due) for stamp, due in frames]
    assert all(a < b for a, b in pairwise(times))
    assert clock.missing_s >= 0.0
