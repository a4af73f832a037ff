"""Trials are made in order, and those of a study that was killed are not made again."""

from __future__ import annotations

import logging
import operator
import secrets

from surefoot.experiments.support.trials import ResultCache, cached, run_trials

SIZES = [(size,) for size in (3, 5, 7, 9)]


def test_results_come_in_the_order_of_the_tasks():
    assert list(run_trials(operator.sub, [(9, 1), (9, 2), (9, 3)])) == [8, 7, 6]


def test_what_was_done_before_a_study_was_given_up_is_taken_and_the_rest_is_made(tmp_path):
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


def test_without_resume_everything_is_made_anew(tmp_path):
    with cached(ResultCache(tmp_path, resume=False)):
        assert list(run_trials(secrets.token_hex, SIZES)) != list(
            run_trials(secrets.token_hex, SIZES)
        )


def test_other_work_on_the_same_tasks_is_not_confused_with_it(tmp_path):
    with cached(ResultCache(tmp_path, resume=True)):
        list(run_trials(operator.add, [(2, 3)]))
        assert list(run_trials(operator.mul, [(2, 3)])) == [6]


def test_a_damaged_result_is_made_again(tmp_path):
    with cached(ResultCache(tmp_path, resume=True)):
        list(run_trials(operator.add, [(2, 3)]))
        (file,) = tmp_path.glob("*.pickle")
        file.write_bytes(file.read_bytes()[:-3])
        assert list(run_trials(operator.add, [(2, 3)])) == [5]
        assert list(run_trials(operator.add, [(2, 3)])) == [5]


def test_a_study_that_cannot_be_put_aside_is_made_all_the_same(tmp_path, caplog):
    (tmp_path / "runs").write_text("a file where a folder is wanted")
    with (
        cached(ResultCache(tmp_path / "runs" / "study", resume=False)),
        caplog.at_level(logging.WARNING),
    ):
        assert list(run_trials(operator.add, [(2, 3)])) == [5]
    assert "not kept" in caplog.text
