"""Smoothing of a run from its files."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from perception.primitives.errors import InputError
from perception.primitives.frame import Frame, Imu, StepOdometry
from perception.primitives.landmark import Sighting
from perception.primitives.pose import Pose2
from surefoot.config.schema import Config
from surefoot.offline.smooth import SMOOTHED, SMOOTHED_COVARIANCE, read_walk, smooth_run
from surefoot.results.measurement_log import (
    ODOMETRY,
    ODOMETRY_HEADER,
    SIGHTINGS,
    SIGHTINGS_HEADER,
    odometry_row,
    sighting_rows,
)
from surefoot.results.run_folder import COVARIANCE_HEADER, RunFolder

MARKS = {3: (1.5, 0.8), 8: (2.0, -0.9)}
START_P = np.diag([0.01, 0.01, 0.02]) ** 2


def frames(rng: np.random.Generator) -> tuple[list[tuple[Frame, list[Sighting]]], list[Pose2]]:
    """A short walk with its sensor data, and the true poses."""
    true = Pose2()
    told, truth = [(Frame(10.0), [])], [true]
    for k in range(1, 30):
        motion = Pose2(0.02, 0.0, 0.03 * math.sin(k / 4))
        true = true @ Pose2(
            *(motion.vector + np.array([0.001, 0.0005, 0.007]) * rng.normal(size=3))
        )
        imu = Imu(np.array([0.0, 0.0, 0.0]), np.zeros(3)) if k == 5 else None
        sightings = []
        for identity, place in MARKS.items():
            x, y = true.inverse().apply(np.array(place))
            noise = np.array([0.01, 0.008]) * rng.normal(size=2)
            measured = np.array([math.hypot(x, y), math.atan2(y, x)]) + noise
            if k % 4 == 0:
                sightings.append(Sighting(identity, measured, np.diag([0.01, 0.011]) ** 2))
        if k == 8:
            sightings.append(Sighting(None, np.array([1.0, 0.0]), np.eye(2) * 1e-4))
        told.append(
            (Frame(10.0 + 0.325 * k, odometry=StepOdometry(motion, 0.5), imu=imu), sightings)
        )
        truth.append(true)
    return told, truth


def written(path: Path, told: list[tuple[Frame, list[Sighting]]]) -> RunFolder:
    folder = RunFolder.create(path)
    folder.write_csv(
        ODOMETRY, ODOMETRY_HEADER, [odometry_row(frame.stamp_s, frame) for frame, _ in told]
    )
    rows = [row for frame, seen in told for row in sighting_rows(frame.stamp_s, seen)]
    folder.write_csv(SIGHTINGS, SIGHTINGS_HEADER, rows)
    folder.write_json(
        "summary.json",
        {
            "start": [0.0, 0.0, 0.0],
            "start_covariance": START_P,
            "landmarks": [[identity, *place, 0.4, 0.16] for identity, place in MARKS.items()],
        },
    )
    return folder


def test_the_tables_keep_every_measurement(tmp_path):
    told, _ = frames(np.random.default_rng(0))
    walked = read_walk(written(tmp_path / "run", told), Config())
    assert walked.landmarks == MARKS
    np.testing.assert_array_equal(walked.start.covariance, START_P)
    assert len(walked.instants) == len(told)
    for one, (frame, sightings) in zip(walked.instants, told, strict=True):
        assert (one.stamp_s, one.odometry) == (frame.stamp_s, frame.odometry)
        assert (one.imu is None) == (frame.imu is None)
        for read, meant in zip(one.sightings, sightings, strict=True):
            assert read.identity == meant.identity
            np.testing.assert_array_equal(read.measured, meant.measured)
            np.testing.assert_array_equal(read.covariance, meant.covariance)


@pytest.mark.parametrize("lag_s", [None, 3.0])
def test_smoothed_poses_lie_within_their_covariance_of_the_truth(tmp_path, lag_s):
    told, truth = frames(np.random.default_rng(2))
    folder = written(tmp_path / "run", told)
    stamped = smooth_run(folder, lag_s)
    table = folder.read_csv(SMOOTHED_COVARIANCE)
    assert table is not None
    assert tuple(table.columns) == COVARIANCE_HEADER
    trajectory = folder.read_trajectory(SMOOTHED)
    assert trajectory is not None
    np.testing.assert_array_equal(trajectory.stamps, [frame.stamp_s for frame, _ in told])
    places = np.array([pose.vector[:2] for pose in truth])
    errors = trajectory.positions[:, :2] - places
    deviations = np.sqrt([np.trace(pose.covariance[:2, :2]) for _, pose in stamped])
    assert np.all(np.linalg.norm(errors, axis=1) < 4.0 * deviations)
    assert np.all(deviations < 0.02)  # two landmarks at 2 m, each to 1 cm and more than once


def test_implausible_odometry_is_ignored(tmp_path):
    told, truth = frames(np.random.default_rng(1))
    frame, seen = told[15]
    leap = Frame(frame.stamp_s, odometry=StepOdometry(Pose2(3.0, 0.0, 0.0), 0.5))
    folder = written(tmp_path / "run", [*told[:15], (leap, seen), *told[16:]])
    _, pose = smooth_run(folder)[-1]
    assert np.linalg.norm(pose.mean[:2] - truth[-1].vector[:2]) < 0.05


def test_a_run_without_sensors_says_how_to_get_them(tmp_path):
    folder = RunFolder.create(tmp_path / "run")
    folder.write_json("summary.json", {"start": None})
    with pytest.raises(InputError, match="--record"):
        smooth_run(folder)
    folder.write_csv(ODOMETRY, ODOMETRY_HEADER, [(0.0, None, None, None, None, None, None, None)])
    folder.write_csv(SIGHTINGS, SIGHTINGS_HEADER, [])
    with pytest.raises(InputError, match="start pose of the walk is unknown"):
        smooth_run(folder)
