"""What a batch says at its end."""

from __future__ import annotations

from surefoot.batch.pages import Row, lines


def test_of_walks_it_is_said_how_many_reached_every_goal():
    walks = [
        Row("home", "home-0", "runs/home-0", "done", frames=100),
        Row("home", "home-1", "runs/home-1", "done", frames=50, reason="0 of 1 goals reached"),
        Row("home", "home-2", "", "failed", reason="no space"),
    ]
    assert lines(walks, walks=True)[-1] == "2 of 3 done, 1 of 3 reached every goal, 150 frames"
    assert lines(walks)[-1] == "2 of 3 done, 150 frames"
