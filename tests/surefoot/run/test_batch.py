"""Many recordings: each once, whatever happens to one of them or to a worker."""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace

import cv2
import numpy as np
import pytest

from perception.primitives.errors import ConfigError, InputError, OutputError, RecordingError
from surefoot.config.schema import Config
from surefoot.results.run_folder import RunFolder
from surefoot.run import batch
from surefoot.run.batch import find_all, process_all, process_one
from surefoot.run.worker_pool import run_all

DESCRIPTION = """\
rate_hz = 10.0
[camera]
width = 80
height = 60
fx = 70.0
fy = 70.0
cx = 39.5
cy = 29.5
[depth]
folder = "depth"
scale_per_metre = 1000
none = [0]
"""


def write_floor(folder, frames=6):
    """A camera 0.5 m above the floor, looking down by 30 degrees."""
    (folder / "depth").mkdir(parents=True)
    (folder / "recording.toml").write_text(DESCRIPTION)
    v = np.repeat(np.arange(60.0)[:, None], 80, axis=1)
    down = ((v - 29.5) / 70.0) * np.cos(np.radians(30)) + np.sin(np.radians(30))
    z = 0.5 / down
    rng = np.random.default_rng(len(folder.name))
    for i in range(frames):
        noisy = 1000 * (z + rng.normal(0, 0.003, z.shape))
        cv2.imwrite(str(folder / f"depth/{i}.png"), noisy.astype(np.uint16))


@pytest.fixture
def many(tmp_path):
    """Three good recordings and one whose every image is broken."""
    for name in "abc":
        write_floor(tmp_path / "in" / f"walk_{name}")
    write_floor(tmp_path / "in" / "walk_broken")
    for file in (tmp_path / "in/walk_broken/depth").iterdir():
        file.write_bytes(b"this is no picture")
    return tmp_path


def command(many, *more):
    words = [sys.executable, "-c", "from surefoot.cli.main import main; main()", "process"]
    return [*words, str(many / "in"), "--out", str(many / "out"), "--workers", "2", *more]


def table(many):
    with (many / "out/summary.csv").open(newline="") as file:
        return {os.path.basename(row["recording"]): row for row in csv.DictReader(file)}


