"""The part of a log that tells its noise: sightings of a robot in motion, and not too many."""

from __future__ import annotations

import numpy as np
import pytest

from perception.planar.planar_log import PlanarLog


def stands_then_drives(rest_s, drive_s, per_s=10, speed=0.3):
    """Odometry at 10 Hz, 0 while the robot stands; two landmarks seen at every stamp of a grid."""
    stamps = np.arange(0.0, rest_s + drive_s, 0.1)
    totals = np.stack([speed * np.maximum(stamps - rest_s, 0.0), np.zeros(len(stamps))], axis=-1)
    seen_s = np.repeat(np.arange(0.0, rest_s + drive_s - 0.2, 1.0 / per_s), 2)
    marks = np.tile([0, 1], len(seen_s) // 2)
    seen = np.tile([[3.0, 0.1]], (len(seen_s), 1))
    return PlanarLog(stamps, totals, seen_s, marks, seen, np.array([[3.0, 0.3], [3.0, -0.3]]))


@pytest.mark.parametrize("rest_s", [0.0, 60.0])
def test_the_time_of_the_first_part_counts_while_the_robot_moves(rest_s):
    part = stands_then_drives(rest_s, 100.0).first_part(0.0, 1, 40.0, 10_000)
    assert part.seen_s[-1] == pytest.approx(rest_s + 40.0, abs=0.3)


@pytest.mark.parametrize("rest_s", [0.0, 60.0])
def test_the_sightings_of_the_first_part_count_while_the_robot_moves(rest_s):
    part = stands_then_drives(rest_s, 100.0).first_part(0.0, 600, 1.0, 10_000)
    assert part.seen_s[-1] == pytest.approx(rest_s + 30.0, abs=0.3)


def test_of_many_sightings_whole_stamps_are_kept_evenly():
    log = stands_then_drives(30.0, 60.0)
    part = log.first_part(10.0, 600, 40.0, 300)
    assert 290 <= len(part.seen_s) <= 310
    stamps, count = np.unique(part.seen_s, return_counts=True)
    assert np.all(count == 2)
    gaps = np.diff([10.0, *stamps, 70.0])
    assert gaps.max() < 2.0 * gaps.mean()


@pytest.mark.parametrize("beacons", [2, 3, 4, 8])
def test_beacons_that_are_asked_in_turn_are_all_kept(beacons):
    log = stands_then_drives(0.0, 300.0, per_s=20)
    places = np.arange(2.0 * beacons).reshape(beacons, 2)
    marks = np.arange(len(log.seen_s)) % beacons
    stamps = np.linspace(0.0, 299.0, len(marks))
    log = PlanarLog(log.stamps_s, log.totals, stamps, marks, log.seen, places)
    count = np.bincount(log.first_part(0.0, 600, 250.0, 850).marks, minlength=beacons)
    assert count.min() > 0.9 * count.max()


def test_a_robot_that_never_moves_gives_its_whole_log():
    log = stands_then_drives(50.0, 0.0)
    assert log.first_part(5.0, 600, 120.0, 10_000).seen_s[-1] == log.seen_s[-1]
