"""The run folder: complete files or none, files of the user untouched, one clear line when it cannot write."""

from __future__ import annotations

import errno
import json
import math
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.primitives.errors import InputError, OutputError, RecordingError
from perception.primitives.gaussian import Gaussian
from surefoot.results.row_stream import JsonStream, RowStream
from surefoot.results.run_folder import COVARIANCE_HEADER, MARK, RunFolder, estimate_row
from surefoot.results.tables import read_table, read_tum


def names(folder: Path) -> list[str]:
    return sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file())


def test_runs_without_a_path_are_numbered(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    made = [RunFolder.create(name="home 0/x").root for _ in range(3)]
    assert made == [Path("runs/home-0-x-1"), Path("runs/home-0-x-2"), Path("runs/home-0-x-3")]


def test_an_empty_or_new_folder_is_accepted(tmp_path):
    (tmp_path / "empty").mkdir()
    for name in ("empty", "new/below"):
        RunFolder.create(tmp_path / name).write_text("a.txt", "a")
        assert (tmp_path / name / "a.txt").read_text() == "a"


def test_a_folder_with_other_files_is_refused_and_untouched(tmp_path):
    (tmp_path / "thesis.tex").write_text("years of work")
    (tmp_path / "config.toml").write_text("theirs")
    with pytest.raises(OutputError, match="not empty and not a run of surefoot"):
        RunFolder.create(tmp_path)
    assert names(tmp_path) == ["config.toml", "thesis.tex"]


def test_a_file_as_output_folder_is_refused(tmp_path):
    (tmp_path / "out").write_text("")
    with pytest.raises(OutputError, match="is a file"):
        RunFolder.create(tmp_path / "out")
    with pytest.raises(OutputError, match="a part of its path is a file"):
        RunFolder.create(tmp_path / "out" / "below")


def test_a_repeated_run_deletes_the_earlier_outputs_but_no_files_of_the_user(tmp_path):
    run = RunFolder.create(tmp_path / "run")
    for name in ("metrics.json", "figures/map.svg", "truth/trajectory.txt", "views/000.jpg"):
        run.write_text(name, "old")
    (run.root / "recording.mcap").write_text("precious")
    (run.root / "notes.md").write_text("mine")
    (run.root / ".part-1-dead").mkdir()
    RunFolder.create(tmp_path / "run")
    assert names(run.root) == [MARK, "notes.md", "recording.previous.mcap"]
    assert (run.root / "recording.previous.mcap").read_text() == "precious"
    assert not (run.root / ".part-1-dead").exists()


def test_a_run_that_is_repeated_twice_keeps_both_earlier_recordings(tmp_path):
    for content in ("first", "second", ""):
        run = RunFolder.create(tmp_path / "run")
        (run.root / "recording.mcap").write_text(content)
    assert (run.root / "recording.previous.mcap").read_text() == "first"
    assert (run.root / "recording.previous-2.mcap").read_text() == "second"


@pytest.mark.parametrize("inside", ["recording.mcap", ""])
def test_a_run_never_overwrites_the_recording_it_reads(tmp_path, inside):
    run = RunFolder.create(tmp_path / "run")
    (run.root / "recording.mcap").write_text("precious")
    with pytest.raises(OutputError, match="holds the recording that is read"):
        RunFolder.create(run.root, reads=run.root / inside)
    assert (run.root / "recording.mcap").read_text() == "precious"


@pytest.mark.parametrize("name", ["../out.txt", "/etc/out.txt", "a/../../out.txt"])
def test_a_file_name_outside_the_folder_is_refused(tmp_path, name):
    with pytest.raises(OutputError, match="leads out"):
        RunFolder.create(tmp_path / "run").write_text(name, "")


@pytest.mark.parametrize("there_before", [False, True])
def test_an_interrupted_write_leaves_the_old_file_or_none(tmp_path, there_before):
    run = RunFolder.create(tmp_path)
    if there_before:
        run.write_text("cloud.ply", "complete")

    def interrupted() -> None:
        with run.staged() as stage:
            (stage / "cloud.ply").write_text("half of i")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert names(tmp_path) == [MARK, *(["cloud.ply"] if there_before else [])]
    if there_before:
        assert (tmp_path / "cloud.ply").read_text() == "complete"


def test_a_reader_of_a_file_that_is_rewritten_reads_the_old_content_to_its_end(tmp_path):
    run = RunFolder(tmp_path)
    run.write_text("map.yaml", "old " * 1000)
    with (tmp_path / "map.yaml").open() as reader:
        begin = reader.read(4)
        run.write_text("map.yaml", "new " * 1000)
        assert begin + reader.read() == "old " * 1000
    assert (tmp_path / "map.yaml").read_text() == "new " * 1000


def test_a_killed_writer_leaves_the_complete_file_or_none(tmp_path):
    script = (
        "import itertools\nfrom pathlib import Path\nfrom surefoot.results.run_folder import RunFolder\n"
        f"run = RunFolder(Path({str(tmp_path)!r}))\nprint('go', flush=True)\n"
        "for i in itertools.count():\n    run.write_bytes('data.bin', bytes([i % 251]) * 3_000_000)\n"
    )
    for delay in (0.02, 0.05, 0.11):
        with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE) as writer:
            assert writer.stdout is not None
            writer.stdout.readline()
            try:
                writer.wait(delay)
            except subprocess.TimeoutExpired:
                writer.send_signal(signal.SIGKILL)
        if (tmp_path / "data.bin").exists():
            data = (tmp_path / "data.bin").read_bytes()
            assert len(data) == 3_000_000
            assert data == data[:1] * len(data)


