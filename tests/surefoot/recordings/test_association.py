"""Association by time, against a direct implementation of the benchmark's rule."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from surefoot.recordings.poses import associate

stamps = st.lists(st.integers(0, 300), max_size=25, unique=True).map(
    lambda ticks: np.array(ticks, dtype=float) * 0.004
)


def slow(first, second, most_s):
    """All sufficiently close pairs, closest first, each stamp once, as in TUM's associate.py."""
    pairs = sorted(
        (abs(a - b), i, j)
        for i, a in enumerate(first)
        for j, b in enumerate(second)
        if abs(a - b) < most_s
    )
    partner = [-1] * len(first)
    used = set()
    for _, i, j in pairs:
        if partner[i] == -1 and j not in used:
            partner[i] = j
            used.add(j)
    return partner


@given(stamps, stamps)
def test_matches_agree_with_the_script_of_the_benchmark(first, second):
    assert associate(first, second, 0.0185).tolist() == slow(first, second, 0.0185)


@given(stamps)
def test_every_stamp_matches_itself(times):
    np.testing.assert_array_equal(associate(times, times), np.arange(len(times)))


def test_thousands_of_equal_stamps_take_little_memory():
    equal = np.ones(20_000)
    match = associate(equal, equal)
    found = match[match >= 0]
    assert len(found) > 0
    assert len(set(found.tolist())) == len(found)
