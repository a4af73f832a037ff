"""The study of batches: damaged recordings hold no frame, the others do; and what it counts."""

from __future__ import annotations

import json

import pytest

from perception.primitives.errors import RecordingError
from surefoot.experiments.joint.batch import WAYS, differing, ends, write_recordings
from surefoot.recordings.open import open_recording


def frames_in(place):
    """How many frames a recording has; 0 if it is refused."""
    try:
        return len(list(open_recording(place).frames()))
    except RecordingError:
        return 0


def test_damaged_recordings_hold_no_frame_and_the_others_hold_all(tmp_path):
    damaged = write_recordings(tmp_path, 10, lambda text: None)
    assert len(damaged) == len(WAYS)
    counts = {place.name: frames_in(place) for place in sorted((tmp_path / "in").iterdir())}
    assert counts == {name: 0 if name in damaged else 4 for name in counts}
    contents = {place.read_bytes() for place in (tmp_path / "in").rglob("recording.mcap")}
    assert len(contents) == 10


def test_a_run_done_twice_and_a_failure_without_a_reason_are_seen(tmp_path):
    lines = [
        {"surefoot": "batch"},
        *({"job": "a", "event": "done"},) * 2,
        {"job": "b", "event": "failed", "reason": "dark"},
        {"job": "c", "event": "failed", "reason": ""},
    ]
    text = "".join(json.dumps(line) + "\n" for line in lines)
    (tmp_path / "ledger").write_text(text + '{"job": "d", "event": "do')
    found = ends(tmp_path / "ledger")
    assert found["done"] == {"a": 2}
    assert found["failed"] == {"b": 1}


@pytest.mark.parametrize(
    ("name", "other", "seen"),
    [
        ("map.pgm", "2", ["map.pgm"]),
        ("map.pgm", None, ["map.pgm"]),
        ("timing.csv", "2", []),
        ("summary.json", "/{run}/config", []),
    ],
)
def test_files_that_differ_are_seen_but_for_times_and_the_name_of_the_folder(
    tmp_path, name, other, seen
):
    for run, text in (("one", "/{run}/config" if "{" in (other or "") else "1"), ("two", other)):
        (tmp_path / run).mkdir()
        if text is not None:
            (tmp_path / run / name).write_text(text.replace("/{run}", str(tmp_path / run)))
    assert differing(tmp_path / "one", tmp_path / "two") == seen
