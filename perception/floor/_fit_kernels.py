"""Compiled loops over all points: the final fit, the terms of its covariance, and the classes.

Every input is finite. The fit is in inverse depth, as in `_search_kernels`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..primitives.compiled import njit

FREE_SUMS = {"reassoc", "contract", "nsz"}  # allows vectorised sums
GRAIN = 12.0  # image cells per unit of ray slope, for correlated noise: about 5 deg
SPAN = 2.0  # larger ray slopes share the outermost cells
BELOW_BENDS = 3.0  # ours: the bend at the corners of an image is up to 2.4 times that at its centre
CELLS = 48  # 2 SPAN GRAIN
SECTORS = 720  # directions on the ground in which obstacle fronts are counted: half a degree
RING_M = 0.025  # resolution of distance on the ground
RINGS = 256
PLAN = 256  # cells along a side of the ground plan
FOOT_CELL_M = 0.05  # ours: side of these cells; the foot of a wall reaches this far through noise
FRONT_POINTS = 3  # ours: points in a sector that make an obstacle front


class Ground(NamedTuple):
    """A floor plane: normal and offset, and two directions on it."""

    n: np.ndarray
    rho: float
    first: np.ndarray
    second: np.ndarray


@njit(cache=True, nogil=True)
def open_ground(
    xyz: np.ndarray,
    sigma: np.ndarray,
    ground: Ground,
    base: float,
    sigmas: float,
    top: float,
    is_open: np.ndarray,
) -> None:
    """Separate the feet of walls and boxes from the floor: points with other points straight above them.

    On a plan of the ground about the camera, a cell is occupied if at least two of its points lie between
    2 tau and `top` above the plane.

    Args:
        xyz, sigma: (n, 3) and (n,), points and their depth noise.
        ground: The floor plane.
        base, sigmas: Of tau = base + sigmas * noise.
        top: m.
        is_open: (n,) bool, written: whether the cell of a point is not occupied.
    """
    n, rho, first, second = ground
    occupied = np.zeros(PLAN * PLAN, np.int32)
    per_m, middle = 1.0 / FOOT_CELL_M, PLAN / 2.0
    count = xyz.shape[0]
    for i in range(count):
        x, y, z = xyz[i, 0], xyz[i, 1], xyz[i, 2]
        d = n[0] * x + n[1] * y + n[2] * z + rho
        if d > top or d * z < 2.0 * (base * z + sigmas * sigma[i] * rho):
            continue
        u = (first[0] * x + first[1] * y + first[2] * z) * per_m + middle
        v = (second[0] * x + second[1] * y + second[2] * z) * per_m + middle
        if 0.0 <= u < PLAN and 0.0 <= v < PLAN:
            occupied[int(v) * PLAN + int(u)] += 1
    for i in range(count):
        x, y, z = xyz[i, 0], xyz[i, 1], xyz[i, 2]
        d = n[0] * x + n[1] * y + n[2] * z + rho
        is_open[i] = True
        if abs(d) > top:
            continue
        u = (first[0] * x + first[1] * y + first[2] * z) * per_m + middle
        v = (second[0] * x + second[1] * y + second[2] * z) * per_m + middle
        if 0.0 <= u < PLAN and 0.0 <= v < PLAN:
            is_open[i] = occupied[int(v) * PLAN + int(u)] < 2


@njit(cache=True, nogil=True)
def widest_slope(xyz: np.ndarray) -> float:
    """Largest |x / z| of points (n, 3)."""
    widest = 0.0
    for i in range(xyz.shape[0]):
        widest = max(widest, abs(xyz[i, 0] / xyz[i, 2]))
    return widest


@njit(cache=True, nogil=True, fastmath=FREE_SUMS)
def moments(
    xyz: np.ndarray,
    sigma: np.ndarray,
    is_open: np.ndarray,
    n: np.ndarray,
    rho: float,
    bend: np.ndarray,
    sigmas: float,
    rough: float,
    A: np.ndarray,
    g: np.ndarray,
) -> int:
    """Normal equations A da = g in inverse depth of the open points near a plane; their number.

    A point is near if its distance d is within `sigmas` standard deviations of noise, roughness and bend; without the bend
    only a part of a bent floor would take part, and look flat. It weighs 1 / variance of its
    inverse depth: depth noise, and the roughness `rough` of the floor, m. With r = p / z and 1/z - a.r = d / (rho z) all
    sums are those of p p^T and p d with the weight W = z^2 / (sigma^2 + (rough z / rho)^2).
    """
    a, b, c = n[0], n[1], n[2]
    ground = (rough / rho) ** 2
    limit = (sigmas * rho) ** 2
    s00 = s01 = s02 = s11 = s12 = s22 = g0 = g1 = g2 = 0.0
    count = 0
    for i in range(xyz.shape[0]):
        x, y, z = xyz[i, 0], xyz[i, 1], xyz[i, 2]
        d = a * x + b * y + c * z + rho
        z2 = z * z
        variance = sigma[i] * sigma[i] + ground * z2
        inside = is_open[i] and d * d * z2 < limit * (variance + bend[i] * bend[i] * z2)
        W = z2 / variance if inside else 0.0
        count += inside
        wx, wy, wz = W * x, W * y, W * z
        s00 += wx * x
        s01 += wx * y
        s02 += wx * z
        s11 += wy * y
        s12 += wy * z
        s22 += wz * z
        g0 += wx * d
        g1 += wy * d
        g2 += wz * d
    A[0, 0], A[0, 1], A[0, 2] = s00, s01, s02
    A[1, 0], A[1, 1], A[1, 2] = s01, s11, s12
    A[2, 0], A[2, 1], A[2, 2] = s02, s12, s22
    g[0], g[1], g[2] = g0 / rho, g1 / rho, g2 / rho
    return count


@njit(cache=True, nogil=True)  # long: one pass over the points for all sums
def statistics(
    xyz: np.ndarray,
    sigma: np.ndarray,
    is_open: np.ndarray,
    n: np.ndarray,
    rho: float,
    bend: np.ndarray,
    base: float,
    sigmas: float,
    narrow: float,
    sharp: float,
    rough: float,
    A: np.ndarray,
    g: np.ndarray,
    B: np.ndarray,
    cells: np.ndarray,
) -> tuple[int, int, int, int]:
    """The normal equations as in `moments`, the terms of the covariance, and the number of points below.

    Args:
        bend: (n,) relative distortion of depth of each point, one standard deviation.
        A, g: (3, 3), (3,), written, as in `moments`.
        B: (3, 3), written: sum over image cells of the outer product of the cell's gradient. Its expectation
            is A where the noise of neighbours is independent, and larger where it is correlated.
        cells: (CELLS^2, 9), zeros, written: sums over the points of each image cell, with the weight w of inverse
            depth: gradient (3), number, w r (3), w / z, w sigma / z^2.

    Returns:
        Points within tau = base + sigmas * noise, those within tau / sharp, points below -2 tau and the bend, image cells with points.
    """
    a, b, c = n[0], n[1], n[2]
    ground = (rough / rho) ** 2
    limit = (narrow * rho) ** 2
    A[:], B[:], g[:] = 0.0, 0.0, 0.0
    near = core = below = 0
    for i in range(xyz.shape[0]):
        x, y, z = xyz[i, 0], xyz[i, 1], xyz[i, 2]
        d = a * x + b * y + c * z + rho
        tau_z = base * z + sigmas * sigma[i] * rho
        below += d * z < -2.0 * tau_z - BELOW_BENDS * bend[i] * rho * z
        near += abs(d) * z < tau_z
        core += sharp * abs(d) * z < tau_z
        z2 = z * z
        variance = sigma[i] * sigma[i] + ground * z2
        if not is_open[i] or d * d * z2 >= limit * (variance + bend[i] * bend[i] * z2):
            continue
        W = z2 / variance
        q = 1.0 / z
        wx, wy, wz = W * x, W * y, W * z
        A[0, 0] += wx * x
        A[0, 1] += wx * y
        A[0, 2] += wx * z
        A[1, 1] += wy * y
        A[1, 2] += wy * z
        A[2, 2] += wz * z
        column = int(min(max((x * q + SPAN) * GRAIN, 0.0), CELLS - 1.0))
        row = int(min(max((y * q + SPAN) * GRAIN, 0.0), CELLS - 1.0))
        cell = row * CELLS + column
        cells[cell, 0] += wx * d
        cells[cell, 1] += wy * d
        cells[cell, 2] += wz * d
        cells[cell, 3] += 1.0
        cells[cell, 4] += wx * z
        cells[cell, 5] += wy * z
        cells[cell, 6] += wz * z
        cells[cell, 7] += wz
        cells[cell, 8] += W * sigma[i]
    used = 0
    for cell in range(CELLS * CELLS):
        if cells[cell, 3] > 0.0:
            used += 1
            for j in range(3):
                g[j] += cells[cell, j] / rho
                for k in range(3):
                    B[j, k] += cells[cell, j] * cells[cell, k] / (rho * rho)
    for j in range(3):
        for k in range(j):
            A[j, k] = A[k, j]
    return near, core, below, used


@njit(cache=True, nogil=True)
def classes(
    xyz: np.ndarray,
    sigma: np.ndarray,
    ground: Ground,
    P: np.ndarray,
    base: float,
    sigmas: float,
    top: float,
    labels: np.ndarray,
    taus: np.ndarray,
) -> None:
    """Label each point: 0 floor, 1 obstacle, 2 hole, 3 overhang.

    Args:
        xyz, sigma: (n, 3) and (n,), points and their depth noise.
        ground, P: The floor plane and its covariance (3, 3): tilt about `first`, about `second`, offset.
        base, sigmas: Of the threshold tau = base + sigmas * standard deviation of height.
        top: Height from which a point is overhang, m.
        labels: (n,) int8, written.
        taus: (n,), tau of each point, written.
    """
    n, rho, first, second = ground
    for i in range(xyz.shape[0]):
        x, y, z = xyz[i, 0], xyz[i, 1], xyz[i, 2]
        d = n[0] * x + n[1] * y + n[2] * z + rho
        noise = sigma[i] * rho / z
        s = first[0] * x + first[1] * y + first[2] * z
        t = second[0] * x + second[1] * y + second[2] * z
        plane = (
            P[0, 0] * s * s
            + P[1, 1] * t * t
            + P[2, 2]
            + 2.0 * (P[0, 1] * s * t + P[0, 2] * s + P[1, 2] * t)
        )
        tau = base + sigmas * math.sqrt(noise * noise + max(plane, 0.0))
        taus[i] = tau
        if d > top:
            labels[i] = 3
        elif d > tau:
            labels[i] = 1
        elif d < -tau:
            labels[i] = 2
        else:
            labels[i] = 0


@njit(cache=True, nogil=True)
def sector(s: float, t: float) -> int:
    """Index of a direction on the ground; a diamond instead of a circle avoids the arc tangent."""
    p = s / (abs(s) + abs(t) + 1e-12)
    return int((1.0 - p if t >= 0.0 else 3.0 + p) * (SECTORS / 4)) % SECTORS


@njit(cache=True, nogil=True)
def feet(
    xyz: np.ndarray, ground: Ground, tau: np.ndarray, foot_m: float, labels: np.ndarray
) -> None:
    """Relabel the feet of obstacles, which lie within tau of the floor, from floor to obstacle.

    A ray that meets the floor at ground distance G passes a front at distance R at the height rho (1 - R / G).
    If there is an obstacle front in the same direction, and that height is within its foot, the floor behind
    is occluded and the point belongs to the foot.

    Args:
        xyz, ground: (n, 3) points, floor plane.
        tau: (n,), from `classes`.
        foot_m: Fronts are counted from 2 tau, which noise does not reach, to this much above.
        labels: (n,) int8 from `classes`; some 0 become 1.
    """
    n, rho, first, second = ground
    fronts = np.zeros((SECTORS, RINGS + 1), np.int32)
    count = xyz.shape[0]
    for i in range(count):
        if labels[i] != 1:
            continue
        x, y, z = xyz[i, 0], xyz[i, 1], xyz[i, 2]
        d = n[0] * x + n[1] * y + n[2] * z + rho
        if d < 2.0 * tau[i] or d > 2.0 * tau[i] + foot_m:
            continue
        s = first[0] * x + first[1] * y + first[2] * z
        t = second[0] * x + second[1] * y + second[2] * z
        ring = int(math.sqrt(s * s + t * t) / RING_M)
        if ring < RINGS:
            fronts[sector(s, t), ring + 1] += 1
    for k in range(SECTORS):
        for ring in range(RINGS):
            fronts[k, ring + 1] += fronts[k, ring]
    for i in range(count):
        if labels[i] != 0 or tau[i] > 0.5 * rho:
            continue
        x, y, z = xyz[i, 0], xyz[i, 1], xyz[i, 2]
        drop = -(n[0] * x + n[1] * y + n[2] * z)  # rho on the plane itself
        if drop <= 1e-9:
            continue
        s = first[0] * x + first[1] * y + first[2] * z
        t = second[0] * x + second[1] * y + second[2] * z
        k = sector(s, t)
        if fronts[k, RINGS] < FRONT_POINTS:
            continue
        ground = math.sqrt(s * s + t * t) * rho / drop
        nearest = ground * (1.0 - 1.5 * tau[i] / rho)
        last = ground * (1.0 - 0.2 * tau[i] / rho)
        r0 = min(max(int(nearest / RING_M), 0), RINGS)
        r1 = min(max(int(last / RING_M + 0.5), r0), RINGS)
        r2 = min(2 * r1 - r0, RINGS)
        before = fronts[k, r1] - fronts[k, r0]
        if before >= FRONT_POINTS and before >= fronts[k, r2] - fronts[k, r1]:
            labels[i] = 1
