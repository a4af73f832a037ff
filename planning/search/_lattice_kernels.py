"""Compiled lattice search: A* with a bucket queue, and the printed form.

The map is a flat array of costs with a border of one cell, infinite where the body cannot be, so that no step needs a
test of the edge of the map. Lengths are in cells.
"""

from __future__ import annotations

import math
from heapq import heappop, heappush

import numpy as np

from perception.primitives.compiled import njit

DIAGONAL = math.sqrt(2.0)
STEP, EXIT, EXPANDED = 7, 8, 16  # parts of the state of a node: number of the step to it, flags
USED, SPARE, WAITING = 0, 1, 2  # entries of `account`: slots used, first free slot, nodes waiting
NOTHING = -1


@njit(cache=True)
def bordered(price: np.ndarray, blocked: np.ndarray) -> tuple[np.ndarray, float, float]:
    """The flat, bordered map of costs, and the least and the largest cost on it."""
    rows, columns = price.shape
    wide = columns + 2
    ground = np.full((rows + 2) * wide, np.inf)
    least, dearest = np.inf, 0.0
    for row in range(rows):
        begin = (row + 1) * wide + 1
        line, prices, shut = ground[begin : begin + columns], price[row], blocked[row]
        for column in range(columns):
            value = np.inf if shut[column] else prices[column]
            line[column] = value
            least = min(least, value)
            dearest = max(dearest, value if value < np.inf else 0.0)
    return ground, least, dearest


@njit(cache=True)
def estimate(down: float, right: float, least: float, on_lattice: bool) -> float:
    """C: lower bound of the cost over (down, right) cells.

    On the lattice the diagonal and straight steps at the least cost of the map; for a goal outside the map the straight
    distance at cost 1.
    """
    down, right = abs(down), abs(right)
    if on_lattice:
        return least * (max(down, right) + (DIAGONAL - 1.0) * min(down, right))
    return math.sqrt(down * down + right * right)


