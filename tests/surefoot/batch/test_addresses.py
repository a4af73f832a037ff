"""Recordings in object stores are found, fetched whole, processed to the same bits, and removed again."""

from __future__ import annotations

import json
import os
import shutil
import socket
import sys
import tempfile
from collections import namedtuple
from pathlib import Path

import fsspec
import pytest

from perception.primitives.errors import ConfigError, InputError, RecordingError
from surefoot.batch import addresses, work
from surefoot.batch.places import Order, jobs_of_places
from surefoot.batch.work import do

from .small import write_floor

KEYS = {"AWS_ACCESS_KEY_ID": "none", "AWS_SECRET_ACCESS_KEY": "none", "AWS_DEFAULT_REGION": "us-east-1"}  # fmt: skip


@pytest.fixture(scope="module")
def object_server():
    """Address of an object server with S3's interface on this machine."""
    for package in ("s3fs", "flask_cors", "moto"):
        pytest.importorskip(package, reason="S3: needs s3fs, moto and flask-cors")
    from moto.server import ThreadedMotoServer

    server = ThreadedMotoServer("127.0.0.1", 0, verbose=False)
    server.start()
    yield "http://{}:{}".format(*server.get_host_and_port())
    server.stop()


@pytest.fixture(params=["memory", "s3"])
def store(request, monkeypatch, tmp_path):
    """A storage with two recordings below walks/, and the folder with the same two."""
    if request.param == "s3":
        server = request.getfixturevalue("object_server")
        for name, value in (*KEYS.items(), ("AWS_ENDPOINT_URL", server)):
            monkeypatch.setenv(name, value)
        fsspec.get_filesystem_class("s3").clear_instance_cache()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "tmp"))
    monkeypatch.setitem(work._VERBS, "process", copy_of)
    (tmp_path / "tmp").mkdir()
    for name in ("a", "b"):
        write_floor(tmp_path / "walks" / name)
    (tmp_path / "walks/notes.md").write_text("no recording")
    address = f"{request.param}://lab-{tmp_path.name.replace('_', '-')[-20:]}/walks"
    system, place = fsspec.core.url_to_fs(address)
    system.mkdirs(place.rpartition("/")[0], exist_ok=True)
    system.put(f"{tmp_path / 'walks'}/", f"{place}/", recursive=True)
    return address, system, tmp_path


def copy_of(job, source, part):
    """A run that holds the recording as the worker had it."""
    shutil.copytree(source, part)
    command = f"surefoot process {source}"
    (part / "summary.json").write_text(json.dumps({"recording": str(source), "command": command}))
    (part / "report.html").write_text(f"<pre>{command}</pre>")
    return ""


def jobs_at(store):
    return jobs_of_places(Order("process"), [store[0]], store[2] / "out")


def test_a_fetched_recording_is_that_on_the_disk_and_nothing_stays_behind(store):
    address, _, place = store
    jobs = jobs_at(store)
    assert [job.name for job in jobs] == ["a", "b"]
    assert jobs[0].source.startswith(address.partition(":")[0])
    assert jobs[0].source.endswith("/walks/a")
    answer = do(jobs[0])
    assert answer["status"] == "done", answer
    whole = place / "walks/a"
    for file in filter(Path.is_file, whole.rglob("*")):
        copy = Path(jobs[0].target) / file.relative_to(whole)
        assert copy.read_bytes() == file.read_bytes(), file
    assert list((place / "tmp").iterdir()) == []
    made = json.loads((place / "out/a/summary.json").read_text())
    assert made["recording"] == jobs[0].source
    assert made["command"].split()[2] == jobs[0].source
    for file in filter(Path.is_file, (place / "out/a").rglob("*")):
        assert addresses.PREFIX.encode() not in file.read_bytes(), file


def test_a_fetched_recording_that_cannot_be_used_is_named_by_its_address(store, monkeypatch):
    def refuse(job, source, part):
        raise RecordingError(f"{source}: none of its frames could be used")

    monkeypatch.setitem(work._VERBS, "process", refuse)
    job = jobs_at(store)[0]
    assert do(job)["reason"] == f"{job.source}: none of its frames could be used"


