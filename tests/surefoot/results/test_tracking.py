"""What is said of the alarms of odometry."""

import pytest

from surefoot.results.run_folder import RunFolder
from surefoot.results.tracking import write_tracking


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
    assert write_tracking(folder, stamps, states, failures, 0.5) == words


@pytest.mark.parametrize(("lost", "advised"), [(2, False), (3, True)])
def test_a_recording_that_is_lost_in_most_frames_gets_advice(tmp_path, lost, advised):
    states = ["first", *["tracked"] * (4 - lost), *["lost"] * lost]
    failures = [float(state == "lost") for state in states]
    said = write_tracking(
        RunFolder.create(tmp_path / "run"), [0.0, 0.1, 0.2, 0.3, 0.4], states, failures, 0.5
    )
    assert ("calibrate-noise" in said) == advised
