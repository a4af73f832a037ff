"""Trials return in order, and finished trials of an interrupted study are not run again."""

from __future__ import annotations

import logging
import operator
import os
import secrets
import subprocess
import sys
import time
from pathlib import Path

from surefoot.experiments.support.trials import ResultCache, cached, run_all, run_trials

ROOT = str(Path(__file__).parents[4])
SIZES = [(size,) for size in (3, 5, 7, 9)]


def test_results_come_in_the_order_of_the_tasks():
    assert list(run_trials(operator.sub, [(9, 1), (9, 2), (9, 3)])) == [8, 7, 6]


def test_stored_results_are_used_and_missing_ones_are_computed(tmp_path):
    with cached(ResultCache(tmp_path, resume=False)):
        begun = run_trials(secrets.token_hex, SIZES)
        first = next(begun), next(begun)
        begun.close()
    with cached(ResultCache(tmp_path, resume=True)):
        whole = list(run_trials(secrets.token_hex, SIZES))
        again = list(run_trials(secrets.token_hex, SIZES))
    assert tuple(whole[:2]) == first
    assert [len(word) for word in whole] == [6, 10, 14, 18]
    assert again == whole


def test_progress_counts_the_finished_trials():
    said = []
    assert run_all(operator.sub, [(9, 1), (9, 2)], said.append, "trials") == [8, 7]
    assert said == ["1 of 2 trials", "2 of 2 trials"]


def test_without_resume_every_trial_runs_again(tmp_path):
    with cached(ResultCache(tmp_path, resume=False)):
        assert list(run_trials(secrets.token_hex, SIZES)) != list(
            run_trials(secrets.token_hex, SIZES)
        )


def test_results_of_different_functions_are_separate(tmp_path):
    with cached(ResultCache(tmp_path, resume=True)):
        list(run_trials(operator.add, [(2, 3)]))
        assert list(run_trials(operator.mul, [(2, 3)])) == [6]


def test_a_damaged_result_is_computed_again(tmp_path):
    with cached(ResultCache(tmp_path, resume=True)):
        list(run_trials(operator.add, [(2, 3)]))
        (file,) = tmp_path.glob("*.trial")
        file.write_bytes(file.read_bytes()[:-3])
        assert list(run_trials(operator.add, [(2, 3)])) == [5]
        assert list(run_trials(operator.add, [(2, 3)])) == [5]


def test_a_study_runs_even_if_its_results_cannot_be_stored(tmp_path, caplog):
    (tmp_path / "runs").write_text("a file where a folder is wanted")
    with (
        cached(ResultCache(tmp_path / "runs" / "study", resume=False)),
        caplog.at_level(logging.WARNING),
    ):
        assert list(run_trials(operator.add, [(2, 3)])) == [5]
    assert "not stored" in caplog.text


def test_workers_end_with_a_parent_that_was_killed(tmp_path):
    script = tmp_path / "study.py"
    script.write_text(
        "import os, time\n"
        "from pathlib import Path\n"
        "from surefoot.experiments.support.trials import run_trials\n"
        "def work(folder):\n"
        "    (Path(folder) / str(os.getpid())).touch()\n"
        "    time.sleep(600)\n"
        "if __name__ == '__main__':\n"
        f"    list(run_trials(work, [({str(tmp_path)!r},)] * 2))\n"
    )
    study = subprocess.Popen([sys.executable, str(script)], env={**os.environ, "PYTHONPATH": ROOT})
    assert happens(lambda: list(tmp_path.glob("[0-9]*")))
    study.kill()
    study.wait()
    assert happens(lambda: not any(alive(int(file.name)) for file in tmp_path.glob("[0-9]*")))


def happens(what, seconds=60.0):
    end = time.monotonic() + seconds
    while not what() and time.monotonic() < end:
        time.sleep(0.05)
    return what()


def alive(process):
    """Whether it runs; a zombie, which nobody waits for, does not."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False
