"""Compiled loops of scan registration: from points to edges, from edges to their partners."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True)
def edges(
    xy: np.ndarray,
    sigma: np.ndarray,
    origin: np.ndarray,
    bins: int,
    thickness: float,
    least: int,
    deepest_share: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Front of what rises from the floor, one place a bearing.

    Of the points in one direction those count that lie in the densest layer of some thickness; an upright
    surface fills one, a table's top does not.

    Args:
        xy: (n, 2), sigma: (n,), origin: (2,) of the sensor.
        bins: How many bearings make a full circle.
        thickness: Of a layer, m.
        least: Points in it.
        deepest_share: Share of the points of a bearing that must lie in it.

    Returns:
        places (k, 2) in order of bearing, and the deviation (k,) of each along its ray.
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
    places = np.empty((bins, 2))
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
        places[count, 0], places[count, 1] = x / weight, y / weight
        deviations[count] = 1.0 / math.sqrt(weight)
        count += 1
    return places[:count].copy(), deviations[:count].copy()


@njit(cache=True)
def normals(
    places: np.ndarray,
    origin: np.ndarray,
    radius: float,
    spacing: float,
    flatness: float,
    least: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Normal of each place from its neighbours in order of bearing; dense stretches are thinned.

    Returns:
        index (m,) of the places kept, and their normals (m, 2), towards the sensor.
    """
    n = places.shape[0]
    kept = np.empty(n, np.int64)
    found = np.empty((n, 2))
    count = 0
    for i in range(n):
        if count > 0:
            last = kept[count - 1]
            gap = math.hypot(places[i, 0] - places[last, 0], places[i, 1] - places[last, 1])
            if gap < spacing:
                continue
        low = high = i
        while low > 0 and _near(places, low - 1, low, i, radius):
            low -= 1
        while high < n - 1 and _near(places, high + 1, high, i, radius):
            high += 1
        members = high - low + 1
        if members < least:
            continue
        mx = my = xx = xy = yy = 0.0
        for j in range(low, high + 1):
            mx += places[j, 0] / members
            my += places[j, 1] / members
        for j in range(low, high + 1):
            dx, dy = places[j, 0] - mx, places[j, 1] - my
            xx += dx * dx / members
            xy += dx * dy / members
            yy += dy * dy / members
        half, root = 0.5 * (xx + yy), math.hypot(0.5 * (xx - yy), xy)
        thin, long = max(half - root, 0.0), half + root
        if thin > flatness**2 or long < (0.25 * radius) ** 2:
            continue
        angle = 0.5 * math.atan2(2.0 * xy, xx - yy)  # of the long axis
        nx, ny = -math.sin(angle), math.cos(angle)
        if nx * (origin[0] - places[i, 0]) + ny * (origin[1] - places[i, 1]) < 0.0:
            nx, ny = -nx, -ny
        kept[count] = i
        found[count, 0], found[count, 1] = nx, ny
        count += 1
    return kept[:count].copy(), found[:count].copy()


@njit(cache=True)
def _near(places: np.ndarray, j: int, neighbour: int, i: int, radius: float) -> bool:
    step = math.hypot(places[j, 0] - places[neighbour, 0], places[j, 1] - places[neighbour, 1])
    away = math.hypot(places[j, 0] - places[i, 0], places[j, 1] - places[i, 1])
    return step < 0.6 * radius and away < radius


@njit(cache=True)
def partners(
    places: np.ndarray,
    directions: np.ndarray,
    map_places: np.ndarray,
    map_directions: np.ndarray,
    first: np.ndarray,
    gate: float,
    cosine: float,
    found: np.ndarray,
) -> None:
    """For every place and every keyframe the nearest place of that keyframe that faces alike.

    Args:
        places, directions: (n, 2), world frame.
        map_places, map_directions: (m, 2), world frame, keyframe by keyframe.
        first: (k + 1,), rows of keyframe j are first[j] to first[j + 1].
        gate: Farthest partner, m.
        cosine: Least cosine between the normals.
        found: (n, k), receives the row of the partner, -1 where there is none.
    """
    for i in range(places.shape[0]):
        px, py = places[i, 0], places[i, 1]
        ux, uy = directions[i, 0], directions[i, 1]
        for j in range(first.shape[0] - 1):
            best, row = gate * gate, -1
            for r in range(first[j], first[j + 1]):
                dx, dy = map_places[r, 0] - px, map_places[r, 1] - py
                away = dx * dx + dy * dy
                if away < best and ux * map_directions[r, 0] + uy * map_directions[r, 1] > cosine:
                    best, row = away, r
            found[i, j] = row


@njit(cache=True)
def accumulate(
    places: np.ndarray,
    sigmas: np.ndarray,
    now: np.ndarray,
    map_places: np.ndarray,
    map_directions: np.ndarray,
    map_sigmas: np.ndarray,
    first: np.ndarray,
    poses: np.ndarray,
    found: np.ndarray,
    cut: float,
    A: np.ndarray,
    b: np.ndarray,
) -> tuple[int, float]:
    """Normal equations of the distances along the partners' normals.

    Unknown are the pose of now and those of the k keyframes, (x, y, yaw) each, in this order.

    Args:
        places: (n, 2), world frame as believed; sigmas: (n,).
        now: (3,), the pose they were seen from.
        map_places, map_directions, map_sigmas: As in `partners`.
        first: Likewise.
        poses: (k, 3), of the keyframes.
        found: (n, k), partners.
        cut: Residual, in deviations, where the weight has fallen to one half (Cauchy).
        A, b: (3 + 3 k, 3 + 3 k) and (3 + 3 k,), receive J^T W J and -J^T W r.

    Returns:
        Number of places with a partner, and the weighted sum of their squared residuals over its weight.
    """
    A[:] = 0.0
    b[:] = 0.0
    J = np.empty(6)
    rows = np.empty(6, np.int64)
    used, total, weights = 0, 0.0, 0.0
    for i in range(places.shape[0]):
        partners_of = 0
        for j in range(found.shape[1]):
            if found[i, j] >= 0:
                partners_of += 1
        if partners_of == 0:
            continue
        used += 1
        for j in range(found.shape[1]):
            r = found[i, j]
            if r < 0:
                continue
            nx, ny = map_directions[r, 0], map_directions[r, 1]
            dx, dy = places[i, 0] - map_places[r, 0], places[i, 1] - map_places[r, 1]
            residual = nx * dx + ny * dy
            variance = sigmas[i] ** 2 + map_sigmas[r] ** 2
            w = 1.0 / (variance * partners_of)
            w /= 1.0 + residual * residual / (variance * cut * cut)
            ax, ay = places[i, 0] - now[0], places[i, 1] - now[1]
            mx, my = places[i, 0] - poses[j, 0], places[i, 1] - poses[j, 1]
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
