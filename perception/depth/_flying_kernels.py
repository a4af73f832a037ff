"""Compiled loop over the neighbours of every pixel."""

from __future__ import annotations

import numpy as np

from ..primitives.compiled import njit


@njit(cache=True, nogil=True)
def between(
    depth: np.ndarray,
    off: np.ndarray,
    jump_x: float,
    jump_y: float,
    own: float,
    found: np.ndarray,
) -> None:
    """Pixels between a nearer and a farther neighbour that are one or two pixels away on opposite sides.

    Args:
        depth: (h, w) m; NaN without.
        off: (h, w) least distance from both neighbours, m.
        jump_x, jump_y: Least jump between the neighbours, per pixel between them and per metre of depth.
        own: Least distance from a neighbour, as a share of the least jump over as many pixels.
        found: (h, w) output.
    """
    height, width = depth.shape
    for v in range(height):
        for u in range(width):
            middle = depth[v, u]
            for axis in range(2):
                du, dv = 1 - axis, axis
                jump = jump_y if axis else jump_x
                for k in range(3):  # one pixel to both sides, then two to either side
                    a, b = 1 + (k == 1), 1 + (k == 2)
                    v0, u0, v1, u1 = v - a * dv, u - a * du, v + b * dv, u + b * du
                    if v0 < 0 or u0 < 0 or v1 >= height or u1 >= width:
                        continue
                    one, other = depth[v0, u0], depth[v1, u1]
                    if one > other:
                        one, other, a, b = other, one, b, a
                    step = own * jump * middle
                    if (
                        middle - one > max(off[v, u], a * step)
                        and other - middle > max(off[v, u], b * step)
                        and other - one > (a + b) * jump * one
                    ):
                        found[v, u] = True
