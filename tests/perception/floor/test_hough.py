"""The vote of the Hough transform keeps planes apart that differ by more than a cell."""

from __future__ import annotations

import numpy as np

from perception.floor import _search_kernels as kernels
from perception.floor.hough import HoughSpace, VoteLimits, VoteTable
from perception.floor.prior import Gate
from perception.floor.sample import Sample

CELL_M = 0.02
UP = np.array([0.0, -1.0, 0.0])


def votes_of(heights_m, shift_m):
    """Distance, mean of its votes, and votes of every cell; exact points of level planes below the camera."""
    rng = np.random.default_rng(0)
    x, z = rng.uniform(-1.0, 1.0, 900), rng.uniform(1.0, 3.0, 900)
    y = np.repeat(heights_m, 900 // len(heights_m))
    sample = Sample(x, y, z, np.full(900, 0.001))
    space = HoughSpace(
        np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]),
        np.array([0.0, heights_m[0] + shift_m, 2.0]), np.radians(2.0), CELL_M,
    )  # fmt: skip
    size = 1 << 15
    table = VoteTable(np.full(size, -1, np.int64), np.zeros(size, np.int64), np.zeros((size, 3)))
    gate = Gate(UP, 0.3, np.cos(0.3), 0.1, 3.0)
    limits = VoteLimits(4000, 10_000, 1, 4000)
    kernels.vote(sample, gate, space, limits, 0.15, 0.0, np.uint64(1), table)
    used = table.votes > 0
    return table.votes[used], table.sums[used, 2] / table.votes[used]


def test_two_planes_five_centimetres_apart_get_their_votes_in_different_cells():
    votes, distance = votes_of((1.0, 0.95), -0.07)
    order = np.argsort(-votes)[:2]
    # distances from an origin 7 cm above the lower plane, in one cell of 8 cm but not of 2 cm
    assert sorted(np.round(distance[order], 3)) == [0.02, 0.07]