def test_a_killed_worker_and_a_broken_recording_cost_nothing_else_and_a_restart_does_nothing_twice(
    many,
):
    running = subprocess.Popen(command(many), stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 120.0
    while not list(many.glob("out/.part-walk*")) and time.monotonic() < deadline:
        time.sleep(0.02)
    victims = workers_of(running.pid)
    assert victims
    os.kill(victims[0], signal.SIGKILL)
    _, said = running.communicate(timeout=240)
    rows = table(many)
    assert {name: row["status"] for name, row in rows.items()} == {
        **{f"walk_{name}": "done" for name in "abc"},
        "walk_broken": "failed",
    }
    assert "cannot be decoded" in rows["walk_broken"]["error"]
    assert running.returncode == 1, said
    assert not list(many.glob("out/.part-*"))
    written = {path: path.stat().st_mtime_ns for path in many.glob("out/walk_*/summary.json")}
    assert len(written) == 3

    again = subprocess.run(command(many, "--json"), capture_output=True, text=True, timeout=240)
    statuses = {os.path.basename(row["recording"]): row for row in json.loads(again.stdout)}
    assert [statuses[f"walk_{name}"]["status"] for name in "abc"] == ["done before"] * 3
    assert statuses["walk_broken"]["status"] == "failed"
    assert {path: path.stat().st_mtime_ns for path in written} == written
    assert all(float(statuses[f"walk_{name}"]["wall_s"]) > 0.0 for name in "abc")


def workers_of(pid):
    """Worker processes of a process."""
    found = []
    for entry in os.listdir("/proc"):
        if entry.isdigit():
            try:
                with open(f"/proc/{entry}/cmdline") as file:
                    words = file.read()
                with open(f"/proc/{entry}/stat") as file:
                    parent = int(file.read().rsplit(")", 1)[1].split()[1])
            except OSError:
                continue
            if "spawn_main" in words and parent == pid:
                found.append(int(entry))
    return found


def test_a_run_gets_its_name_when_it_is_complete_and_names_no_temporary_folder(many):
    target = many / "runs/walk_a"
    row = process_one(many / "in/walk_a", target, Config())
    assert row.status == "done"
    assert row.frames == 6
    assert (target / "report.html").is_file()
    for name in ("summary.json", "report.html"):
        assert ".part-" not in (target / name).read_text()
    command = json.loads((target / "summary.json").read_text())["command"]
    assert command == f"surefoot process {many / 'in/walk_a'} --config {target / 'config.toml'}"
    failed = process_one(many / "in/walk_broken", many / "runs/broken", Config())
    assert failed.status == "failed"
    assert sorted(path.name for path in (many / "runs").iterdir()) == ["walk_a"]


def test_recordings_are_found_at_any_depth_and_only_once(many):
    found = find_all([many, many / "in", many / "in/walk_a"])
    assert [path.name for path in found] == sorted(p.name for p in (many / "in").iterdir())


def test_a_folder_without_any_is_named(tmp_path):
    with pytest.raises(InputError, match=str(tmp_path)):
        find_all([tmp_path])


def test_many_recordings_need_no_dask(many, monkeypatch):
    for name in ("dask", "distributed"):
        monkeypatch.setitem(sys.modules, name, None)
    places = [many / "in" / "walk_a", many / "in" / "walk_b"]
    rows = process_all(places, many / "out", Config(), lambda text: None, workers=2)
    assert [row.status for row in rows] == ["done", "done"]
    with pytest.raises(ConfigError, match="--scheduler needs Dask"):
        process_all(places, many / "other", Config(), lambda text: None, scheduler="tcp://x:1")


def test_two_processes_do_not_write_into_one_batch(many):
    held = RunFolder(many / "out")
    held.root.mkdir()
    held.hold()
    other = subprocess.run(command(many), capture_output=True, text=True, timeout=240, check=False)
    assert other.returncode == 2
    assert other.stderr.count("\n") == 1
    assert "another process writes into" in other.stderr
    assert list(held.root.iterdir()) == []


@pytest.fixture
def done(tmp_path):
    """A batch of one recording, and a call that continues it."""
    write_floor(tmp_path / "in" / "walk", 2)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("surefoot.report.page.write_report", lambda run: run.write_text("report.html", ""))  # fmt: skip
        row = process_one(tmp_path / "in/walk", tmp_path / "out/walk", Config())
    assert row.status == "done"

    def again(config=Config()):  # noqa: B008
        return process_all([tmp_path / "in"], tmp_path / "out", config, lambda text: None, 1)

    return tmp_path, again


def test_runs_of_something_else_are_not_taken_for_those_of_a_batch(done, monkeypatch):
    place, again = done
    assert [row.status for row in again()] == ["done before"]
    with pytest.raises(InputError, match="out/walk was made with another configuration; choose"):
        again(replace(Config(), seed=1))
    with monkeypatch.context() as patch:
        patch.setattr(batch, "version", lambda: "0.0.1")
        with pytest.raises(InputError, match="made by another version"):
            again()
    (place / "in/walk/depth/1.png").write_bytes((place / "in/walk/depth/0.png").read_bytes())
    with pytest.raises(InputError, match="made of another recording"):
        again()


def test_what_killed_writers_left_is_swept_and_damage_is_one_error(done):
    place, again = done
    (place / "out/.part-walk-dead").mkdir()
    (place / "out/.part-summary.csv").write_text("half")
    again()
    assert sorted(one.name for one in (place / "out").iterdir()) == ["summary.csv", "walk"]
    (place / "out/summary.csv").write_text("recording,wall_s\na,fast\n")
    with pytest.raises(RecordingError, match="'fast' is not a number"):
        again()
    (place / "out/summary.csv").unlink()
    (place / "out/walk/summary.json").write_text('{"frames": "many"}')
    with pytest.raises(RecordingError, match="at frames not a whole number"):
        again()
    (place / "out/.surefoot-run").write_text("1")
    with pytest.raises(OutputError, match="that of a single run"):
        again()


def die(mark):
    """A task that kills its worker, each time it is tried."""
    with open(mark, "a") as file:
        file.write("x")
    os.kill(os.getpid(), signal.SIGKILL)


def test_a_task_that_kills_its_workers_is_given_up(tmp_path):
    done = list(run_all(die, [(str(tmp_path / "mark"),)], 2, 3))
    assert done == [(0, None, True)]
    assert (tmp_path / "mark").read_text() == "xxx"
