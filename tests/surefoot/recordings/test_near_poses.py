"""Poses in map coordinates of a country: refused, since maps so far from the origin would be empty or torn."""

from __future__ import annotations

from pathlib import Path

import pytest

from perception.primitives.errors import RecordingError
from surefoot.config.schema import Config
from surefoot.offline.job import Job
from surefoot.offline.map import map_recording
from surefoot.recordings.without_poses import open_input
from surefoot.run.process import process


def place(tum: Path, x: float, y: float, z: float) -> None:
    """Put the third of the four poses there."""
    file = tum / "groundtruth.txt"
    text = file.read_text()
    assert "11.0000 11.0000 2.0 3.0" in text
    file.write_text(text.replace("11.0000 11.0000 2.0 3.0", f"11.0000 {x} {y} {z}"))


@pytest.mark.parametrize("where", [(500000.0, 5.2e6, 120.7), (2.0, -10001.0, 0.0), (0.0, 0.0, 2e4)])
def test_a_pose_too_far_from_the_origin_is_named_with_its_place_and_what_to_do(tum, where):
    place(tum, *where)
    with pytest.raises(RecordingError) as found:
        list(open_input(tum).frames())
    told = f"frame at 11.0 s: its pose is at ({where[0]:.1f}, {where[1]:.1f}, {where[2]:.1f}) m"
    for words in (told, "within 10000 m", "Subtract the same offset", "--ignore-poses"):
        assert words in str(found.value)


def test_process_and_map_refuse_it(tum, tmp_path):
    place(tum, 500000.0, 5.2e6, 120.7)
    with pytest.raises(RecordingError, match="Subtract the same offset"):
        process(tum, None, Config(), tmp_path / "run", lambda text: None)
    job = Job.open("map", tum, None, Config(), tmp_path / "map")
    with pytest.raises(RecordingError, match="Subtract the same offset"):
        map_recording(job, lambda text: None)


def test_poses_within_the_bound_and_those_ignored_are_taken_as_they_are(tum):
    place(tum, -9999.0, 9999.0, 0.0)
    given = [frame.T_world_camera for frame in open_input(tum).frames()]
    assert len(given) == 4
    assert given[2].translation == (-9999.0, 9999.0, 0.0)
    place_again = (tum / "groundtruth.txt").read_text().replace("-9999.0", "-999900.0")
    (tum / "groundtruth.txt").write_text(place_again)
    ignored = open_input(tum, ignore_poses=True)
    assert [frame.T_world_camera for frame in ignored.frames()] == [None] * 4
    assert ignored.poses[11.0].translation[0] == -999900.0
