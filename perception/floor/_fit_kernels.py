"""Compiled loops over all points: the last fit, what its covariance needs, and the classes.

Arrays and scalars only; every input is finite. The fit is in inverse depth, as in `_search_kernels`.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

FREE_SUMS = {"reassoc", "contract", "nsz"}  # sums may be vectorised; nothing assumes finite values
GRAIN = 12.0  # image cells for correlated noise per unit of ray slope: about 5 deg
SPAN = 2.0  # ray slopes beyond this share the outermost cell
CELLS = 48  # 2 SPAN GRAIN
SECTORS = 720  # directions on the ground in which feet are looked for: half a degree
RING_M = 0.025  # grain of distance on the ground
RINGS = 256
PLAN = 256  # cells along a side of the ground plan in which feet are looked for


@njit(cache=True)
def open_ground(
    xyz: np.ndarray,
    sigma: np.ndarray,
    n: np.ndarray,
    rho: float,
    first: np.ndarray,
    second: np.ndarray,
    base: float,
    sigmas: float,
    top: float,
    cell_m: float,
    is_open: np.ndarray,
) -> None:
    """Tell the feet of walls and boxes from the floor: points that have others straight above them.

    On a plan of the ground round the camera, a cell is taken if at least two points in it lie between
    2 tau and `top` above the plane.

    Args:
        is_open: (n,) bool, overwritten: whether the point's cell is free.
    """
    taken = np.zeros(PLAN * PLAN, np.int32)
    per_m, middle = 1.0 / cell_m, PLAN / 2.0
    count = xyz.shape[0]
    for i in range(count):
        x, y, z = xyz[i, 0], xyz[i, 1], xyz[i, 2]
        d = n[0] * x + n[1] * y + n[2] * z + rho
        if d > top or d * z < 2.0 * (base * z + sigmas * sigma[i] * rho):
            continue
        u = (first[0] * x + first[1] * y + first[2] * z) * per_m + middle
        v = (second[0] * x + second[1] * y + second[2] * z) * per_m + middle
        if 0.0 <= u < PLAN and 0.0 <= v < PLAN:
            taken[int(v) * PLAN + int(u)] += 1
    for i in range(count):
        x, y, z = xyz[i, 0], xyz[i, 1], xyz[i, 2]
        d = n[0] * x + n[1] * y + n[2] * z + rho
        is_open[i] = True
        if abs(d) > top:
            continue
        u = (first[0] * x + first[1] * y + first[2] * z) * per_m + middle
        v = (second[0] * x + second[1] * y + second[2] * z) * per_m + middle
        if 0.0 <= u < PLAN and 0.0 <= v < PLAN:
            is_open[i] = taken[int(v) * PLAN + int(u)] < 2


@njit(cache=True, fastmath=FREE_SUMS)
def moments(
    xyz: np.ndarray,
    sigma: np.ndarray,
    is_open: np.ndarray,
    n: np.ndarray,
    rho: float,
    sigmas: float,
    rough: float,
    A: np.ndarray,
    g: np.ndarray,
) -> int:
    """Normal equations A da = g in inverse depth of the open points near a plane; how many they are.

    A point is near if its distance d is within `sigmas` deviations, and weighs 1 / variance of its inverse
    depth: depth noise, and `rough` of the floor itself. With r = p / z and 1/z - a.r = d / (rho z) all
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
        inside = is_open[i] and d * d * z2 < limit * variance
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


