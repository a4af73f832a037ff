"""A batch: every recording once, each failure named, whatever dies; and what is done is not done again."""

from __future__ import annotations

import csv
import json
import os
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from perception.primitives.errors import InputError, OutputError, RecordingError
from surefoot.batch import batch
from surefoot.batch.batch import run_batch
from surefoot.batch.ledger import LEDGER, Ledger
from surefoot.batch.places import Order, jobs_of_places
from surefoot.batch.work import do
from surefoot.results.run_folder import RunFolder

from .small import Answering, children_of, made, write_floor

PROCESS = Order("process")


def run(place: Path, answer, order=PROCESS, again=False, say=lambda text: None):
    """A batch over a folder with such answers: its rows by name, and the names of the jobs that were given."""
    out = place.parent / "out"
    executor = Answering(answer)
    jobs = jobs_of_places(order, [str(place)], out)
    rows = run_batch(order, jobs, out, lambda: executor, say, again)
    return {row.name: row for row in rows}, executor.given


def table(out: Path) -> dict[str, dict[str, str]]:
    """summary.csv by name."""
    with (out / "summary.csv").open(newline="") as file:
        return {row["name"]: row for row in csv.DictReader(file)}


def events(place: Path) -> list[tuple[str, str]]:
    """Job and event of each line of the ledger."""
    lines = (place.parent / "out" / LEDGER).read_text().splitlines()[1:]
    return [(one["job"], one["event"]) for one in map(json.loads, lines)]


def test_what_is_done_is_not_done_again_and_what_failed_is(recordings):
    def first(job):
        return {"status": "failed", "reason": "dark"} if job.name == "b" else made(job)

    rows, given = run(recordings, first)
    assert sorted(given) == ["b", "c", "day-a", "night-a"]
    assert {name: row.status for name, row in rows.items()} == {
        "day-a": "done", "b": "failed", "night-a": "done", "c": "done",
    }  # fmt: skip
    assert (rows["b"].reason, rows["b"].run) == ("dark", "")
    rows, given = run(recordings, made)
    assert given == ["b"]
    assert {row.status for row in rows.values()} == {"done"}
    frames = {name: row["frames"] for name, row in table(recordings.parent / "out").items()}
    assert frames == dict.fromkeys(rows, "3")
    assert sorted(name for name, event in events(recordings) if event == "done") == sorted(rows)


def test_what_kills_two_workers_is_put_in_quarantine_and_tried_again_only_when_asked(recordings):
    def deadly(job):
        return {"status": "died", "reason": "SIGSEGV"} if job.name == "c" else made(job)

    rows, given = run(recordings, deadly)
    assert given.count("c") == 2
    assert (rows["c"].status, rows["c"].reason) == ("quarantined", "2 times: SIGSEGV")
    said: list[str] = []
    assert run(recordings, made, say=said.append)[1] == []
    assert said == ["before: 3 of 4 done, 1 in quarantine"]
    rows, given = run(recordings, made, again=True)
    assert given == ["c"]
    assert rows["c"].status == "done"


def test_a_death_counts_in_the_next_session_too(recordings):
    def then_the_batch_dies(job):
        if job.name == "c":
            return {"status": "died", "reason": "SIGSEGV"}
        raise KeyboardInterrupt

    (recordings / "day").rename(recordings.parent / "day")
    (recordings / "night/a").rename(recordings / "night/x")  # after c
    with pytest.raises(KeyboardInterrupt):
        run(recordings, then_the_batch_dies)
    rows, given = run(
        recordings,
        lambda job: made(job) if job.name == "x" else {"status": "died", "reason": "SIGSEGV"},
    )
    assert given.count("c") == 1
    assert rows["c"].status == "quarantined"


def test_a_lost_worker_is_no_fault_of_the_recording_and_passing_errors_are_tried_again(recordings):
    tried = dict.fromkeys(("b", "c", "day-a", "night-a"), 0)

    def unlucky(job):
        tried[job.name] += 1
        if job.name == "b":
            return {"status": "again", "reason": "no network"}
        if job.name == "day-a" or (job.name == "c" and tried["c"] < 4):
            return {"status": "lost", "reason": "node gone"}
        return made(job)

    rows, _ = run(recordings, unlucky)
    assert tried == {"b": 3, "c": 4, "day-a": 5, "night-a": 1}
    assert (rows["b"].status, rows["b"].reason) == ("failed", "no network (3 times)")
    assert rows["c"].status == "done"
    assert rows["day-a"].status == "quarantined"


def test_a_run_that_was_complete_before_its_line_was_written_is_taken_over(recordings):
    def killed(job):
        made(job)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(recordings, killed)
    assert events(recordings) == []
    rows, given = run(recordings, made)
    assert sorted([*given, "day-a"]) == sorted(rows)
    assert [event for event in events(recordings) if event[0] == "day-a"] == [("day-a", "done")]


def test_half_a_line_of_a_killed_batch_is_cut_off(recordings):
    run(recordings, made)
    ledger = recordings.parent / "out" / LEDGER
    whole = ledger.read_bytes()
    ledger.write_bytes(whole[:-20])
    rows, given = run(recordings, made)
    assert given == []
    assert {row.status for row in rows.values()} == {"done"}
    assert len(ledger.read_bytes().splitlines()) == len(whole.splitlines())


def test_a_damaged_line_is_one_error_that_names_it(recordings):
    run(recordings, made)
    ledger = recordings.parent / "out" / LEDGER
    lines = ledger.read_text().splitlines()
    for wrong, said in (
        ("nonsense", "line 3 is not valid JSON"),
        ('{"job": 3}', "line 3 .* at .*job"),
    ):
        ledger.write_text("\n".join([*lines[:2], wrong, *lines[2:], ""]))
        with pytest.raises(RecordingError, match=said):
            run(recordings, made)


