"""Association by time, against a direct implementation of the benchmark's rule."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from perception.primitives.pose import Pose3
from surefoot.recordings.poses import SPACING_S, associate, poses_at

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


def swung(at_s: float) -> Pose3:
    """A hand that turns a camera by 1 rad/s about an oblique axis and moves it by .5 m/s."""
    axis = np.array([1.0, 2.0, -2.0]) / 3.0
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    turn = np.eye(3) + np.sin(at_s) * cross + (1.0 - np.cos(at_s)) * cross @ cross  # Rodrigues
    return Pose3.from_rotation(turn, 0.5 * at_s * axis)


def test_a_pose_between_two_is_interpolated():
    rng = np.random.default_rng(3)
    others = rng.permutation(np.arange(0.0, 3.0, 0.03))
    stamps = np.sort(rng.uniform(0.0, 2.9, 40))
    for stamp, pose in zip(
        stamps, poses_at(stamps, others, lambda k: swung(others[k])), strict=True
    ):
        np.testing.assert_allclose(pose().matrix, swung(stamp).matrix, atol=1e-9)


def test_poses_far_apart_are_not_interpolated():
    others = np.array([0.0, 1.01 * SPACING_S, 1.0])
    found = poses_at(np.array([-0.03, -0.01, 0.01, 0.05, 0.1, 1.0, 1.03]), others, lambda k: k)
    assert [pose and pose() for pose in found] == [None, 0, 0, None, 1, 2, None]
