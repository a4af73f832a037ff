"""Compiled loop over the neighbours of every pixel."""

from __future__ import annotations

import numpy as np

from ..primitives.compiled import njit

LEAST_STEP, MOST_STEP = 0.05, 0.5
"""Ours: share of each quarter of a ramp in its jump: .1 to .4 of a Gaussian, .25 of a mean; one of an edge is 1."""
FLAT = 0.2  # ours: change beyond either end of a ramp, over half its width, in shares of its jump


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


@njit(cache=True, nogil=True, error_model="numpy")
def ramps(
    inverse: np.ndarray,
    off: np.ndarray,
    reach: int,
    slant_x: float,
    slant_y: float,
    found: np.ndarray,
) -> None:
    """Smooth ramps between two surfaces, about twice `reach` px wide.

    Args:
        inverse: (h, w) inverse depth, 1/m; NaN without.
        off: (h, w) least distance from the middle of a ramp to either end, m.
        reach: From the middle of a ramp to its ends, px, even.
        slant_x, slant_y: Least change from end to end, per pixel, as a share of the inverse depth.
        found: (h, w) pixels of ramps are set.
    """
    height, width = inverse.shape
    steep = np.empty(width, np.bool_)
    for axis in range(2):
        du, dv = reach * (1 - axis), reach * axis
        least = np.float32(reach * (slant_y if axis else slant_x))
        for v in range(2 * dv, height - 2 * dv):
            one, other = inverse[v - dv, du : width - 2 * du], inverse[v + dv, 3 * du :]
            for u in range(width - 4 * du):  # few pass: the rest is not looked at
                steep[u] = abs(other[u] - one[u]) > least * (other[u] + one[u])
            for u in range(width - 4 * du):
                if steep[u] and _is_ramp(inverse, off, v, u + 2 * du, dv, du):
                    for k in range(1 - reach, reach):
                        found[v + k * axis, u + 2 * du + k * (1 - axis)] = True


@njit(cache=True, nogil=True, error_model="numpy")
def _is_ramp(inverse: np.ndarray, off: np.ndarray, v: int, u: int, dv: int, du: int) -> bool:
    """Whether inverse depth changes in four even steps between two ends `dv`, `du` away, and hardly beyond them.

    That of a plane is linear in the image, however it slants; on an edge one step is all of the jump.
    """
    one, other = inverse[v - dv, u - du], inverse[v + dv, u + du]
    middle, jump = inverse[v, u], other - one
    before, after = inverse[v - dv // 2, u - du // 2], inverse[v + dv // 2, u + du // 2]
    for step in (before - one, middle - before, after - middle, other - after):
        if not LEAST_STEP < step / jump < MOST_STEP:
            return False
    z = 1.0 / middle
    if not min(abs(z - 1.0 / one), abs(z - 1.0 / other)) > off[v, u]:
        return False
    beyond = inverse[v + 2 * dv, u + 2 * du] - other, one - inverse[v - 2 * dv, u - 2 * du]
    return abs(beyond[0] / jump) < FLAT and abs(beyond[1] / jump) < FLAT
