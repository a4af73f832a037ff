"""Compiled loops of scan registration: points to fronts, fronts to correspondences, normal equations."""

from __future__ import annotations

import math

import numpy as np

from ..primitives.compiled import njit


@njit(cache=True)
def fronts(
    xy: np.ndarray,
    sigma: np.ndarray,
    origin: np.ndarray,
    bins: int,
    thickness: float,
    least: int,
    deepest_share: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Front of vertical surfaces, one point per bearing.

    At each bearing only the points in the densest range interval count; a vertical surface fills one, the top of a
    table does not.

    Args:
        xy: (n, 2), sigma: (n,), origin: (2,) of the sensor.
        bins: Number of bearings of a full circle.
        thickness: Of the interval, m.
        least: Points in it.
        deepest_share: Share of the points of a bearing that must lie in it.

    Returns:
        points (k, 2) in order of bearing, and the standard deviation (k,) of each along its ray.
    """
    n = xy.shape[0]
    ranges = np.empty(n)
    which = np.empty(n, np.int64)
    first = np.zeros(bins + 1, np.int64)
    for i in range(n):
        dx, dy = xy[i, 0] - origin[0], xy[i, 1] - origin[1]
        ranges[i] = math.hypot(dx, dy)
        b = int((math.atan2(dy, dx) / (2.0 * math.pi) + 0.5) * bins)
        which[i] = min(max(b, 0), bins - 1)
        first[which[i] + 1] += 1
    for b in range(bins):
        first[b + 1] += first[b]
    order = np.empty(n, np.int64)
    fill = first[:bins].copy()
    for i in range(n):
        order[fill[which[i]]] = i
        fill[which[i]] += 1
    points = np.empty((bins, 2))
    deviations = np.empty(bins)
    count = 0
    for b in range(bins):
        members = order[first[b] : first[b + 1]]
        if members.shape[0] < least:
            continue
        members = members[np.argsort(ranges[members])]
        best, begin, low = 0, 0, 0
        for high in range(members.shape[0]):
            while ranges[members[high]] - ranges[members[low]] > thickness:
                low += 1
            if high - low + 1 > best:
                best, begin = high - low + 1, low
        if best < least or best < deepest_share * members.shape[0]:
            continue
        x = y = weight = 0.0
        for i in members[begin : begin + best]:
            w = 1.0 / sigma[i] ** 2
            x += w * xy[i, 0]
            y += w * xy[i, 1]
            weight += w
        points[count, 0], points[count, 1] = x / weight, y / weight
        deviations[count] = 1.0 / math.sqrt(weight)
        count += 1
    return points[:count].copy(), deviations[:count].copy()


@njit(cache=True)
def normals(
    points: np.ndarray,
    origin: np.ndarray,
    radius: float,
    spacing: float,
    flatness: float,
    least: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Normal of each point from its neighbours in order of bearing; dense stretches are thinned out.

    Returns:
        index (m,) of the points kept, and their normals (m, 2), towards the sensor.
    """
    n = points.shape[0]
    kept = np.empty(n, np.int64)
    found = np.empty((n, 2))
    count = 0
    for i in range(n):
        if count > 0:
            last = kept[count - 1]
            gap = math.hypot(points[i, 0] - points[last, 0], points[i, 1] - points[last, 1])
            if gap < spacing:
                continue
        low = high = i
        while low > 0 and _near(points, low - 1, low, i, radius):
            low -= 1
        while high < n - 1 and _near(points, high + 1, high, i, radius):
            high += 1
        members = high - low + 1
        if members < least:
            continue
        mx = my = xx = xy = yy = 0.0
        for j in range(low, high + 1):
            mx += points[j, 0] / members
            my += points[j, 1] / members
        for j in range(low, high + 1):
            dx, dy = points[j, 0] - mx, points[j, 1] - my
            xx += dx * dx / members
            xy += dx * dy / members
            yy += dy * dy / members
        half, root = 0.5 * (xx + yy), math.hypot(0.5 * (xx - yy), xy)
        thin, long = max(half - root, 0.0), half + root
        if thin > flatness**2 or long < (0.25 * radius) ** 2:
            continue
        angle = 0.5 * math.atan2(2.0 * xy, xx - yy)  # of the long axis
        nx, ny = -math.sin(angle), math.cos(angle)
        if nx * (origin[0] - points[i, 0]) + ny * (origin[1] - points[i, 1]) < 0.0:
            nx, ny = -nx, -ny
        kept[count] = i
        found[count, 0], found[count, 1] = nx, ny
        count += 1
    return kept[:count].copy(), found[:count].copy()


@njit(cache=True)
def _near(points: np.ndarray, j: int, neighbour: int, i: int, radius: float) -> bool:
    step = math.hypot(points[j, 0] - points[neighbour, 0], points[j, 1] - points[neighbour, 1])
    away = math.hypot(points[j, 0] - points[i, 0], points[j, 1] - points[i, 1])
    return step < 0.6 * radius and away < radius


@njit(cache=True)
def correspondences(
    points: np.ndarray,
    directions: np.ndarray,
    map_points: np.ndarray,
    map_directions: np.ndarray,
    first: np.ndarray,
    gate: float,
    cosine: float,
    found: np.ndarray,
) -> None:
    """For every point and every keyframe the nearest point of that keyframe with a similar normal.

    Args:
        points, directions: (n, 2), world frame, with normals.
        map_points, map_directions: (m, 2), world frame, keyframe by keyframe.
        first: (k + 1,), rows of keyframe j are first[j] to first[j + 1].
        gate: Largest distance, m.
        cosine: Least cosine between the normals.
        found: (n, k), receives the row of the corresponding point, -1 where there is none.
    """
    for i in range(points.shape[0]):
        px, py = points[i, 0], points[i, 1]
        ux, uy = directions[i, 0], directions[i, 1]
        for j in range(first.shape[0] - 1):
            best, row = gate * gate, -1
            for r in range(first[j], first[j + 1]):
                dx, dy = map_points[r, 0] - px, map_points[r, 1] - py
                away = dx * dx + dy * dy
                if away < best and ux * map_directions[r, 0] + uy * map_directions[r, 1] > cosine:
                    best, row = away, r
            found[i, j] = row


@njit(cache=True)
def accumulate(
    points: np.ndarray,
    sigmas: np.ndarray,
    now: np.ndarray,
    map_points: np.ndarray,
    map_directions: np.ndarray,
    map_sigmas: np.ndarray,
    poses: np.ndarray,
    found: np.ndarray,
    cut: float,
    A: np.ndarray,
    b: np.ndarray,
) -> tuple[int, float]:
    """Normal equations of the distances along the normals of the corresponding points.

    Unknown are the current pose and those of the k keyframes, (x, y, yaw) each, in this order.

    Args:
        points: (n, 2), world frame by the current pose; sigmas: (n,).
        now: (3,), the current pose.
        map_points, map_directions, map_sigmas: As in `correspondences`.
        poses: (k, 3), of the keyframes.
        found: (n, k), correspondences.
        cut: Residual, in standard deviations, of half weight (Cauchy).
        A, b: (3 + 3 k, 3 + 3 k) and (3 + 3 k,), receive J^T W J and -J^T W r.

    Returns:
        Number of points with a correspondence, and the weighted mean of their squared residuals.
    """
    A[:] = 0.0
    b[:] = 0.0
    J = np.empty(6)
    rows = np.empty(6, np.int64)
    used, total, weights = 0, 0.0, 0.0
    for i in range(points.shape[0]):
        matches = 0
        for j in range(found.shape[1]):
            if found[i, j] >= 0:
                matches += 1
        if matches == 0:
            continue
        used += 1
        for j in range(found.shape[1]):
            r = found[i, j]
            if r < 0:
                continue
            nx, ny = map_directions[r, 0], map_directions[r, 1]
            dx, dy = points[i, 0] - map_points[r, 0], points[i, 1] - map_points[r, 1]
            residual = nx * dx + ny * dy
            variance = sigmas[i] ** 2 + map_sigmas[r] ** 2
            w = 1.0 / (variance * matches)
            w /= 1.0 + residual * residual / (variance * cut * cut)
            ax, ay = points[i, 0] - now[0], points[i, 1] - now[1]
            mx, my = points[i, 0] - poses[j, 0], points[i, 1] - poses[j, 1]
            J[0], J[1], J[2] = nx, ny, ny * ax - nx * ay
            J[3], J[4], J[5] = -nx, -ny, -(ny * mx - nx * my)
            for c in range(3):
                rows[c], rows[3 + c] = c, 3 + 3 * j + c
            for a in range(6):
                b[rows[a]] -= w * J[a] * residual
                for c in range(6):
                    A[rows[a], rows[c]] += w * J[a] * J[c]
            total += w * residual * residual
            weights += w
    return used, total / max(weights, 1e-12)


@njit(cache=True)
def nearness(
    cells: np.ndarray,
    sector: np.ndarray,
    moves: np.ndarray,
    near: np.ndarray,
    known: np.ndarray,
    mean_near: np.ndarray,
    mean_known: np.ndarray,
) -> None:
    """How well points lie on the surfaces of a raster, after each of some moves.

    Args:
        cells: (n, 2), places of the points in the raster.
        sector: (n,), direction of the surface that each belongs to.
        moves: (m, 2), cells.
        near: (s, h, w), nearness of each cell to a surface of each direction.
        known: (h, w), whether a cell was in view; outside the raster none was, and no surface is near.
        mean_near, mean_known: (m,), receive the means over the points.
    """
    rows, columns = known.shape
    for j in range(moves.shape[0]):
        close, seen = 0.0, 0
        for i in range(cells.shape[0]):
            row = math.floor(cells[i, 0] + moves[j, 0] + 0.5)
            column = math.floor(cells[i, 1] + moves[j, 1] + 0.5)
            if 0 <= row < rows and 0 <= column < columns:
                close += near[sector[i], row, column]
                seen += known[row, column]
        mean_near[j] = close / cells.shape[0]
        mean_known[j] = seen / cells.shape[0]
