"""Compiled inner loops of the search: potential, clearance, A* with a bucket queue, line integrals.

Cells are [row, column]; lengths are in cells. Arrays and scalars only.
"""

from __future__ import annotations

import math
from heapq import heappop, heappush

import numpy as np
from numba import njit


@njit(cache=True)
def spread(
    probability: np.ndarray, solid: np.ndarray, margin: float, radius: float
) -> tuple[np.ndarray, np.ndarray]:
    """Potential U of every cell, and whether a solid cell lies within the radius of it.

    `margin` (E0) and `radius` (r_b) are in cells; distances are from centre to centre.
    """
    rows, columns = probability.shape
    reach = math.ceil(max(margin, radius))
    wide = columns + 2 * reach
    padded = np.zeros((rows + 2 * reach, wide))
    hard = np.zeros((rows + 2 * reach, wide), np.bool_)
    padded[reach : reach + rows, reach : reach + columns] = probability
    hard[reach : reach + rows, reach : reach + columns] = solid
    potential = np.zeros((rows, columns))
    blocked = np.zeros((rows, columns), np.bool_)
    for down in range(-reach, reach + 1):
        for right in range(-reach, reach + 1):
            distance = math.sqrt(down * down + right * right)
            weight = (1.0 - distance / margin) ** 2 if distance < margin else 0.0
            if weight > 0.0:
                for row in range(rows):
                    target = potential[row]
                    begin = reach + right
                    source = padded[row + reach + down, begin : begin + columns]
                    for column in range(columns):
                        target[column] = max(target[column], weight * source[column])
            if distance <= radius:
                for row in range(rows):
                    flags = blocked[row]
                    begin = reach + right
                    marks = hard[row + reach + down, begin : begin + columns]
                    for column in range(columns):
                        flags[column] |= marks[column]
    return potential, blocked


