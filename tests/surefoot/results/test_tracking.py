"""What is said of the alarms of odometry."""

import numpy as np
import pytest

from perception.depth.distortion import Bend
from perception.odometry.depth_bend import MotionBend
from perception.odometry.vergence import Vergence
from surefoot.results.run_folder import RunFolder
from surefoot.results.tracking import write_tracking

STRAIGHT = MotionBend(Bend(), 1e-6 * np.eye(5), np.ones(5, bool), 9)


@pytest.mark.parametrize(
    ("failures", "words"),
    [
        ([0.1], "odometry doubtful in none of 1 frame"),
        ([0.1, 0.2], "odometry doubtful in none of 2 frames"),
        ([0.9], "odometry doubtful in 1 of 1 frame, from 0.0 s on"),
        ([], ""),
    ],
)
def test_the_number_of_frames_is_counted_in_words(tmp_path, failures, words):
    stamps, states = [0.1 * k for k in range(len(failures))], ["tracked"] * len(failures)
    folder = RunFolder.create(tmp_path / "run")
    assert write_tracking(folder, stamps, states, failures, 0.5, STRAIGHT, Vergence()) == words


@pytest.mark.parametrize(("lost", "advised"), [(2, False), (3, True)])
def test_a_recording_that_is_lost_in_most_frames_gets_advice(tmp_path, lost, advised):
    states = ["first", *["tracked"] * (4 - lost), *["lost"] * lost]
    failures = [float(state == "lost") for state in states]
    said = write_tracking(
        RunFolder.create(tmp_path / "run"),
        [0.0, 0.1, 0.2, 0.3, 0.4],
        states,
        failures,
        0.5,
        STRAIGHT,
        Vergence(),
    )
    assert ("calibrate-noise" in said) == advised


@pytest.mark.parametrize(
    ("bend", "sigma", "said"),
    [(0.012, 0.001, True), (-0.012, 0.001, True), (0.012, 0.004, False), (0.004, 0.0001, False)],
)
def test_depth_that_surely_bends_is_said(tmp_path, bend, sigma, said):
    told = MotionBend(Bend(right_down=bend), sigma**2 * np.eye(5), np.ones(5, bool), 9)
    folder = RunFolder.create(tmp_path / "run")
    words = write_tracking(
        folder, [0.0, 0.1], ["first", "tracked"], [0.0, 0.1], 0.5, told, Vergence()
    )
    assert ("bends by at least 1.2 %" in words) == said


@pytest.mark.parametrize(
    ("angle", "sigma", "said"),
    [(0.002, 0.0002, "30 m is 10 % too small"), (-0.002, 0.0002, "30 m is 10 % too large"),
     (0.002, 0.0008, ""), (0.0002, 0.00001, "")],
)  # fmt: skip
def test_a_pair_that_is_surely_turned_is_said(tmp_path, angle, sigma, said):
    """1/z errs by angle / baseline: at 30 m, with .6 m, by 3.3 % per metre and rad times .002, thus by 10 %."""
    told = Vergence(angle, sigma, usual=0.0003, baseline_m=0.6, pairs=9)
    folder = RunFolder.create(tmp_path / "run")
    words = write_tracking(
        folder, [0.0, 0.1], ["first", "tracked"], [0.0, 0.1], 0.5, STRAIGHT, told
    )
    assert said in words
    assert ("calibrate-noise" in words) == bool(said)
