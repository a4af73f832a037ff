"""A reader of the user's own: its frames are checked at the door, and those that cannot be used are counted."""

from __future__ import annotations

import numpy as np
import pytest

from perception.primitives.camera import Camera
from perception.primitives.errors import RecordingError
from perception.primitives.frame import DepthView, Frame, RangeView
from perception.primitives.pose import Pose3
from surefoot.recordings.checked import CheckedRecording
from surefoot.recordings.open import open_recording
from surefoot.recordings.recording import RecordingInfo, SkippedFrame

CAMERA = Camera(8, 6, 10.0, 10.0, 3.5, 2.5)
DEPTH = np.ones((6, 8), np.float32)

READER = """
class Reader:
    def __init__(self, path):
        pass

    def frames(self):
        return iter(FRAMES)
"""


def frame(stamp_s, depth=DEPTH, x=0.0, quaternion=(0.0, 0.0, 0.0, 1.0)):
    return Frame(
        stamp_s, depth=DepthView(depth, CAMERA), T_world_camera=Pose3((x, 0.0, 0.0), quaternion)
    )


def test_frames_that_cannot_be_used_are_skipped_and_counted(tmp_path, monkeypatch):
    (tmp_path / "own_reader.py").write_text(READER)
    monkeypatch.syspath_prepend(tmp_path)
    import own_reader

    own_reader.FRAMES = [
        frame(0.0),
        frame(0.1, x=np.nan),
        frame(0.0),
        frame(0.2, depth=DEPTH[:3]),
        frame(np.inf),
        frame(0.3, quaternion=(0.0, 0.0, 0.0, 2.0)),
        frame(0.4),
    ]
    own_reader.Reader.info = RecordingInfo("own", kind="own")
    recording = open_recording(tmp_path, reader="own_reader:Reader")
    for _ in range(2):  # played back twice, counted once
        assert [one.stamp_s for one in recording.frames()] == [0.0, 0.4]
        reasons = {one.name: one.reason for one in recording.skipped}
        assert list(reasons) == [f"frame {k}" for k in (1, 2, 3, 4, 5)]
        assert "T_world_camera" in reasons["frame 1"]
        assert "equals" in reasons["frame 2"]
        assert "8x3 px" in reasons["frame 3"]
        assert "not a number" in reasons["frame 4"]
        assert "length 1" in reasons["frame 5"]
    assert all(isinstance(one, SkippedFrame) for one in recording.skipped)
    assert recording.info.name == "own"
    assert recording.remarks == []
    own_reader.Reader.remarks, own_reader.Reader.skipped = ["dim"], [SkippedFrame("a", "damaged")]
    again = open_recording(tmp_path, reader="own_reader:Reader")
    assert len(list(again.frames())) == 2
    assert again.remarks == ["dim"]
    assert [one.name for one in again.skipped][:2] == ["a", "frame 1"]


def test_a_reader_whose_amplitudes_are_in_other_units_is_told_how_to_scale_them():
    class Raw(Stamped):
        def frames(self):
            view = RangeView(2.0 * DEPTH, 3000.0 * DEPTH, CAMERA, Pose3())
            return (Frame(stamp_s, view) for stamp_s in self.stamps)

    with pytest.raises(RecordingError, match=r"no frame can be used .* divide them"):
        list(CheckedRecording(Raw(COURSE)).frames())


class Stamped:
    """Frames with these stamps."""

    info = RecordingInfo("own", kind="own")

    def __init__(self, stamps):
        self.stamps = stamps

    def frames(self):
        return map(frame, self.stamps)


COURSE = [0.1 * k for k in range(20)]


@pytest.mark.parametrize(
    "wrong",
    [
        {7: 900.0},
        {7: 900.0, 8: 900.1},
        {7: 900.1, 8: 900.0},
        {7: 900.0, 8: 900.0},
        {7: 900.0, 8: 7000.0, 9: 900.2, 10: 900.3},
        {0: 900.0, 1: 900.1, 2: 900.2},
        {5: 900.0, 7: 900.0, 9: 900.0},
        {7: 900.0, 8: 900.1, 10: 0.01},
        {16: 900.0, 17: 900.1},
        {7: 0.01, 8: 0.02, 9: 0.03},
    ],
)
def test_a_few_wrong_stamps_in_a_row_cost_their_frames_alone(wrong):
    recording = CheckedRecording(Stamped([wrong.get(k, one) for k, one in enumerate(COURSE)]))
    kept = [one for k, one in enumerate(COURSE) if k not in wrong]
    assert [one.stamp_s for one in recording.frames()] == kept
    assert [one.name for one in recording.skipped] == [f"frame {k}" for k in wrong]


@pytest.mark.parametrize("at", [1, 7, 18])
def test_a_clock_that_was_set_ahead_costs_nothing(at):
    stamps = [one + 900.0 * (k >= at) for k, one in enumerate(COURSE)]
    recording = CheckedRecording(Stamped(stamps))
    assert [one.stamp_s for one in recording.frames()] == stamps
    assert recording.skipped == []


def test_a_clock_that_was_set_back_costs_what_follows():
    stamps = [one + 900.0 * (k < 15) for k, one in enumerate(COURSE)]
    recording = CheckedRecording(Stamped(stamps))
    assert [one.stamp_s for one in recording.frames()] == stamps[:15]
    assert len(recording.skipped) == 5