@njit(cache=True)
def search(
    price: np.ndarray,
    free: np.ndarray,
    start: int,
    goal_row: float,
    goal_column: float,
    exits: np.ndarray,
    width: float,
) -> tuple[int, float, np.ndarray]:
    """A* on 8 neighbours over F = E + C with a circular bucket queue; exact, because nodes reopen.

    All arrays are padded by one cell that is not free. An edge costs the mean price of its ends times its
    length, prices are at least 1, C is the Euclidean distance to the goal. The search ends at the exit of
    least F. Returns the exit (-1: none can be reached), its E in cells, and the flat index of every
    node's predecessor.
    """
    rows, columns = price.shape
    nodes = rows * columns
    cost = price.ravel()
    open_ = free.ravel()
    leaves = exits.ravel()
    dearest = 1.0
    for node in range(nodes):
        if open_[node] and cost[node] > dearest:
            dearest = cost[node]
    span = math.ceil(math.sqrt(2.0) * (dearest + 1.0) / width) + 3
    shifts = np.array(
        [1, -1, columns, -columns, columns + 1, columns - 1, 1 - columns, -1 - columns]
    )
    lengths = np.array([0.5, 0.5, 0.5, 0.5, *([0.5 * math.sqrt(2.0)] * 4)])
    walked = np.full(nodes, np.inf)
    ahead = np.empty(nodes)
    bucket = np.full(nodes, -1, np.int64)  # where the node waits; -1: nowhere
    before = np.full(nodes, -1, np.int64)
    after = np.full(nodes, -1, np.int64)
    parent = np.full(nodes, -1, np.int64)
    heads = np.full(span, -1, np.int64)

    walked[start] = 0.0
    ahead[start] = math.hypot(start // columns - goal_row, start % columns - goal_column)
    now = int(ahead[start] / width)
    slot = now % span
    heads[slot] = start
    bucket[start] = slot
    waiting = 1
    found = start if leaves[start] else -1
    least = ahead[start] if found >= 0 else np.inf
    while waiting > 0 and now <= least / width:
        slot = now % span
        node = heads[slot]
        if node < 0:
            now += 1
            continue
        heads[slot] = after[node]
        if after[node] >= 0:
            before[after[node]] = -1
        bucket[node] = -1
        waiting -= 1
        for k in range(8):
            other = node + shifts[k]
            if not open_[other]:
                continue
            reached = walked[node] + (cost[node] + cost[other]) * lengths[k]
            if reached >= walked[other]:
                continue
            if walked[other] == np.inf:
                ahead[other] = math.hypot(
                    other // columns - goal_row, other % columns - goal_column
                )
            walked[other] = reached
            parent[other] = node
            total = reached + ahead[other]
            if leaves[other] and total < least:
                least = total
                found = other
            if bucket[other] >= 0:  # take it out of the bucket where it waits
                if before[other] >= 0:
                    after[before[other]] = after[other]
                else:
                    heads[bucket[other]] = after[other]
                if after[other] >= 0:
                    before[after[other]] = before[other]
            else:
                waiting += 1
            slot = max(now, int(total / width)) % span
            before[other] = -1
            after[other] = heads[slot]
            if heads[slot] >= 0:
                before[heads[slot]] = other
            heads[slot] = other
            bucket[other] = slot
    return found, walked[found] if found >= 0 else np.inf, parent


@njit(cache=True)
def search_literal(
    weighted: np.ndarray,
    free: np.ndarray,
    start: int,
    goal_row: float,
    goal_column: float,
    exits: np.ndarray,
) -> tuple[int, float, np.ndarray]:
    """Best-first search over L + alpha U(k) + C, the potential of the node only; not optimal.

    `weighted` is alpha U, in cells. Arrays are padded and results are as for `search`, but the second
    one is the length L in cells.
    """
    rows, columns = weighted.shape
    cost, open_, leaves = weighted.ravel(), free.ravel(), exits.ravel()
    shifts = np.array(
        [1, -1, columns, -columns, columns + 1, columns - 1, 1 - columns, -1 - columns]
    )
    lengths = np.array([1.0, 1.0, 1.0, 1.0, *([math.sqrt(2.0)] * 4)])
    walked = np.full(rows * columns, np.inf)
    closed = np.zeros(rows * columns, np.bool_)
    parent = np.full(rows * columns, -1, np.int64)
    walked[start] = 0.0
    heap = [(0.0, start)]
    while len(heap) > 0:
        node = heappop(heap)[1]
        if closed[node]:
            continue
        closed[node] = True
        if leaves[node]:
            return node, walked[node], parent
        for k in range(8):
            other = node + shifts[k]
            if closed[other] or not open_[other]:
                continue
            reached = walked[node] + lengths[k]
            if reached < walked[other]:
                walked[other] = reached
                parent[other] = node
                rest = math.hypot(other // columns - goal_row, other % columns - goal_column)
                heappush(heap, (reached + cost[other] + rest, other))
    return -1, np.inf, parent


@njit(cache=True)
def segment_cost(
    price: np.ndarray, blocked: np.ndarray, begin: np.ndarray, end: np.ndarray
) -> float:
    """Cost of a straight segment between two (x, y) in cells: the mean price along it times its length.

    Sampled at least every half cell, prices between cell centres by bilinear interpolation; infinite if a
    sample lies in a blocked cell or outside the grid.
    """
    rows, columns = price.shape
    length = math.hypot(end[0] - begin[0], end[1] - begin[1])
    pieces = max(1, math.ceil(2.0 * length))
    total = 0.0
    for i in range(pieces + 1):
        share = i / pieces
        x = begin[0] + share * (end[0] - begin[0])
        y = begin[1] + share * (end[1] - begin[1])
        column, row = math.floor(x + 0.5), math.floor(y + 0.5)
        if not (0 <= row < rows and 0 <= column < columns) or blocked[row, column]:
            return np.inf
        c = min(max(math.floor(x), 0), columns - 2)
        r = min(max(math.floor(y), 0), rows - 2)
        u = min(max(x - c, 0.0), 1.0)
        v = min(max(y - r, 0.0), 1.0)
        value = (1.0 - v) * ((1.0 - u) * price[r, c] + u * price[r, c + 1]) + v * (
            (1.0 - u) * price[r + 1, c] + u * price[r + 1, c + 1]
        )
        total += value * (0.5 if i in (0, pieces) else 1.0)
    return total / pieces * length
