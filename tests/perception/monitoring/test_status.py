"""A doubt is said at once, and long enough to be read."""

from __future__ import annotations

from perception.monitoring.status import HOLD_S, SLOW, Doubt, StatusBoard


def test_a_doubt_of_one_instant_is_held_for_a_while():
    board = StatusBoard()
    gap = Doubt("gap in stamps", SLOW)
    said = {s: board.update(s, [gap] if s == 1.0 else []) for s in (0.5, 1.0, 1.5, 1.9, 2.1)}
    assert HOLD_S == 1.0
    assert [s for s, status in said.items() if gap in status] == [1.0, 1.5, 1.9]


def test_the_order_of_the_doubts_does_not_matter():
    one, other = Doubt("a"), Doubt("b")
    assert StatusBoard().update(0.0, [one, other]) == StatusBoard().update(0.0, [other, one])