@njit(cache=True)
def statistics(
    xyz: np.ndarray,
    sigma: np.ndarray,
    is_open: np.ndarray,
    n: np.ndarray,
    rho: float,
    base: float,
    sigmas: float,
    narrow: float,
    rough: float,
    A: np.ndarray,
    g: np.ndarray,
    B: np.ndarray,
    C: np.ndarray,
    D: np.ndarray,
) -> tuple[int, int, int]:
    """The normal equations once more, with what the covariance needs and with what lies below.

    Args:
        A, g: (3, 3), (3,), as in `moments`, filled.
        B: (3, 3), sum over image cells of the outer product of the cell's gradient, filled: equals A in
            the mean where the noise of neighbours is independent, and is larger where it is not.
        C: (3, 3), sum of w r r^T / z, filled: the answer to an error of depth scale.
        D: (3, 3), sum of w r r^T s, filled, s the point's deviation in inverse depth: the answer to an
            error of one deviation that all points share.

    Returns:
        Points within tau = base + sigmas * noise, points below -2 tau, image cells that were used.
    """
    a, b, c = n[0], n[1], n[2]
    ground = (rough / rho) ** 2
    limit = (narrow * rho) ** 2
    cells = np.zeros((CELLS * CELLS, 4))
    A[:], B[:], C[:], D[:], g[:] = 0.0, 0.0, 0.0, 0.0, 0.0
    near = below = 0
    for i in range(xyz.shape[0]):
        x, y, z = xyz[i, 0], xyz[i, 1], xyz[i, 2]
        d = a * x + b * y + c * z + rho
        tau_z = base * z + sigmas * sigma[i] * rho
        below += d * z < -2.0 * tau_z
        near += abs(d) * z < tau_z
        z2 = z * z
        variance = sigma[i] * sigma[i] + ground * z2
        if not is_open[i] or d * d * z2 >= limit * variance:
            continue
        W = z2 / variance
        q = 1.0 / z
        wx, wy, wz = W * x, W * y, W * z
        C[0, 0] += wx * x * q
        C[0, 1] += wx * y * q
        C[0, 2] += wx
        C[1, 1] += wy * y * q
        C[1, 2] += wy
        C[2, 2] += wz
        share = sigma[i] * q * q
        D[0, 0] += wx * x * share
        D[0, 1] += wx * y * share
        D[0, 2] += wx * z * share
        D[1, 1] += wy * y * share
        D[1, 2] += wy * z * share
        D[2, 2] += wz * z * share
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
            A[j, k], C[j, k], D[j, k] = A[k, j], C[k, j], D[k, j]
    return near, below, used


@njit(cache=True)
def classes(
    xyz: np.ndarray,
    sigma: np.ndarray,
    n: np.ndarray,
    rho: float,
    first: np.ndarray,
    second: np.ndarray,
    P: np.ndarray,
    base: float,
    sigmas: float,
    top: float,
    labels: np.ndarray,
    taus: np.ndarray,
) -> None:
    """Label each point: 0 floor, 1 obstacle, 2 hole, 3 overhang.

    Args:
        P: (3, 3) covariance of the plane (tilt about `first`, tilt about `second`, offset).
        labels: (n,) int8, overwritten.
        taus: (n,), half the band of the floor at each point, overwritten.
    """
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


@njit(cache=True)
def sector(s: float, t: float) -> int:
    """Number of a direction on the ground; quarters of a diamond in place of angles."""
    p = s / (abs(s) + abs(t) + 1e-12)
    return int((1.0 - p if t >= 0.0 else 3.0 + p) * (SECTORS / 4)) % SECTORS


@njit(cache=True)
def feet(
    xyz: np.ndarray,
    n: np.ndarray,
    rho: float,
    first: np.ndarray,
    second: np.ndarray,
    tau: np.ndarray,
    foot_m: float,
    least: int,
    labels: np.ndarray,
) -> None:
    """Take the feet of things out of the floor: what lies within tau but behind the front of a thing.

    A ray that reaches the floor at distance G on the ground passes a front at distance R at the height
    rho (1 - R / G). If there is a front that rises in the same direction, and that height is within its
    foot, the floor there is hidden, and what was seen is the foot.

    Args:
        tau: (n,), half the band of the floor at each point.
        foot_m: Fronts are looked for from 2 tau, which noise does not reach, to so much above.
        least: Points that make a front.
        labels: (n,) int8 as `classes` has them; some 0 become 1.
    """
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
        if fronts[k, RINGS] < least:
            continue
        ground = math.sqrt(s * s + t * t) * rho / drop
        nearest = ground * (1.0 - 1.5 * tau[i] / rho)
        last = ground * (1.0 - 0.2 * tau[i] / rho)
        r0 = min(max(int(nearest / RING_M), 0), RINGS)
        r1 = min(max(int(last / RING_M + 0.5), r0), RINGS)
        r2 = min(2 * r1 - r0, RINGS)
        before = fronts[k, r1] - fronts[k, r0]
        if before >= least and before >= fronts[k, r2] - fronts[k, r1]:
            labels[i] = 1
