"""A pose from a stretch of a log without start: drives whose poses are known, with ranges or tags."""

from __future__ import annotations

import math

import numpy as np
import pytest

from perception.planar.fix import find_fix
from perception.planar.planar import PlanarPrior
from perception.planar.planar_log import PlanarLog
from perception.primitives.errors import InputError

SQUARE = np.array([(8.0, 7.0), (-7.0, 8.0), (-8.0, -6.0), (9.0, -8.0)])
ROW = np.array([(-6.0, 0.0), (-1.0, 0.0), (3.0, 0.0), (7.0, 0.0)])
PRIOR = PlanarPrior(
    odometry_scale_sigma=0.1,
    turn_scale_sigma=0.1,
    drift_sigma=0.02,
    gain_sigma=0.1,
    offset_sigma=1.0,
)


def drive(
    rate, places, tags=False, speed=0.4, gain=1.0, offset=0.0, outliers=0.0, start=(-4.0, 1.0, 0.3)
):
    """A log of 30 s at a constant speed, and the true pose at its last instant."""
    rng, dt = np.random.default_rng(5), 0.1
    pose, totals, seen_s, marks, seen = np.array(start), [np.zeros(2)], [], [], []
    poses = [pose]
    for k in range(1, 301):
        turn = rate(k * dt) * dt
        middle = pose[2] + turn / 2.0
        pose = pose + np.array([speed * dt * math.cos(middle), speed * dt * math.sin(middle), turn])
        poses.append(pose)
        totals.append(totals[-1] + [speed * dt, turn])
        if k % 3:
            continue
        mark = k // 3 % len(places)
        x, y = places[mark] - pose[:2]
        far, bearing = math.hypot(x, y), math.atan2(y, x) - pose[2]
        depth = far * math.cos(bearing) if tags else far
        if tags and math.cos(bearing) < 0.5:
            continue
        if rng.random() < outliers:
            depth = rng.uniform(1.0, 15.0)
        seen_s.append(k * dt)
        marks.append(mark)
        bearing = math.nan if not tags else bearing + 0.005 * rng.normal()
        seen.append([offset + gain * depth + 0.03 * rng.normal(), bearing])
    stamps = np.arange(301) * dt
    log = PlanarLog(
        stamps, np.array(totals), np.array(seen_s), np.array(marks), np.array(seen), places
    )
    return log, poses[round(log.instants()[-1] / dt)]


def fix_of(log, prior=PRIOR):
    journey = log.journey()
    return find_fix(journey, 0, len(journey.steps), prior)


def away(found, pose):
    error = found.state.mean[:3] - pose
    error[2] = math.remainder(error[2], 2.0 * math.pi)
    return error, np.sqrt(np.diag(found.state.covariance)[:3])


@pytest.mark.parametrize("heading", [0.3, 3.4])
def test_a_driving_robot_is_found_by_long_ranges_with_outliers(heading):
    log, pose = drive(
        lambda t: 0.15, SQUARE, gain=1.06, offset=0.4, outliers=0.15, start=(-2.0, 1.0, heading)
    )
    error, sigma = away(fix_of(log), pose)
    assert np.all(np.abs(error) < 4.0 * sigma)
    assert np.hypot(*error[:2]) < 0.5


def test_a_robot_is_found_by_tags_although_its_gyro_drifts():
    log, pose = drive(lambda t: 0.15, SQUARE, tags=True, outliers=0.15)
    totals = log.totals + np.outer(log.stamps_s, [0.0, math.radians(0.5)])
    drifting = PlanarLog(log.stamps_s, totals, log.seen_s, log.marks, log.seen, log.places)
    found = fix_of(drifting)
    error, sigma = away(found, pose)
    assert np.all(np.abs(error) < 4.0 * sigma)
    assert np.hypot(*error[:2]) < 0.15


def test_a_standing_robot_has_no_heading_by_ranges_alone():
    log, _ = drive(lambda t: 0.0, SQUARE, speed=0.0)
    assert fix_of(log) is None


def test_along_a_row_of_beacons_the_side_stays_open():
    log, _ = drive(lambda t: 0.0, ROW, start=(-6.0, 1.5, 0.0))
    assert fix_of(log) is None


def test_a_turn_beside_a_row_of_beacons_tells_the_side():
    log, pose = drive(lambda t: 0.2 if t > 10.0 else 0.0, ROW, start=(-6.0, 1.5, 0.0))
    error, _ = away(fix_of(log), pose)
    assert np.hypot(*error[:2]) < 0.5


def test_sightings_of_nothing_give_no_pose():
    log, _ = drive(lambda t: 0.15, SQUARE, outliers=1.0)
    assert fix_of(log) is None


def test_a_log_that_goes_back_in_time_is_refused():
    log, _ = drive(lambda t: 0.15, SQUARE)
    with pytest.raises(InputError, match="go back in time"):
        PlanarLog(log.stamps_s[::-1], log.totals, log.seen_s, log.marks, log.seen, log.places)


@pytest.mark.parametrize("late_s", [1.7e9, 4000.0])
def test_a_log_whose_clock_was_set_is_refused(late_s):
    log, _ = drive(lambda t: 0.15, SQUARE)
    stamps = log.stamps_s + late_s * (np.arange(len(log.stamps_s)) > 50)
    with pytest.raises(InputError, match="the clock was set"):
        PlanarLog(stamps, log.totals, log.seen_s, log.marks, log.seen, log.places)


def test_a_log_in_milliseconds_is_refused():
    log, _ = drive(lambda t: 0.15, SQUARE)
    ms, seen_ms = (1e3 * (1.2e9 + stamps) for stamps in (log.stamps_s, log.seen_s))
    with pytest.raises(InputError, match="another unit than s"):
        PlanarLog(ms, log.totals, seen_ms, log.marks, log.seen, log.places)
