"""What hangs: the kernels against NumPy. Its geometry is tested with the maps of a run."""

from __future__ import annotations

import numpy as np
import pytest

from mapping.grid import hanging
from mapping.grid._terrain_kernels import RAY, Placement

N, CELL_M = 12, 0.05


def frame(rng):
    """Points of a frame in the cells of a window, their sums, and what a map knows, in world order."""
    counts = rng.integers(0, 6, (3, N, N)).astype(np.int32) * (rng.random((3, N, N)) < 0.4)
    heights = rng.uniform(0.0, 0.5, (3, N, N, 5))
    taken = np.arange(5) < counts[..., None]
    sums = np.zeros((3 * N * N + 1, 3))
    sums[:-1, 0] = (heights * taken).sum(axis=-1).ravel()
    sums[:-1, 1] = (heights**2 * taken).sum(axis=-1).ravel()
    known = rng.random((N, N)) < 0.3
    height_m = rng.uniform(0.1, 0.5, (N, N)).astype(np.float32)
    odds = rng.normal(0.0, 2.0, (N, N)).astype(np.float32)
    return counts.astype(np.int32), sums, heights, taken, known, height_m, odds


@pytest.mark.parametrize("seed", range(20))
def test_kernels_and_numpy_agree(seed):
    rng = np.random.default_rng(seed)
    counts, sums, heights, taken, known, height_m, odds = frame(rng)
    corner = rng.integers(0, N, 2)
    place = Placement(int(corner[0]), int(corner[1]), 1.0, -2.0, CELL_M)

    def through(places):
        return np.sin(40.0 * places @ [1.0, 2.0, 3.0]) > 0.0

    lowest_m = np.full((N, N), np.nan)
    for cell in np.argwhere(counts[1] >= 3):
        points = heights[1][tuple(cell)][taken[1][tuple(cell)]]
        lowest_m[tuple(cell)] = points.mean() - 2.0 * points.std()
    row, column = np.indices((N, N))
    xy = [1.0 + CELL_M * (column + 0.5), -2.0 + CELL_M * (row + 0.5)]
    below = through(np.stack([*xy, lowest_m - hanging.BELOW_M], axis=-1))
    below |= through(np.stack([*xy, 0.5 * lowest_m], axis=-1))
    at_height = through(np.stack([*xy, height_m], axis=-1))
    high = lowest_m > hanging.LOWEST_M
    fresh = high & ~known & below
    hangs = (known & ~(lowest_m <= hanging.LOWEST_M)) | (fresh & (odds > 0.0))
    bare = known & (counts[1] + counts[2] < 3)
    floor = np.where(bare & ~at_height, 0, counts[0])
    floor = np.where(bare & at_height & (floor == 0), RAY, floor)

    layers = [np.roll(layer, corner, (0, 1)) for layer in (known, height_m, odds)]
    others = counts[1:].copy(), sums[N * N :].copy()
    forgotten = hanging.note(counts, sums, *layers, place, through)
    np.testing.assert_array_equal(counts[0], floor)
    np.testing.assert_array_equal(counts[1:], others[0])
    assert not sums[: N * N][(bare & ~at_height).ravel()].any()
    np.testing.assert_array_equal(sums[N * N :], others[1])
    np.testing.assert_array_equal(layers[0], np.roll(hangs, corner, (0, 1)))
    free = np.zeros((N, N), bool)
    free[forgotten] = True
    np.testing.assert_array_equal(free, np.roll(fresh & (odds < 0.0), corner, (0, 1)))