@pytest.mark.parametrize(
    ("number", "words"),
    [
        (errno.ENOSPC, "the disk is full; free some space"),
        (errno.EDQUOT, "the disk is full"),
        (errno.EROFS, "read-only for you"),
        (errno.EACCES, "read-only for you"),
        (errno.EIO, "choose another --out"),
    ],
)
def test_a_refused_write_is_explained_in_one_line(tmp_path, monkeypatch, number, words):
    run = RunFolder.create(tmp_path)

    def refuse(*_: object, **__: object) -> None:
        raise OSError(number, os.strerror(number), str(tmp_path / "metrics.json"))

    monkeypatch.setattr(Path, "write_bytes", refuse)
    with pytest.raises(OutputError, match=words) as caught:
        run.write_json("metrics.json", {})
    assert "metrics.json" in str(caught.value)
    assert "\n" not in str(caught.value)
    assert names(tmp_path) == [MARK]


def test_a_full_disk_is_named(tmp_path):
    full = Path("/dev/full")
    if not full.exists():
        pytest.skip("this system has no /dev/full")
    with (
        pytest.raises(OutputError, match="the disk is full"),
        RunFolder(tmp_path).staged(),
    ):
        full.write_bytes(b"no room")


def test_a_folder_without_write_permission_is_refused(tmp_path):
    if os.geteuid() == 0:
        pytest.skip("root may write everywhere")
    tmp_path.chmod(0o500)
    try:
        with pytest.raises(OutputError, match="read-only for you"):
            RunFolder.create(tmp_path / "run")
    finally:
        tmp_path.chmod(0o700)


@pytest.mark.parametrize(
    ("prepare", "words"),
    [
        (lambda p: None, "does not exist"),
        (lambda p: p.write_text(""), "is a file"),
        (lambda p: p.mkdir(), "is this the right folder"),
        (lambda p: RunFolder.create(p), "was interrupted"),
    ],
)
def test_a_folder_without_results_is_refused(tmp_path, prepare: Callable[[Path], object], words):
    prepare(tmp_path / "run")
    with pytest.raises(InputError, match=words):
        RunFolder.open(tmp_path / "run")


def test_a_complete_run_is_opened(tmp_path):
    RunFolder.create(tmp_path).write_json("summary.json", {"frames": 1})
    assert RunFolder.open(tmp_path).read_json("summary.json") == {"frames": 1}


