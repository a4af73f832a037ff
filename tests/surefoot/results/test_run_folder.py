"""The run folder: whole files or none, nothing of others touched, one clear line when it cannot write."""

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
from surefoot.results.run_folder import MARK, RunFolder
from surefoot.results.tables import read_table, read_tum


def names(folder: Path) -> list[str]:
    return sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file())


def test_runs_without_a_path_are_numbered(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    made = [RunFolder.create(name="home 0/x").root for _ in range(3)]
    assert made == [Path("runs/home-0-x-1"), Path("runs/home-0-x-2"), Path("runs/home-0-x-3")]


def test_an_empty_or_new_folder_is_taken(tmp_path):
    (tmp_path / "empty").mkdir()
    for name in ("empty", "new/below"):
        RunFolder.create(tmp_path / name).write_text("a.txt", "a")
        assert (tmp_path / name / "a.txt").read_text() == "a"


def test_a_folder_of_others_is_refused_and_untouched(tmp_path):
    (tmp_path / "thesis.tex").write_text("years of work")
    (tmp_path / "config.toml").write_text("theirs")
    with pytest.raises(OutputError, match="not empty and not a run of surefoot"):
        RunFolder.create(tmp_path)
    assert names(tmp_path) == ["config.toml", "thesis.tex"]


def test_a_file_in_place_of_the_folder_is_refused(tmp_path):
    (tmp_path / "out").write_text("")
    with pytest.raises(OutputError, match="is a file"):
        RunFolder.create(tmp_path / "out")
    with pytest.raises(OutputError, match="a part of its path is a file"):
        RunFolder.create(tmp_path / "out" / "below")


def test_a_repeated_run_clears_the_earlier_one_but_not_what_the_user_added(tmp_path):
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


@pytest.mark.parametrize("inside", ["recording.mcap", ""])
def test_a_run_never_overwrites_the_recording_it_reads(tmp_path, inside):
    run = RunFolder.create(tmp_path / "run")
    (run.root / "recording.mcap").write_text("precious")
    with pytest.raises(OutputError, match="holds the recording that is read"):
        RunFolder.create(run.root, reads=run.root / inside)
    assert (run.root / "recording.mcap").read_text() == "precious"


@pytest.mark.parametrize("name", ["../out.txt", "/etc/out.txt", "a/../../out.txt"])
def test_no_name_leads_out_of_the_folder(tmp_path, name):
    with pytest.raises(OutputError, match="leads out"):
        RunFolder.create(tmp_path / "run").write_text(name, "")


@pytest.mark.parametrize("there_before", [False, True])
def test_a_write_that_fails_halfway_leaves_the_complete_file_or_none(tmp_path, there_before):
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


def test_who_reads_while_it_is_written_again_reads_the_old_file_to_its_end(tmp_path):
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
def test_what_the_system_refuses_is_said_in_one_line(tmp_path, monkeypatch, number, words):
    run = RunFolder.create(tmp_path)

    def refuse(*_: object, **__: object) -> None:
        raise OSError(number, os.strerror(number), str(tmp_path / "metrics.json"))

    monkeypatch.setattr(Path, "write_bytes", refuse)
    with pytest.raises(OutputError, match=words) as caught:
        run.write_json("metrics.json", {})
    assert "metrics.json" in str(caught.value)
    assert "\n" not in str(caught.value)
    assert names(tmp_path) == [MARK]


def test_a_disk_that_is_really_full_is_named(tmp_path):
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
def test_only_a_run_that_ended_is_opened(tmp_path, prepare: Callable[[Path], object], words):
    prepare(tmp_path / "run")
    with pytest.raises(InputError, match=words):
        RunFolder.open(tmp_path / "run")


def test_a_run_that_ended_is_opened(tmp_path):
    RunFolder.create(tmp_path).write_json("summary.json", {"frames": 1})
    assert RunFolder.open(tmp_path).read_json("summary.json") == {"frames": 1}


@given(
    st.lists(
        st.tuples(*[st.floats(allow_infinity=False)] * 2, st.text("ab ,\"'é", max_size=5)),
        min_size=1,
    )
)
def test_a_table_keeps_every_bit(tmp_path_factory, rows):
    run = RunFolder(tmp_path_factory.mktemp("table"))
    run.write_csv("t.csv", ("a", "b", "word"), rows)
    table = run.read_csv("t.csv")
    assert table is not None
    np.testing.assert_array_equal(table.matrix("a", "b"), np.array([row[:2] for row in rows]))
    assert table.words("word") == [row[2] for row in rows]


def test_what_is_not_a_finite_number_is_null_in_json_and_empty_in_tables(tmp_path):
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


def test_estimates_are_read_back_as_they_were(tmp_path):
    rng = np.random.default_rng(1)
    run = RunFolder(tmp_path)
    poses = []
    for i in range(20):
        root = rng.normal(size=(3, 3))
        poses.append((0.325 * i, Gaussian(rng.uniform(-3, 3, size=3), root @ root.T)))
    run.write_estimates(poses)
    way = run.read_trajectory("trajectory.txt")
    assert way is not None
    np.testing.assert_array_equal(way.positions[:, :2], [p.mean[:2] for _, p in poses])
    np.testing.assert_allclose(way.yaws, [p.mean[2] for _, p in poses], atol=1e-12)
    table = run.read_csv("trajectory_covariance.csv")
    assert table is not None
    np.testing.assert_array_equal(table.numbers("yaw_rad"), [p.mean[2] for _, p in poses])
    np.testing.assert_array_equal(table.numbers("P_xyaw"), [p.covariance[0, 2] for _, p in poses])


def test_truth_beside_a_recording_comes_along(tmp_path):
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
        ("# nothing\n", "holds no poses"),
    ],
)
def test_a_trajectory_that_cannot_be_says_where(tmp_path, text, words):
    (tmp_path / "t.txt").write_text(text)
    with pytest.raises(RecordingError, match=words):
        read_tum(tmp_path / "t.txt")


def test_a_trajectory_comes_in_order_of_time_and_once_per_stamp(tmp_path):
    (tmp_path / "t.txt").write_text("2 2 0 0 0 0 0 2\n1 1 0 0 0 0 0 1 # why\n2 9 0 0 0 0 0 1\n")
    way = read_tum(tmp_path / "t.txt")
    np.testing.assert_array_equal(way.stamps, [1.0, 2.0])
    np.testing.assert_array_equal(way.positions[:, 0], [1.0, 2.0])
    np.testing.assert_array_equal(way.quats_xyzw, [[0, 0, 0, 1]] * 2)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is empty"),
        ("a,b\n1\n", "line 2: 1 cells, expected 2"),
        ("a\nx\n", "row 2, column a: 'x'"),
    ],
)
def test_a_table_that_cannot_be_says_where(tmp_path, text, words):
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
    with pytest.raises(RecordingError, match="is not JSON"):
        run.read_json("bad.json")
    (tmp_path / "t.csv").write_text("a\n1\n")
    with pytest.raises(RecordingError, match="no column 'b'"):
        read_table(tmp_path / "t.csv").numbers("b")
    (tmp_path / "t.txt.gz").write_bytes(b"not gzip")
    with pytest.raises(InputError, match="cannot be read as text"):
        read_tum(tmp_path / "t.txt.gz")
