"""Trials return in order, and finished trials of an interrupted study are not run again."""

from __future__ import annotations

import logging
import operator
import secrets

from surefoot.experiments.support.trials import ResultCache, cached, run_all, run_trials

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