@njit(cache=True)
def steps(wide: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The eight steps from a node: change of flat index, of row and of column, and half their length."""
    downs = np.array([-1, -1, -1, 0, 0, 1, 1, 1])
    rights = np.array([-1, 0, 1, -1, 1, -1, 0, 1])
    halves = np.array([DIAGONAL, 1.0, DIAGONAL, 1.0, 1.0, DIAGONAL, 1.0, DIAGONAL]) / 2.0
    return downs * wide + rights, downs, rights, halves


@njit(cache=True)
def push(
    node: int,
    bucket: int,
    heads: np.ndarray,
    items: np.ndarray,
    after: np.ndarray,
    account: np.ndarray,
) -> None:
    """Insert a node at the front of a bucket; a free slot must exist."""
    entry = account[SPARE]
    if entry == NOTHING:
        entry = account[USED]
        account[USED] += 1
    else:
        account[SPARE] = after[np.uintp(entry)]
    items[np.uintp(entry)] = node
    after[np.uintp(entry)] = heads[np.uintp(bucket)]
    heads[np.uintp(bucket)] = entry
    account[WAITING] += 1


@njit(cache=True)
def pop(
    bucket: int, heads: np.ndarray, items: np.ndarray, after: np.ndarray, account: np.ndarray
) -> int:
    """Remove the first node of a non-empty bucket."""
    entry = heads[np.uintp(bucket)]
    heads[np.uintp(bucket)] = after[np.uintp(entry)]
    after[np.uintp(entry)] = account[SPARE]
    account[SPARE] = entry
    account[WAITING] -= 1
    return items[np.uintp(entry)]


@njit(cache=True)
def search(
    ground: np.ndarray,
    wide: int,
    prices: tuple[float, float],
    start: int,
    goal: tuple[float, float],
    exits: np.ndarray,
    on_lattice: bool,
    width: float,
) -> tuple[int, float, np.ndarray]:
    """A* on 8 neighbours over F = E + C with a circular bucket queue; exact, since nodes may be expanded again.

    An edge costs the mean cost of its ends times its length. A node that is reached again at lower cost is queued a second
    time; the stale entry is skipped. Within a bucket the order is arbitrary: a node may be expanded too early and is then
    expanded again.

    Args:
        ground: Of `bordered`.
        wide: Columns of the bordered map.
        prices: The least and the largest cost, of `bordered`.
        start: Flat index of a free node.
        goal: Row and column in the bordered map; may lie outside.
        exits: Flat indices of the nodes at which the search may end; the one with the least F is taken.
        on_lattice: Whether the goal is a node, and the only exit.
        width: Of a bucket.

    Returns:
        The exit (-1 if none can be reached), its E, and the state of every node, for `trace`.
    """
    shifts, downs, rights, halves = steps(wide)
    least = prices[0]
    walked = np.full(ground.shape[0], np.inf)
    state = np.zeros(ground.shape[0], np.uint8)
    for node in exits:
        state[node] = EXIT
    heads = np.full(math.ceil(DIAGONAL * 2.0 * max(1.0, prices[1]) / width) + 3, NOTHING, np.int32)
    items = np.empty(ground.shape[0], np.int32)
    after = np.empty(ground.shape[0], np.int32)
    account = np.array([0, NOTHING, 0])
    per = 1.0 / width
    walked[start] = 0.0
    base = estimate(start // wide - goal[0], start % wide - goal[1], least, on_lattice)
    found, bound = (start, base) if state[start] & EXIT else (-1, np.inf)
    push(start, 0, heads, items, after, account)
    turn, bucket = 0, 0  # number of the bucket since the start, and in the circle
    while account[WAITING] > 0 and base + turn * width <= bound:
        if heads[np.uintp(bucket)] == NOTHING:
            turn += 1
            bucket = bucket + 1 if bucket + 1 < heads.shape[0] else 0
            continue
        node = pop(bucket, heads, items, after, account)
        if state[node] & EXPANDED:
            continue
        state[node] |= EXPANDED
        row, column = node // wide - goal[0], node % wide - goal[1]
        here, price = walked[node], ground[node]
        if account[USED] + 8 > items.shape[0]:
            items = np.concatenate((items, np.empty_like(items)))
            after = np.concatenate((after, np.empty_like(after)))
        for k in range(8):
            other = np.uintp(node + shifts[k])
            reached = here + (price + ground[other]) * halves[k]
            if reached >= walked[other]:  # also at blocked nodes: both are infinite
                continue
            total = reached + estimate(row + downs[k], column + rights[k], least, on_lattice)
            if total >= bound:
                continue
            walked[other] = reached
            leaf = state[other] & EXIT
            state[other] = leaf | k
            if leaf:
                found, bound = node + shifts[k], total
            later = bucket + max(0, int((total - base) * per) - turn)
            later = later if later < heads.shape[0] else later - heads.shape[0]
            push(node + shifts[k], later, heads, items, after, account)
    return found, walked[found] if found >= 0 else np.inf, state


@njit(cache=True)
def search_literal(
    ground: np.ndarray,
    wide: int,
    start: int,
    goal: tuple[float, float],
    exits: np.ndarray,
) -> tuple[int, float, np.ndarray]:
    """Best-first search over L + alpha U(k) + C, the potential of the node only; not optimal.

    Arguments and results as for `search`, except that the second result is the length L and C is the straight distance, as
    in seed 003.
    """
    shifts, downs, rights, halves = steps(wide)
    walked = np.full(ground.shape[0], np.inf)
    state = np.zeros(ground.shape[0], np.uint8)
    for node in exits:
        state[node] = EXIT
    walked[start] = 0.0
    heap = [(0.0, start)]
    while len(heap) > 0:
        node = heappop(heap)[1]
        if state[node] & EXPANDED:
            continue
        state[node] |= EXPANDED
        if state[node] & EXIT:
            return node, walked[node], state
        row, column = node // wide - goal[0], node % wide - goal[1]
        for k in range(8):
            other = node + shifts[k]
            if state[other] & EXPANDED or not np.isfinite(ground[other]):
                continue
            reached = walked[node] + 2.0 * halves[k]
            if reached < walked[other]:
                walked[other] = reached
                state[other] = (state[other] & EXIT) | k
                rest = estimate(row + downs[k], column + rights[k], 1.0, False)
                heappush(heap, (reached + (ground[other] - 1.0) + rest, other))
    return -1, np.inf, state


@njit(cache=True)
def trace(state: np.ndarray, wide: int, start: int, end: int) -> np.ndarray:
    """(n, 2) cells [row, column] of the map without its border, from the start to a reached node."""
    shifts = steps(wide)[0]
    count, node = 1, end
    while node != start:
        node -= shifts[state[node] & STEP]
        count += 1
    cells = np.empty((count, 2), np.int64)
    node = end
    for i in range(count - 1, -1, -1):
        cells[i, 0], cells[i, 1] = node // wide - 1, node % wide - 1
        node -= shifts[state[node] & STEP]
    return cells
