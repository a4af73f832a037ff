"""Workers: bounded memory, deaths with their reason, and the workers of a Dask cluster."""

from __future__ import annotations

import os
import sys

import pytest

from perception.primitives.errors import ConfigError, InputError
from surefoot import cores
from surefoot.batch import dask_cluster, pool, worker
from surefoot.batch.job import Job
from surefoot.batch.pool import Pool, how_many
from surefoot.batch.worker import Worker

STRANGE = """
import os, signal, sys, types
from surefoot.batch import worker

def do(job):
    if job.source == "kill":
        os.kill(os.getpid(), signal.SIGKILL)
    if job.source == "crash":
        os.abort()
    if job.source == "large":
        return {"status": "done", "reason": str(len(bytearray(3 << 30)))}
    print("this is no answer")
    return {"status": "done", "reason": str(os.getpid())}

def bounded(job):
    try:
        return do(job)
    except MemoryError:
        return {"status": "died", "reason": "memory"}

sys.modules["surefoot.batch.work"] = types.SimpleNamespace(do=bounded)
worker.main(float(sys.argv[1]))
"""


@pytest.fixture
def strange(tmp_path, monkeypatch):
    """Workers that die as a job says; else they tell their process."""
    program = tmp_path / "strange.py"
    program.write_text(STRANGE)
    monkeypatch.setattr(worker, "PROGRAM", (str(program),))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(path for path in sys.path if path))


def job(source):
    return Job(source, "process", source, "nowhere")


def test_a_death_is_told_with_its_reason_and_harms_no_other_job(strange):
    ours = Pool(2, 1.0)
    found = {}
    waiting = [job(name) for name in ("one", "kill", "crash", "large", "two")]
    while waiting or ours._busy:
        while waiting and ours.room():
            ours.submit(waiting.pop(0))
        done, answer = ours.next()
        found[done.name] = answer
    ours.close()
    assert {name: answer["status"] for name, answer in found.items()} == {
        "one": "done", "kill": "died", "crash": "died", "large": "died", "two": "done",
    }  # fmt: skip
    assert "SIGKILL" in found["kill"]["reason"]
    assert "SIGABRT" in found["crash"]["reason"]
    assert "Fatal Python error: Aborted" in found["crash"]["reason"]
    assert found["large"]["reason"] == "memory"
    assert found["large"]["last"]


def test_a_worker_ends_with_whoever_started_it(strange):
    one = Worker(1.0)
    one.send(job("one"))
    process = int(one.answer()["reason"])
    one._process.stdin.close()
    assert one._process.wait(timeout=30) == 1
    with pytest.raises(ProcessLookupError):
        os.kill(process, 0)
    one.close()


def test_workers_that_do_not_fit_into_the_memory_are_refused(monkeypatch):
    monkeypatch.setattr(pool, "free_gib", lambda: 10.0)
    monkeypatch.setattr(cores, "available", lambda: 8)
    assert how_many(None, 4.0) == 2
    assert how_many(None, 1.0) == 8
    for wanted, memory in ((3, 4.0), (None, 11.0)):
        with pytest.raises(InputError, match="do not fit into the 10"):
            how_many(wanted, memory)


def test_without_dask_or_a_scheduler_there_is_one_error(monkeypatch):
    monkeypatch.setattr(dask_cluster, "CONNECT_S", 0.2)
    with pytest.raises(ConfigError, match="no Dask scheduler answers"):
        dask_cluster.DaskCluster("tcp://127.0.0.1:1", 1.0, print)
    monkeypatch.setitem(sys.modules, "dask", None)
    with pytest.raises(ConfigError, match="--scheduler needs Dask"):
        dask_cluster.DaskCluster("tcp://x:1", 1.0, print)


def answered(line, memory_gib):
    """A job of a cluster, without a process of its own."""
    return {"status": "done", "reason": Job.read(line).name}


def test_a_scheduler_that_comes_back_gets_its_jobs_again(monkeypatch):
    distributed = pytest.importorskip("distributed", reason="Dask is not installed")
    monkeypatch.setattr(dask_cluster, "serve", answered)
    monkeypatch.setattr(dask_cluster, "TICK_S", 0.1)
    here = {
        "processes": False,
        "protocol": "tcp",
        "dashboard_address": ":0",
        "threads_per_worker": 1,
    }
    said = []
    with distributed.LocalCluster(**here, n_workers=0, scheduler_port=0) as first:
        address = first.scheduler_address
        ours = dask_cluster.DaskCluster(address, 1.0, said.append)
        assert ours.room()
        for name in ("a", "b"):
            ours.submit(job(name))
        assert not ours.room()
    port = int(address.rpartition(":")[2])
    with distributed.LocalCluster(**here, n_workers=1, scheduler_port=port):
        answers = [ours.next() for _ in range(2)]
        ours.close()
    assert sorted(done.name for done, _ in answers) == ["a", "b"]
    assert all(answer == {"status": "done", "reason": done.name} for done, answer in answers)
    assert said == [f"the scheduler at {address} is gone; waiting for it"]
