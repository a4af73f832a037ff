"""Tables that go to disk row by row: the same files as if written at once, also in a folder and after a checkpoint."""

from __future__ import annotations

import pytest

from perception.primitives.errors import OutputError
from surefoot.results import object_file
from surefoot.results.row_stream import JsonStream, PoseStream, RowStream
from surefoot.results.run_folder import RunFolder
from surefoot.results.timing_log import TimingLog

FRAMES = [
    (0.2, {"localise": 1.5, "map": 0.1}),
    (0.4, {"localise": 1.25, "stereo": 7.0, "map": 1 / 3}),
    (0.6, {"map": 2.0, "decide": 0.7}),
]


@pytest.fixture
def folder(tmp_path):
    return RunFolder.create(tmp_path / "run")


def test_timing_has_a_column_for_every_stage_and_0_where_one_did_not_run(folder):
    log = TimingLog(folder)
    for stamp_s, times in FRAMES:
        log.note(stamp_s, times)
    log.close()
    table = folder.read_csv("timing.csv")
    assert list(table.columns) == ["stamp_s", "decide", "localise", "map", "stereo"]
    for name in ("decide", "localise", "map", "stereo"):
        assert table.numbers(name).tolist() == [times.get(name, 0.0) for _, times in FRAMES]
    assert [one.name for one in folder.root.glob(".part-*")] == []


def test_timing_goes_on_after_a_checkpoint(folder):
    log = TimingLog(folder)
    log.note(*FRAMES[0])
    kept = object_file.dumps(log, {"folder": folder})
    log.note(9.9, {"lost": 1.0})
    log = object_file.loads(kept, {"folder": folder})
    for frame in FRAMES[1:]:
        log.note(*frame)
    log.close()
    assert folder.read_csv("timing.csv").numbers("stamp_s").tolist() == [0.2, 0.4, 0.6]


def test_tables_in_a_folder_are_those_that_are_written_at_once(folder):
    rows = [(0.1, "a", None), (0.2, "b, c", float("nan")), (0.3, 'd"e', 1e-17)]
    poses = [(0.1, 1.0, 2.0, 0.0, 0.3), (0.2, 1.1, 2.1, 0.0, -3.0)]
    folder.write_csv("plain.csv", ("stamp_s", "name", "value"), rows)
    folder.write_trajectory("plain.txt", poses)
    table = RowStream(folder, "truth/rows.csv", ("stamp_s", "name", "value"))
    trajectory = PoseStream(folder, "truth/poses.txt")
    empty = RowStream(folder, "truth/none.csv", ("stamp_s",))
    for row in rows:
        table.append(row)
    for pose in poses:
        trajectory.append(pose)
    assert not folder.has("truth/rows.csv")
    table.close()
    trajectory.close()
    empty.close(keep_empty=False)
    assert folder.path("truth/rows.csv").read_bytes() == folder.path("plain.csv").read_bytes()
    assert folder.path("truth/poses.txt").read_bytes() == folder.path("plain.txt").read_bytes()
    assert not folder.has("truth/none.csv")
    assert [one.name for one in folder.root.glob(".part-*")] == []


def test_a_file_where_the_folder_should_be_is_refused_with_advice(folder):
    folder.path(".part-truth").write_text("")
    with pytest.raises(OutputError, match="choose another --out"):
        RowStream(folder, "truth/rows.csv", ("stamp_s",))


def test_a_drained_list_gives_its_objects_once_and_leaves_no_file(folder):
    stream = JsonStream(folder, "list.jsonl")
    objects = [[0.1, 1 / 3], {"a": None}, "text"]
    for one in objects:
        stream.append(one)
    assert list(stream.drain()) == objects
    assert [one.name for one in folder.root.glob(".part-*")] == []
