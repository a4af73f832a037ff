"""`surefoot process` on the log of a wheeled robot: what the run folder says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.io import savemat

from perception.planar.log_localiser import LocalisedLog
from perception.primitives.errors import RecordingError
from surefoot.config.schema import Config
from surefoot.experiments.real.simulated_logs import simulated_log
from surefoot.recordings.open import open_recording
from surefoot.recordings.robot_log import open_robot_log, robot_files
from surefoot.results.moments import read_moments
from surefoot.results.run_folder import RunFolder
from surefoot.run.process import process
from surefoot.run.process_log import _notes
from surefoot.store.query import asker


@pytest.fixture(scope="module")
def beacons(tmp_path_factory):
    """A Plaza file of a simulated drive."""
    drawn = simulated_log(20, ranges=True, seconds=60.0)
    log, places = drawn.log, drawn.log.places
    path = tmp_path_factory.mktemp("log") / "Drive.mat"
    moved = np.diff(np.vstack([np.zeros(2), log.totals]), axis=0)
    numbers = np.arange(len(places)) + 1.0
    zero = np.zeros(len(log.seen_s))
    savemat(
        path,
        {
            "DR": np.column_stack([log.stamps_s, moved]),
            "GT": drawn.truth,
            "TD": np.column_stack([log.seen_s, zero, numbers[log.marks], log.seen[:, 0]]),
            "TL": np.column_stack([numbers, places]),
        },
    )
    return path


def test_a_range_log_becomes_a_trajectory_with_states_and_truth(beacons, tmp_path, pages):
    with pages():
        summary = process(beacons, None, Config(), tmp_path / "run", lambda _: None)
    run = RunFolder(summary.folder)
    states, poses = run.read_csv("states.csv"), run.read_csv("trajectory_covariance.csv")
    words = states.words("state")
    assert summary.succeeded
    assert words.count("tracked") == len(poses) == summary.frames
    assert words.count("lost") == summary.skipped["the robot was lost"]
    assert any(note.startswith("lost for") for note in summary.notes)
    assert run.read_json("metrics.json")["pose_anees"] < 9.0
    assert run.has("report.html")
    with asker([run.root], print) as tables:
        counted = tables.ask("SELECT state, count(*), count(x_m) FROM frames GROUP BY state").rows
    lost, tracked = words.count("lost"), words.count("tracked")
    assert sorted(counted) == [("lost", lost, 0), ("tracked", tracked, tracked)]
    assert run.has("replay.html")
    by_stamp = dict(zip(states.numbers("stamp_s").tolist(), words, strict=True))
    moments = list(read_moments(run))
    assert len(moments) > 20
    assert all((by_stamp[one.stamp_s] == "lost") == (one.pose is None) for one in moments)


def test_a_log_without_a_fix_is_lost_throughout_and_fails(beacons, tmp_path):
    from scipy.io import loadmat

    tables = {name: value for name, value in loadmat(beacons).items() if not name.startswith("_")}
    rng = np.random.default_rng(0)
    tables["TD"][:, 3] = rng.permutation(tables["TD"][:, 3])
    tables["TD"] = tables["TD"][tables["TD"][:, 0] < 20.0]
    del tables["GT"]
    savemat(tmp_path / "Nonsense.mat", tables)
    summary = process(tmp_path / "Nonsense.mat", None, Config(), tmp_path / "run", lambda _: None)
    assert not summary.succeeded
    assert summary.notes == ("LOST throughout: more than one pose stayed possible",)
    assert set(RunFolder(summary.folder).read_csv("states.csv").words("state")) == {"lost"}


def test_landmarks_that_were_mostly_ignored_are_named(beacons):
    read = open_robot_log(beacons)
    seen = np.bincount(read.log.marks)
    found = LocalisedLog(
        read.log.stamps_s, np.zeros((len(read.log.stamps_s), 3)), np.zeros((len(read.log.stamps_s), 3, 3)),
        np.zeros(len(read.log.stamps_s), bool), np.zeros(len(read.log.stamps_s)), 1, None, seen * 0, 0.0, None,
    )  # fmt: skip
    assert not any("landmarks" in note for note in _notes(found, read))
    ignored = seen * np.array([k == 1 for k in range(len(seen))])
    (note,) = (n for n in _notes(replace(found, ignored=ignored), read) if "landmarks" in n)
    assert f"landmarks {read.identities[1]};" in note


def test_the_robots_of_a_folder_are_logs_of_their_own(tmp_path):
    for name in ("Robot1_Odometry.dat", "Robot3_Odometry.dat.gz", "Robot2_Groundtruth.dat"):
        (tmp_path / name).write_text("")
    names = [path.name for path in robot_files(tmp_path)]
    assert names == ["Robot1_Odometry.dat", "Robot3_Odometry.dat.gz"]
    with pytest.raises(RecordingError, match="give one of these"):
        open_robot_log(tmp_path)


def test_a_log_is_no_recording_with_pictures(beacons):
    with pytest.raises(RecordingError, match="only `surefoot process` reads it"):
        open_recording(beacons)


def test_real_logs_keep_their_sightings(recordings):
    robot = open_robot_log(recordings / "mrclam6" / "Robot3_Odometry.dat.gz")
    assert len(robot.log.seen) == 4348  # counted by the set's own description
    mower = open_robot_log(recordings / "plaza1_range")
    assert len(mower.log.seen) == 3529
    assert np.isnan(mower.log.seen[:, 1]).all()