@pytest.mark.parametrize(
    ("files", "kind"),
    [
        ({"summary.json": '{"kind": "simulation"}'}, "simulation"),
        ({"summary.json": '{"kind": "TUM RGB-D"}'}, "recording"),
        ({"summary.json": '{"kind": "panorama"}'}, "panorama"),
        ({"summary.json": '{"folder": "x"}', "layers.npz": "", "trajectory.txt": ""}, "map"),
        ({"panorama.json": "{}"}, "panorama"),
        ({"monocular.json": "{}"}, "monocular"),
        ({"summary.csv": "recording,run\n"}, "batch"),
    ],
)
def test_a_run_folder_knows_its_kind_even_of_older_versions(tmp_path, files, kind):
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    assert RunFolder.open(tmp_path).kind == kind


def test_a_killed_run_is_opened_with_the_complete_rows_of_its_tables(tmp_path):
    run = RunFolder.create(tmp_path)
    poses = RowStream(run, "trajectory_covariance.csv", COVARIANCE_HEADER)
    tracks = JsonStream(run, "obstacles.json")
    for i in range(3):
        poses.append(estimate_row(float(i), Gaussian(np.array([1.0 * i, 2.0, 0.5]), np.eye(3))))
        state = {"mean": [0.0] * 4, "covariance": np.eye(4)}
        tracks.append({"stamp": float(i), "track": 1, **state})
    del poses, tracks  # as a kill would: closed by the system, not by us
    part = tmp_path / ".part-trajectory_covariance.csv"
    part.write_bytes(part.read_bytes()[:-7])
    (tmp_path / ".part-floor.csv").write_text("")  # its first block was never written
    opened = RunFolder.open(tmp_path)
    assert opened.interrupted
    table, path = (
        opened.read_csv("trajectory_covariance.csv"),
        opened.read_trajectory("trajectory.txt"),
    )
    assert table is not None
    assert path is not None
    assert table.numbers("x_m").tolist() == path.positions[:, 0].tolist() == [0.0, 1.0]
    np.testing.assert_allclose(path.yaws, 0.5)
    assert len(opened.read_json("obstacles.json")["tracks"]) == 3
    assert opened.read_csv("floor.csv") is None


@given(
    st.lists(
        st.tuples(*[st.floats(allow_infinity=False)] * 2, st.text("ab ,\"'é", max_size=5)),
        min_size=1,
    )
)
def test_a_table_is_read_back_without_loss(tmp_path_factory, rows):
    run = RunFolder(tmp_path_factory.mktemp("table"))
    run.write_csv("t.csv", ("a", "b", "word"), rows)
    table = run.read_csv("t.csv")
    assert table is not None
    np.testing.assert_array_equal(table.matrix("a", "b"), np.array([row[:2] for row in rows]))
    assert table.words("word") == [row[2] for row in rows]


def test_nan_and_infinity_become_null_in_json_and_empty_cells_in_tables(tmp_path):
    run = RunFolder(tmp_path)
    run.write_json(
        "a.json", {"x": math.nan, "y": [np.float32(0.5), np.inf], "z": np.arange(2), "w": None}
    )
    assert json.loads((tmp_path / "a.json").read_text()) == {
        "x": None,
        "y": [0.5, None],
        "z": [0, 1],
        "w": None,
    }
    run.write_csv("a.csv", ("x", "y", "z"), [(math.nan, None, True)])
    assert (tmp_path / "a.csv").read_text() == "x,y,z\n,,1\n"


