"""Faults put into the shipped recording: named in the status within two seconds, and the claimed pose stays honest.

The recording is of another body than the one that limits and noise of the doubts were chosen on.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from perception.filtering.consistency import band, nees
from perception.monitoring.status import STAND, Doubt
from sim.faults.injection import FaultConfig, FaultInjector
from surefoot.config.schema import Config
from surefoot.experiments.joint.faults import NAMED, NOTICED_S
from surefoot.recordings.codec import decode, encode
from surefoot.recordings.mcap_format import McapRecording
from surefoot.results.run_folder import RunFolder
from surefoot.run.pipeline import Pipeline

WALK = Path(__file__).parents[3] / "data" / "walk"
BEGIN_S, LAST_S = 3.5, 5.0
FAULTS = {name: name for name in NAMED} | {"dropped": "dropped:0.5", "clock-jump": "clock-jump:-2"}

Told = list[tuple[float, float, bool, tuple[Doubt, ...]]]


def told(*faults: str) -> Told:
    """True stamp, NEES of the pose, whether a fault has begun, and status, of every frame that arrives."""
    recording = McapRecording(WALK / "recording.mcap")
    poses = RunFolder(WALK).read_trajectory("truth/trajectory.txt")
    assert poses is not None
    true = np.column_stack([poses.positions[:, :2], poses.yaws])
    injector = FaultInjector(FaultConfig(faults, BEGIN_S, LAST_S), seed=1)
    pipeline = Pipeline(Config(), recording.info)
    found: Told = []
    begun = False
    for frame in recording.frames():
        arrived = injector.apply(frame)
        begun |= bool(injector.touched())
        if arrived is None:
            continue
        pose = pipeline.cycle(decode(encode(arrived))).estimate
        assert pose.pose is not None
        at = int(np.argmin(np.abs(poses.stamps - frame.stamp_s)))
        error = float(nees(pose.pose.mean - true[at], pose.pose.covariance, angles=(2,)))
        found.append((frame.stamp_s, error, begun, pose.status))
    return found


def test_a_walk_without_faults_has_nothing_to_doubt():
    assert {one for _, _, _, status in told() for one in status} == set()


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_named_in_time_and_the_pose_stays_honest(fault):
    later = [one for one in told(FAULTS[fault]) if one[2]]
    begin_s = later[0][0]
    named = [
        stamp_s - begin_s
        for stamp_s, _, _, status in later
        if any(name in doubt.words for doubt in status for name in NAMED[fault])
    ]
    assert min(named) <= NOTICED_S
    assert np.mean([error for _, error, _, _ in later]) < band(3)[1]
    assert not [one for one in later[-1][3] if one.asks == STAND]


def test_a_clock_that_drifts_changes_the_pose_by_nothing_that_matters():
    later = [one for one in told("clock-drift") if one[2]]
    assert np.mean([error for _, error, _, _ in later]) < band(3)[1]
