"""Descriptors: 4 x 4 histograms of 8 directions around a keypoint, on a grid with its orientation and scale.

The sampling distance of the grid, 0.75 sigma, follows the blur of the image, so the shares of a sample in the
neighbouring bins are the same for every keypoint and are tabulated.
"""

from __future__ import annotations

import math

import numpy as np

from ..primitives.compiled import njit
from ._orientation_kernels import angles

ACROSS = 4  # spatial bins along each side
TURNS = 8  # bins of direction
STRIDE = TURNS + 1  # of spatial bins: the last direction is the first again
PER_BIN = 4  # samples a bin along each axis
SIDE = (ACROSS + 1) * PER_BIN  # samples along each side of the grid
CELL_SIGMAS = 3.0  # side of a spatial bin, in sigmas of the keypoint
CLIP = 0.2


def tables() -> tuple[np.ndarray, np.ndarray]:
    """Bin of each sample of an axis (0 is outside, half a bin before the first), and its share in the next bin."""
    place = (np.arange(SIDE) + 0.5) / PER_BIN
    first = np.floor(place).astype(np.int64)
    return first, (place - first).astype(np.float32)


FIRST, SHARE = tables()
_OFF = (np.arange(SIDE) + 0.5) / PER_BIN - (ACROSS + 1) / 2.0
FALL = np.exp(-(_OFF[:, None] ** 2 + _OFF[None, :] ** 2) / (2.0 * (ACROSS / 2.0) ** 2)).astype(
    np.float32
)


@njit(cache=True, nogil=True)
def describe(
    levels: np.ndarray, points: np.ndarray, directions: np.ndarray, out: np.ndarray
) -> None:
    """Descriptors by differences of samples on each keypoint's grid.

    levels: (n, h, w). points: (m, 4) x, y, sigma in px of the octave, integer layer.
    directions: (m,), rad. out: (m, 128) float32, of unit length, largest entry about 0.2.
    """
    grey = np.empty((SIDE + 2, SIDE + 2), np.float32)
    gx = np.empty(SIDE * SIDE, np.float32)
    gy = np.empty_like(gx)
    for i in range(points.shape[0]):
        step = points[i, 2] * (CELL_SIGMAS / PER_BIN)
        c, s = math.cos(directions[i]) * step, math.sin(directions[i]) * step
        _sample(levels[int(points[i, 3])], points[i, 0], points[i, 1], c, s, grey)
        for a in range(SIDE):
            for b in range(SIDE):
                gx[a * SIDE + b] = grey[a + 1, b + 2] - grey[a + 1, b]
                gy[a * SIDE + b] = grey[a + 2, b + 1] - grey[a, b + 1]
        pool(gx, gy, out[i])


@njit(cache=True, nogil=True)
def describe_by_moments(
    fields_x: np.ndarray,
    fields_y: np.ndarray,
    points: np.ndarray,
    directions: np.ndarray,
    out: np.ndarray,
) -> None:
    """The same from gradients of whole levels, such as those by moments: (n, h, w) each."""
    field_x = np.empty((SIDE + 2, SIDE + 2), np.float32)
    field_y = np.empty_like(field_x)
    gx = np.empty(SIDE * SIDE, np.float32)
    gy = np.empty_like(gx)
    for i in range(points.shape[0]):
        step = points[i, 2] * (CELL_SIGMAS / PER_BIN)
        c, s = math.cos(directions[i]), math.sin(directions[i])
        layer = int(points[i, 3])
        x, y = points[i, 0], points[i, 1]
        _sample(fields_x[layer], x, y, c * step, s * step, field_x)
        _sample(fields_y[layer], x, y, c * step, s * step, field_y)
        for a in range(SIDE):
            for b in range(SIDE):
                fx, fy = field_x[a + 1, b + 1], field_y[a + 1, b + 1]
                gx[a * SIDE + b] = c * fx + s * fy
                gy[a * SIDE + b] = -s * fx + c * fy
        pool(gx, gy, out[i])


@njit(cache=True, nogil=True, fastmath=True)
def _sample(image: np.ndarray, x: float, y: float, c: float, s: float, grey: np.ndarray) -> None:
    """Interpolated values on a grid of steps (c, s) across and (-s, c) down around (x, y)."""
    height, width = image.shape
    middle, flat, across = np.float32((SIDE + 1) / 2.0), image.ravel(), np.uintp(width)
    for a in range(SIDE + 2):
        u0 = x - s * (a - middle) - c * middle
        v0 = y + c * (a - middle) - s * middle
        for b in range(SIDE + 2):
            u = min(max(u0 + c * b, 0.0), width - 1.001)
            v = min(max(v0 + s * b, 0.0), height - 1.001)
            left, top = int(u), int(v)
            du, dv = np.float32(u - left), np.float32(v - top)
            at = np.uintp(top) * across + np.uintp(left)
            p, q = flat[at], flat[at + np.uintp(1)]
            t, w = flat[at + across], flat[at + across + np.uintp(1)]
            upper, lower = p + du * (q - p), t + du * (w - t)
            grey[a, b] = upper + dv * (lower - upper)


@njit(cache=True, nogil=True, fastmath=True)
def pool(gx: np.ndarray, gy: np.ndarray, out: np.ndarray) -> None:
    """Histograms of the gradients of one grid, clipped and of unit length."""
    angle, weights = np.empty(SIDE * SIDE, np.float32), np.empty(SIDE * SIDE, np.float32)
    bins = np.zeros((ACROSS + 2, (ACROSS + 2) * STRIDE), np.float32)
    line = np.empty((ACROSS + 2) * STRIDE, np.float32)  # histograms of one row of samples
    angles(gx, gy, SIDE * SIDE, angle)
    falls = FALL.ravel()
    for i in range(SIDE * SIDE):
        turn = angle[i] * np.float32(TURNS / (2.0 * math.pi))
        angle[i] = turn + np.float32(TURNS) if turn < 0 else turn
        weights[i] = falls[i] * np.sqrt(gx[i] * gx[i] + gy[i] * gy[i])
    for a in range(SIDE):
        line[:] = np.float32(0.0)
        for b in range(SIDE):
            turn, weight, right = angle[a * SIDE + b], weights[a * SIDE + b], SHARE[b]
            first = min(int(turn), TURNS - 1)
            later = (turn - first) * weight
            sooner = weight - later
            at = FIRST[b] * STRIDE + first
            line[at + STRIDE] += right * sooner
            line[at + STRIDE + 1] += right * later
            line[at] += sooner - right * sooner
            line[at + 1] += later - right * later
        upper, lower, down = bins[FIRST[a]], bins[FIRST[a] + 1], SHARE[a]
        for k in range(line.size):
            lower[k] += down * line[k]
            upper[k] += line[k] - down * line[k]
    square = np.float32(0.0)
    for a in range(ACROSS):
        for b in range(ACROSS):
            cell = bins[a + 1, (b + 1) * STRIDE :]
            cell[0] += cell[TURNS]
            for t in range(TURNS):
                out[(a * ACROSS + b) * TURNS + t] = cell[t]
                square += cell[t] * cell[t]
    limit = np.float32(CLIP) * np.sqrt(square)
    square = np.float32(0.0)
    for k in range(out.shape[0]):
        out[k] = min(out[k], limit)
        square += out[k] * out[k]
    scale = np.float32(1.0) / np.sqrt(max(square, np.float32(1e-20)))
    for k in range(out.shape[0]):
        out[k] *= scale
