"""Memory of the process."""

from __future__ import annotations

import numpy as np

from surefoot.run.memory import give_back, memory_mb


def test_what_was_freed_between_pieces_in_use_is_given_back():
    before = memory_mb()
    pieces = [np.ones(6_000) for _ in range(4_000)]  # 192 MB
    kept = pieces[::40]
    del pieces
    give_back()
    assert len(kept) == 100
    assert memory_mb() < before + 20.0
