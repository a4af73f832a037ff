"""Folders are decoded ahead by a second thread; what is counted and remarked is what was given out."""

import cv2
import numpy as np
import pytest

from surefoot.recordings.open import open_recording

DESCRIPTION = (
    "[camera]\nwidth = 64\nheight = 48\nfx = 60.0\nfy = 60.0\ncx = 31.5\ncy = 23.5\n"
    "[depth]\nscale_per_metre = 1000.0\nnone = [0]\n"
)


@pytest.fixture
def folder(tmp_path):
    """Eight frames, each at its own distance; the depth of the third and the colour of the fifth are damaged."""
    for part in ("depth", "colour"):
        (tmp_path / part).mkdir()
    for number in range(8):
        depth = np.full((48, 64), 1000 + number, np.uint16)
        cv2.imwrite(str(tmp_path / "depth" / f"{number:06d}.png"), depth)
        cv2.imwrite(
            str(tmp_path / "colour" / f"{number:06d}.png"), np.full((48, 64, 3), number, np.uint8)
        )
    (tmp_path / "depth" / "000002.png").write_bytes(b"")
    (tmp_path / "colour" / "000004.png").write_bytes(b"")
    (tmp_path / "recording.toml").write_text(DESCRIPTION)
    return tmp_path


def distances(frames):
    return [round(1000.0 * float(frame.depth.depth[0, 0])) - 1000 for frame in frames]


def test_all_readable_frames_come_in_order_with_their_own_colours(folder):
    recording = open_recording(folder)
    frames = list(recording.frames())
    assert distances(frames) == [0, 1, 3, 4, 5, 6, 7]
    assert [None if f.colour is None else int(f.colour.rgb[0, 0, 0]) for f in frames] == [
        0,
        1,
        3,
        None,
        5,
        6,
        7,
    ]
    assert [skipped.name for skipped in recording.skipped] == ["000002.png"]
    assert any("1 colour images cannot be used" in remark for remark in recording.remarks)


def test_a_damaged_image_that_nobody_asked_for_is_not_counted(folder):
    recording = open_recording(folder)
    frames = recording.frames()
    assert distances([next(frames), next(frames)]) == [0, 1]
    assert not recording.skipped
    assert not any("colour images" in remark for remark in recording.remarks)
    frames.close()
    assert distances(recording.frames()) == [0, 1, 3, 4, 5, 6, 7]  # and again from the start