def test_a_planar_trajectory_is_read_back_without_loss(tmp_path):
    rng = np.random.default_rng(1)
    run = RunFolder(tmp_path)
    poses = []
    for i in range(20):
        root = rng.normal(size=(3, 3))
        poses.append((0.325 * i, Gaussian(rng.uniform(-3, 3, size=3), root @ root.T)))
    rows = [estimate_row(stamp, pose) for stamp, pose in poses]
    run.write_csv("trajectory_covariance.csv", COVARIANCE_HEADER, rows)
    run.write_planar_trajectory()
    path = run.read_trajectory("trajectory.txt")
    assert path is not None
    np.testing.assert_array_equal(path.positions[:, :2], [p.mean[:2] for _, p in poses])
    np.testing.assert_allclose(path.yaws, [p.mean[2] for _, p in poses], atol=1e-12)
    table = run.read_csv("trajectory_covariance.csv")
    assert table is not None
    np.testing.assert_array_equal(table.numbers("yaw_rad"), [p.mean[2] for _, p in poses])
    np.testing.assert_array_equal(table.numbers("P_xyaw"), [p.covariance[0, 2] for _, p in poses])


def test_ground_truth_beside_a_recording_is_copied(tmp_path):
    for name in ("walk/recording.mcap", "walk/truth/trajectory.txt", "walk/truth/map.yaml"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(name)
    for i, recording in enumerate(("walk", "walk/recording.mcap")):
        run = RunFolder.create(tmp_path / f"run{i}")
        assert run.adopt_truth(tmp_path / recording)
        assert (run.root / "truth/map.yaml").read_text() == "walk/truth/map.yaml"
    assert not run.adopt_truth(tmp_path)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("0 0 0 0 0 0 0\n", "line 1: .* is not a pose"),
        ("# head\n0 0 0 0 0 0 0 1\n1 nan 0 0 0 0 0 1\n", "line 3"),
        ("0 0 0 0 0 0 0 0\n", "is not a pose"),
        ("zero 0 0 0 0 0 0 1\n", "is not a pose"),
        ("0 0 -2e9 0 0 0 0 1\n", "line 1"),
        ("0 0 0 0 0 1e300 0.6 0.8\n", "with a quaternion of length 1"),
        ("# nothing\n", "holds no poses"),
    ],
)
def test_an_invalid_trajectory_line_is_named(tmp_path, text, words):
    (tmp_path / "t.txt").write_text(text)
    with pytest.raises(RecordingError, match=words):
        read_tum(tmp_path / "t.txt")


def test_a_trajectory_is_sorted_by_time_with_one_pose_per_stamp(tmp_path):
    (tmp_path / "t.txt").write_text("2 2 0 0 0 0 0 2\n1 1 0 0 0 0 0 1 # why\n2 9 0 0 0 0 0 1\n")
    path = read_tum(tmp_path / "t.txt")
    np.testing.assert_array_equal(path.stamps, [1.0, 2.0])
    np.testing.assert_array_equal(path.positions[:, 0], [1.0, 2.0])
    np.testing.assert_array_equal(path.quats_xyzw, [[0, 0, 0, 1]] * 2)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is empty"),
        ("a,b\n1\n", "line 2: 1 cells, expected 2"),
        ("a\nx\n", "row 2, column a: 'x'"),
    ],
)
def test_an_invalid_table_row_is_named(tmp_path, text, words):
    (tmp_path / "t.csv").write_text(text)
    with pytest.raises(RecordingError, match=words):
        read_table(tmp_path / "t.csv").numbers("a")


def test_missing_files_columns_and_broken_json_are_named(tmp_path):
    run = RunFolder(tmp_path)
    assert run.read_json("none.json") is None
    assert run.read_csv("none.csv") is None
    with pytest.raises(InputError, match="does not exist"):
        read_tum(tmp_path / "none.txt")
    (tmp_path / "bad.json").write_text('{"cut": ')
    with pytest.raises(RecordingError, match="is not valid JSON"):
        run.read_json("bad.json")
    (tmp_path / "t.csv").write_text("a\n1\n")
    with pytest.raises(RecordingError, match="no column 'b'"):
        read_table(tmp_path / "t.csv").numbers("b")
    (tmp_path / "t.txt.gz").write_bytes(b"not gzip")
    with pytest.raises(InputError, match="is not gzip"):
        read_tum(tmp_path / "t.txt.gz")
