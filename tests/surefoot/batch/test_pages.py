"""What a batch says at its end."""

from __future__ import annotations

import pytest

from surefoot.batch.job import Job
from surefoot.batch.ledger import Ledger
from surefoot.batch.pages import Row, lines, rows


def test_of_walks_it_is_said_how_many_reached_every_goal():
    walks = [
        Row("home", "home-0", "runs/home-0", "done", frames=100),
        Row("home", "home-1", "runs/home-1", "done", frames=50, reason="0 of 1 goals reached"),
        Row("home", "home-2", "", "failed", reason="no space"),
    ]
    assert lines(walks, walks=True)[-1] == "2 of 3 done, 1 of 3 reached every goal, 150 frames"
    assert lines(walks)[-1] == "2 of 3 done, 150 frames"


@pytest.mark.parametrize("absolute", [False, True])
def test_the_path_of_a_recording_that_fails_is_said_once(tmp_path, monkeypatch, absolute):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "data" / "bad").mkdir(parents=True)
    named = tmp_path / "data" / "bad" if absolute else "data/bad"
    job = Job("bad", "process", "data/bad", str(tmp_path / "bad"))
    ledger = Ledger.open(tmp_path / "ledger.jsonl", {"verb": "process"})
    ledger.note("bad", "failed", source="data/bad", reason=f"{named}: no frames found")
    (row,) = rows([job], ledger)
    assert row.reason == "no frames found"
    assert lines([row]) == ["failed: data/bad: no frames found", "0 of 1 done, 0 frames"]


def test_one_frame_is_no_frames():
    assert lines([Row("a", "a", "runs/a", "done", frames=1)]) == ["1 of 1 done, 1 frame"]


def test_it_is_said_how_to_try_again_what_is_in_quarantine():
    held = Row("a", "a", "", "quarantined", reason="2 times: SIGKILL")
    assert [line for line in lines([held]) if "--again" in line]
    assert not [line for line in lines([Row("a", "a", "", "failed")]) if "--again" in line]
