"""Compiled inner loops of the plane search: triples to planes, votes, costs."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True)
def _through(points, i, j, k, up):  # type: ignore[no-untyped-def]
    """Plane through three points, normal towards up: nx, ny, nz, rho, area; area 0 if degenerate."""
    ax, ay, az = points[i]
    bx, by, bz = points[j, 0] - ax, points[j, 1] - ay, points[j, 2] - az
    cx, cy, cz = points[k, 0] - ax, points[k, 1] - ay, points[k, 2] - az
    nx, ny, nz = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
    area = math.sqrt(nx * nx + ny * ny + nz * nz)
    if area < 1e-4:  # m^2: nearly on a line
        return 0.0, 0.0, 0.0, 0.0, 0.0
    if nx * up[0] + ny * up[1] + nz * up[2] < 0.0:
        area = -area
    nx, ny, nz = nx / area, ny / area, nz / area
    return nx, ny, nz, -(nx * ax + ny * ay + nz * az), abs(area)


@njit(cache=True)
def msac(points, tau, triples, up, cos_gate, lowest, highest):  # type: ignore[no-untyped-def]
    """The plane through one of the triples with the least truncated squared cost.

    points (m, 3), tau (m,) inlier bounds, triples (k, 3) indices, up (3,), offsets within
    [lowest, highest]. Returns (nx, ny, nz, rho, cost); cost m where no triple passes the gates.
    """
    m = len(points)
    best = (0.0, 0.0, 0.0, 0.0, float(m))
    for t in range(len(triples)):
        nx, ny, nz, rho, area = _through(points, triples[t, 0], triples[t, 1], triples[t, 2], up)
        if area == 0.0 or nx * up[0] + ny * up[1] + nz * up[2] < cos_gate:
            continue
        if rho < lowest or rho > highest:
            continue
        cost = 0.0
        for i in range(m):
            d = (nx * points[i, 0] + ny * points[i, 1] + nz * points[i, 2] + rho) / tau[i]
            cost += min(d * d, 1.0)
            if cost >= best[4]:
                break
        if cost < best[4]:
            best = (nx, ny, nz, rho, cost)
    return best


@njit(cache=True)
def hough(  # type: ignore[no-untyped-def]
    points, triples, up, across, cos_gate, lowest, highest, tilt_bin, offset_bin, enough
):
    """Randomised Hough transform over (two tilts about up, offset), cells of tilt_bin rad, offset_bin m.

    across (2, 3): the axes the tilts are counted along. Stops when a cell has `enough` votes.
    Returns (nx, ny, nz, rho, votes) as the mean of the winning cell, votes 0 if there is none.
    """
    gate = math.acos(cos_gate)
    side = 2 * int(math.ceil(gate / tilt_bin)) + 1
    levels = int(math.ceil((highest - lowest) / offset_bin)) + 1
    votes = np.zeros((side, side, levels), np.int32)
    sums = np.zeros((side, side, levels, 3))
    most, win = 0, (0, 0, 0)
    for t in range(len(triples)):
        nx, ny, nz, rho, area = _through(points, triples[t, 0], triples[t, 1], triples[t, 2], up)
        cosine = nx * up[0] + ny * up[1] + nz * up[2]
        if area == 0.0 or cosine < cos_gate or rho < lowest or rho > highest:
            continue
        first = nx * across[0, 0] + ny * across[0, 1] + nz * across[0, 2]
        second = nx * across[1, 0] + ny * across[1, 1] + nz * across[1, 2]
        length = math.sqrt(first * first + second * second)
        angle = math.atan2(length, cosine)
        scale = angle / length if length > 1e-12 else 1.0
        first, second = first * scale, second * scale
        i = int(math.floor(first / tilt_bin + 0.5)) + side // 2
        j = int(math.floor(second / tilt_bin + 0.5)) + side // 2
        k = int((rho - lowest) / offset_bin)
        i, j = min(max(i, 0), side - 1), min(max(j, 0), side - 1)
        votes[i, j, k] += 1
        sums[i, j, k, 0] += first
        sums[i, j, k, 1] += second
        sums[i, j, k, 2] += rho
        if votes[i, j, k] > most:
            most, win = votes[i, j, k], (i, j, k)
            if most >= enough:
                break
    if most == 0:
        return 0.0, 0.0, 0.0, 0.0, 0
    first, second, rho = sums[win] / most
    angle = math.sqrt(first * first + second * second)
    sine = math.sin(angle) / angle if angle > 1e-12 else 1.0
    n = math.cos(angle) * up + sine * (first * across[0] + second * across[1])
    return n[0], n[1], n[2], rho, most


@njit(cache=True)
def truncated_cost(points, tau, n, rho):  # type: ignore[no-untyped-def]
    """MSAC cost of one plane: sum of min((distance / tau)^2, 1)."""
    cost = 0.0
    for i in range(len(points)):
        d = (n[0] * points[i, 0] + n[1] * points[i, 1] + n[2] * points[i, 2] + rho) / tau[i]
        cost += min(d * d, 1.0)
    return cost


@njit(cache=True)
def normal_equations(points, sigma, n, rho, t0, t1, own, reach):  # type: ignore[no-untyped-def]
    """Sums of the weighted fit of (tilt, tilt, offset) to the points within `reach` deviations.

    sigma (m,) of z; the deviation of a distance is sigma |n.p| / z joined with `own` (m). Returns the
    (3, 3) matrix, the (3,) right-hand side, the sum of squares and the number of points.
    """
    A = np.zeros((3, 3))
    b = np.zeros(3)
    total, count = 0.0, 0
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        height = n[0] * x + n[1] * y + n[2] * z
        distance = height + rho
        deviation2 = (sigma[i] * height / z) ** 2 + own * own
        if distance * distance > reach * reach * deviation2:
            continue
        j0 = t0[0] * x + t0[1] * y + t0[2] * z
        j1 = t1[0] * x + t1[1] * y + t1[2] * z
        w = 1.0 / deviation2
        A[0, 0] += w * j0 * j0
        A[0, 1] += w * j0 * j1
        A[0, 2] += w * j0
        A[1, 1] += w * j1 * j1
        A[1, 2] += w * j1
        A[2, 2] += w
        b[0] -= w * j0 * distance
        b[1] -= w * j1 * distance
        b[2] -= w * distance
        total += w * distance * distance
        count += 1
    A[1, 0], A[2, 0], A[2, 1] = A[0, 1], A[0, 2], A[1, 2]
    return A, b, total, count