def test_runs_of_something_else_are_not_taken_for_those_of_a_batch(recordings, monkeypatch):
    run(recordings, made)
    with pytest.raises(InputError, match="was made with another configuration; choose"):
        run(recordings, made, Order("process", overrides=("seed=1",)))
    with pytest.raises(InputError, match="was made by `process`"):
        run(recordings, made, Order("map"))
    with monkeypatch.context() as patch:
        patch.setattr(batch, "version", lambda: "0.0.1")
        with pytest.raises(InputError, match="by another version"):
            run(recordings, made)
    pictures = recordings / "day/b/depth"
    (pictures / "1.png").write_bytes((pictures / "0.png").read_bytes())
    with pytest.raises(InputError, match="b was made of another recording"):
        run(recordings, made)


def test_a_folder_of_anything_else_is_not_written_into(recordings):
    out = recordings.parent / "out"
    out.mkdir()
    (out / "mine").write_text("1")
    with pytest.raises(OutputError, match="not that of a batch"):
        run(recordings, made)
    (out / "mine").rename(out / ".surefoot-run")
    with pytest.raises(OutputError, match="that of a single run"):
        run(recordings, made)


def test_a_run_that_was_deleted_is_made_again(recordings):
    run(recordings, made)
    (recordings.parent / "out/b/report.html").unlink()
    rows, given = run(recordings, made)
    assert given == ["b"]
    assert rows["b"].status == "done"


def test_a_ledger_that_cannot_be_written_is_one_error(tmp_path):
    ledger = Ledger.open(tmp_path / LEDGER, {"verb": "process"})
    (tmp_path / LEDGER).unlink()
    (tmp_path / LEDGER).mkdir()
    with pytest.raises(OutputError, match="cannot write into"):
        ledger.note("a", "done")


@pytest.mark.parametrize("name", ['it\'s "dark" #2', "größe\n東京 [*]", "back\\slash", "n" * 250])
def test_a_run_of_any_name_says_how_it_is_repeated(tmp_path, pages, name):
    write_floor(tmp_path / "in" / name)
    with pages():
        rows, _ = run(tmp_path / "in", do)
    (row,) = rows.values()
    assert (row.status, row.recording) == ("done", str(tmp_path / "in" / name)), row.reason
    summary = json.loads((Path(row.run) / "summary.json").read_text())
    assert shlex.split(summary["command"]) == [
        "surefoot", "process", str(tmp_path / "in" / name), "--config", f"{row.run}/config.toml",
    ]  # fmt: skip
    for file in filter(Path.is_file, (tmp_path / "out").rglob("*")):
        assert b".part-" not in file.read_bytes(), file


def test_a_name_that_is_not_utf8_is_a_reason_and_stops_no_other(tmp_path, pages):
    for name in ("good", "bad"):
        write_floor(tmp_path / "in" / name)
    (tmp_path / "in/bad").rename(tmp_path / "in" / os.fsdecode(b"\xe9t\xe9"))
    os.link(tmp_path / "in/good/depth/0.png", tmp_path / "in/good" / os.fsdecode(b"\xe9.png"))
    with pages():
        rows, _ = run(tmp_path / "in", do)
    assert rows["good"].status == "done", rows["good"].reason
    bad = table(tmp_path / "out")["\\udce9t\\udce9"]
    assert (bad["status"], bad["reason"]) == ("failed", "its name is not UTF-8; rename it")
    assert bad["recording"] == str(tmp_path / "in/\\udce9t\\udce9")


@pytest.fixture
def many(tmp_path):
    """A good recording, and one whose every image is broken."""
    for name in ("walk", "walk_broken"):
        write_floor(tmp_path / "in" / name)
    for file in (tmp_path / "in/walk_broken/depth").iterdir():
        file.write_bytes(b"this is no picture")
    return tmp_path


def command(many, *more):
    words = [sys.executable, "-c", "from surefoot.cli.main import main; main()", "batch", "process"]
    words += [str(many / "in"), "--out", str(many / "out"), "--workers", "2", "--memory", "1.5"]
    return [*words, *more]


def test_a_killed_worker_and_a_broken_recording_cost_nothing_else(many):
    running = subprocess.Popen(command(many), stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 120.0
    while not list(many.glob("out/.part-*/walk")) and time.monotonic() < deadline:
        time.sleep(0.02)
    victims = children_of(running.pid)
    assert victims
    os.kill(victims[0], signal.SIGKILL)
    _, said = running.communicate(timeout=240)
    rows = table(many / "out")
    assert {name: row["status"] for name, row in rows.items()} == {
        "walk": "done", "walk_broken": "failed",
    }  # fmt: skip
    assert "cannot be decoded" in rows["walk_broken"]["reason"]
    assert running.returncode == 1, said
    assert "workers: 2 of at most 1.5 GiB each" in said
    assert "SIGKILL" in (many / "out" / LEDGER).read_text()
    assert not list(many.glob("out/.part-*"))
    for file in filter(Path.is_file, (many / "out/walk").rglob("*")):
        assert b".part-" not in file.read_bytes(), file


def test_two_processes_do_not_write_into_one_batch(many):
    held = RunFolder(many / "out")
    held.root.mkdir()
    held.hold()
    other = subprocess.run(command(many), capture_output=True, text=True, timeout=240, check=False)
    assert other.returncode == 2
    assert other.stderr.count("\n") == 1
    assert "another process writes into" in other.stderr
    assert list(held.root.iterdir()) == []