def test_what_readers_look_for_beside_a_recording_is_fetched_too(store):
    address, system, _ = store
    root = address.partition("://")[2]
    system.pipe(f"{root}/truth/trajectory.txt", b"0 0 0 0 0 0 0 1")
    system.pipe(f"{root}/cam_params.json", b"{}")
    job = jobs_at(store)[0]
    with addresses.fetched(job.source, job.identity) as copy:
        assert copy.name == "a"
        assert (copy.parent / "truth/trajectory.txt").read_bytes() == b"0 0 0 0 0 0 0 1"
        assert (copy.parent / "cam_params.json").read_bytes() == b"{}"
        assert not (copy.parent / "b").exists()
    assert not copy.exists()


@pytest.mark.parametrize("name", ["a/../../../../escaped", "a//escaped"])
def test_names_that_lead_out_of_the_copy_are_refused(store, name):
    address, system, place = store
    if address.startswith("memory"):  # which tidies names up by itself
        system.store[f"{address.partition(':/')[2]}/{name}"] = system.store.popitem()[1]
    else:
        bucket, _, key = address.partition("://")[2].partition("/")
        system.call_s3("put_object", Bucket=bucket, Key=f"{key}/{name}", Body=b"x")
    with pytest.raises(InputError, match="leads out of its folder"):
        jobs_at(store)
    assert not list(place.rglob("*escaped*"))


def test_a_single_recording_may_be_the_address(store):
    address, _, _ = store
    assert list(addresses.recordings_at(f"{address}/b")) == [jobs_at(store)[1].source]


def test_a_recording_that_changed_or_vanished_since_is_named(store):
    _, system, _ = store
    job, gone = jobs_at(store)
    picture = job.source.partition("://")[2] + "/depth/1.png"
    system.pipe(picture, b"another content")
    answer = do(job)
    assert (answer["status"], "has changed" in answer["reason"]) == ("failed", True), answer
    system.rm(gone.source.partition("://")[2], recursive=True)
    assert do(gone)["status"] == "failed"
    assert not Path(job.target).exists()


def test_a_recording_that_does_not_fit_is_named_and_not_begun(store, monkeypatch):
    job = jobs_at(store)[0]
    usage = namedtuple("usage", "free")
    monkeypatch.setattr(addresses.shutil, "disk_usage", lambda path: usage(1000))
    answer = do(job)
    assert answer["status"] == "failed"
    assert "set TMPDIR" in answer["reason"]


def test_half_a_file_is_tried_again(store, monkeypatch):
    job = jobs_at(store)[0]
    whole = addresses._copy

    def half(system, copies, what):
        whole(system, copies, what)
        copy = next(iter(copies.values()))
        copy.write_bytes(copy.read_bytes()[:10])

    monkeypatch.setattr(addresses, "_copy", half)
    answer = do(job)
    assert (answer["status"], "did not come whole" in answer["reason"]) == ("again", True), answer
    assert list((store[2] / "tmp").iterdir()) == []


def test_copies_that_killed_workers_left_are_removed(store):
    left = store[2] / "tmp" / f"{addresses.PREFIX}dead"
    left.mkdir()
    assert do(jobs_at(store)[0])["status"] == "done"
    assert left.is_dir()  # it may be of a worker that has just begun
    os.utime(left, (0, 0))
    assert do(jobs_at(store)[1])["status"] == "done"
    assert not left.exists()


def test_what_cannot_be_asked_is_one_error(monkeypatch):
    for address, kind, said in (
        ("nonsense://lab/walks", InputError, "no address of a storage"),
        ("memory://lab/nothing", InputError, "there is nothing"),
    ):
        with pytest.raises(kind, match=said):
            addresses.recordings_at(address)
    monkeypatch.setitem(sys.modules, "fsspec", None)
    with pytest.raises(ConfigError, match=r"surefoot\[cloud\]"):
        addresses.recordings_at("s3://lab/walks")


def test_a_storage_that_does_not_answer_is_tried_again(monkeypatch):
    pytest.importorskip("s3fs", reason="S3: needs s3fs")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    for name, value in (*KEYS.items(), ("AWS_ENDPOINT_URL", f"http://127.0.0.1:{port}"), ("AWS_MAX_ATTEMPTS", "1")):  # fmt: skip
        monkeypatch.setenv(name, value)
    fsspec.get_filesystem_class("s3").clear_instance_cache()
    with pytest.raises(ConnectionError, match="walks"):
        addresses.recordings_at("s3://lab/walks")
