"""Compiled loops of the way to a goal: its cost from every cell of a coarse map of the surfaces.

Surfaces are packed: their sides in one table, see `_chance_kernels`, and one row of `PLANE` columns a surface.
"""

from __future__ import annotations

import heapq
import math

import numpy as np

from perception.primitives.compiled import njit

PLANE = 7  # of a surface: first and last side, origin x, y, height there, slopes
RISE = 2  # `Border.RISE`
COARSE = 96  # ours: cells of the coarse map to each side
ROUND_M = 1.0  # ours: it reaches beyond what is known and the goal: ways lead round there
VOID, TIGHT = 4.0, 2.0  # ours: cost of a metre of unknown ground, and beside it
GAP_M = 0.25  # ours: between surfaces that a footstep crosses
FLOOR_M2 = 1.0  # ours: a level so large is a floor, no tread
BARRED = 30.0  # ours: of a metre where the body has no room, on the coarse map; that is no way, but finite
AHEAD_M, RING = 0.4, 16  # ours: where the direction of the way is taken, and directions compared


@njit(cache=True)
def toll(prices: np.ndarray, blocked: np.ndarray, grid: np.ndarray, x: float, y: float) -> float:
    """Cost of a metre at a place, 1 outside the map; infinite in a blocked cell.

    Args:
        grid: x and y of the corner of the map, and the side of a cell, m.
    """
    column = math.floor((x - grid[0]) / grid[2])
    row = math.floor((y - grid[1]) / grid[2])
    if row < 0 or column < 0 or row >= prices.shape[0] or column >= prices.shape[1]:
        return 1.0
    return np.inf if blocked[row, column] else prices[row, column]


@njit(cache=True)
def spread(height: np.ndarray, most: int) -> None:
    """Give cells without a height that of the nearest one that has one, so many cells away at most."""
    rows, columns = height.shape
    queue = np.empty((rows * columns, 3), np.int64)
    last = 0
    for row in range(rows):
        for column in range(columns):
            if not np.isnan(height[row, column]):
                queue[last, 0], queue[last, 1], queue[last, 2] = row, column, 0
                last += 1
    first = 0
    while first < last:
        row, column, away = queue[first]
        first += 1
        if away == most:
            continue
        for down, right in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            r, c = row + down, column + right
            if 0 <= r < rows and 0 <= c < columns and np.isnan(height[r, c]):
                height[r, c] = height[row, column]
                queue[last, 0], queue[last, 1], queue[last, 2] = r, c, away + 1
                last += 1


@njit(cache=True)
def bar_walls(
    price: np.ndarray,
    height: np.ndarray,
    sides: np.ndarray,
    planes: np.ndarray,
    corner: np.ndarray,
    cell: float,
    limits: np.ndarray,
    radius: float,
    level: float,
) -> None:
    """Bar the cells within a radius of sides where something rises from a floor, unless a step up to known ground is there.

    What rises from a tread may be the next step, which was not seen yet.

    Args:
        price: Cost of a metre in each cell, changed.
        height: Of the known ground, NaN where there is none.
        radius: Of the body, m.
        level: Heights that differ by less are one level, m.
    """
    around = int(radius / cell)
    for j in range(len(planes)):
        area = 0.0
        for i in range(int(planes[j, 0]), int(planes[j, 1])):
            area += 0.5 * (sides[i, 0] * sides[i, 3] - sides[i, 2] * sides[i, 1])
        if area < FLOOR_M2:
            continue
        for i in range(int(planes[j, 0]), int(planes[j, 1])):
            if sides[i, 5] != RISE:
                continue
            dx, dy = sides[i, 2] - sides[i, 0], sides[i, 3] - sides[i, 1]
            length = math.hypot(dx, dy)
            pieces = math.ceil(2.0 * length / cell)
            for piece in range(pieces):
                share = (piece + 0.5) / pieces
                x, y = sides[i, 0] + share * dx, sides[i, 1] + share * dy
                z = planes[j, 4] + planes[j, 5] * (x - planes[j, 2])
                z += planes[j, 6] * (y - planes[j, 3])
                step = False
                for out in range(1, math.ceil(2.0 * GAP_M / cell) + 1):
                    away = 0.5 * out * cell / length  # outlines are counterclockwise
                    column = int((x + away * dy - corner[0]) / cell)
                    row = int((y - away * dx - corner[1]) / cell)
                    if 0 <= row < COARSE and 0 <= column < COARSE:
                        step |= level < height[row, column] - z <= limits[4]
                if step:
                    continue
                column, row = int((x - corner[0]) / cell), int((y - corner[1]) / cell)
                for r in range(max(row - around, 0), min(row + around + 1, COARSE)):
                    for c in range(max(column - around, 0), min(column + around + 1, COARSE)):
                        if (r - row) ** 2 + (c - column) ** 2 <= around * around:
                            price[r, c] = BARRED


@njit(cache=True)
def way_left(
    sides: np.ndarray,
    planes: np.ndarray,
    goal: np.ndarray,
    corner: np.ndarray,
    cell: float,
    limits: np.ndarray,
    costs: np.ndarray,
    beside: float,
    radius: float,
    level: float,
    prices: np.ndarray,
    blocked: np.ndarray,
    grid: np.ndarray,
) -> np.ndarray:
    """Cost of the way to the goal from every cell, by Dijkstra, m; ground that is not known counts `VOID` times.

    The cost of the ground multiplies it, see `toll`. Ground that ends within the distance of the outer side of a foot counts
    `TIGHT` times, and what rises without a step up bars the way for the body (`bar_walls`): surfaces remember walls that the
    voxels have forgotten. Between neighbours the ground may rise and fall by no more than one footstep does; ground that is
    not known is as high as what is known beside it, within `GAP_M`, and farther away of any height.
    """
    height = np.full((COARSE, COARSE), np.nan)
    turns = np.zeros(
        COARSE + 1, np.bool_
    )  # whether a row enters or leaves the outline before a cell
    for j in range(len(planes)):
        if math.hypot(planes[j, 5], planes[j, 6]) > limits[8]:
            continue
        for row in range(COARSE):
            y = corner[1] + (row + 0.5) * cell
            turns[:] = False
            last = 0
            for i in range(int(planes[j, 0]), int(planes[j, 1])):
                ax, ay, bx, by = sides[i, 0], sides[i, 1], sides[i, 2], sides[i, 3]
                if (ay > y) != (by > y):
                    at = (ax + (y - ay) * (bx - ax) / (by - ay) - corner[0]) / cell - 0.5
                    column = min(max(math.ceil(at), 0), COARSE)
                    turns[column] = not turns[column]
                    last = max(last, column)
            within = False
            for column in range(last, 0, -1):
                within ^= turns[column]
                if within:
                    x = corner[0] + (column - 0.5) * cell
                    z = planes[j, 4] + planes[j, 5] * (x - planes[j, 2])
                    z += planes[j, 6] * (y - planes[j, 3])
                    if not z <= height[row, column - 1]:
                        height[row, column - 1] = z
    price = np.ones((COARSE, COARSE))
    apart = math.ceil(beside / cell)
    for row in range(COARSE):
        for column in range(COARSE):
            if np.isnan(height[row, column]):
                price[row, column] = VOID
                continue
            for down, right in ((apart, 0), (-apart, 0), (0, apart), (0, -apart)):
                r, c = row + down, column + right
                if r < 0 or c < 0 or r >= COARSE or c >= COARSE or np.isnan(height[r, c]):
                    price[row, column] = TIGHT
    for row in range(COARSE):
        y = corner[1] + (row + 0.5) * cell
        for column in range(COARSE):
            x = corner[0] + (column + 0.5) * cell
            price[row, column] *= min(toll(prices, blocked, grid, x, y), BARRED)
    bar_walls(price, height, sides, planes, corner, cell, limits, radius, level)
    spread(height, math.ceil(GAP_M / cell))
    left = np.full((COARSE, COARSE), np.inf)
    column = min(max(int((goal[0] - corner[0]) / cell), 0), COARSE - 1)
    row = min(max(int((goal[1] - corner[1]) / cell), 0), COARSE - 1)
    left[row, column] = 0.0
    heap = [(0.0, row, column)]
    while len(heap) > 0:
        length, row, column = heapq.heappop(heap)
        if length > left[row, column]:
            continue
        there = height[row, column]
        for down in range(-1, 2):
            for right in range(-1, 2):
                r, c = row + down, column + right
                if r < 0 or c < 0 or r >= COARSE or c >= COARSE:
                    continue
                here = height[r, c]
                if there - here > limits[4] or here - there > limits[5]:
                    continue
                step = cell * math.sqrt(down * down + right * right)
                step *= max(price[r, c], price[row, column])
                if there > here:
                    step += costs[2] * (there - here)
                elif there < here:
                    step += costs[3] * (here - there)
                if length + step < left[r, c]:
                    left[r, c] = length + step
                    heapq.heappush(heap, (length + step, r, c))
    return left


@njit(cache=True)
def estimate(
    left: np.ndarray, corner: np.ndarray, cell: float, goal: np.ndarray, x: float, y: float
) -> float:
    """Length of the way left from a place: at least the straight distance."""
    straight = math.hypot(goal[0] - x, goal[1] - y)
    column, row = int((x - corner[0]) / cell), int((y - corner[1]) / cell)
    if row < 0 or column < 0 or row >= COARSE or column >= COARSE:
        return VOID * straight
    dx = corner[0] + (column + 0.5) * cell - x
    dy = corner[1] + (row + 0.5) * cell - y
    best = left[row, column] + math.hypot(dx, dy)
    for down in range(-1, 2):
        for right in range(-1, 2):
            r, c = row + down, column + right
            if 0 <= r < COARSE and 0 <= c < COARSE:
                best = min(best, left[r, c] + math.hypot(dx + right * cell, dy + down * cell))
    return max(straight, best)


@njit(cache=True)
def off_way(
    left: np.ndarray,
    corner: np.ndarray,
    cell: float,
    goal: np.ndarray,
    x: float,
    y: float,
    yaw: float,
) -> float:
    """Angle between a heading and the direction of the way to the goal, rad."""
    heading, least, way = math.atan2(goal[1] - y, goal[0] - x), np.inf, 0.0
    if math.hypot(goal[0] - x, goal[1] - y) > AHEAD_M:
        for k in range(RING):
            angle = heading + 2.0 * math.pi * k / RING
            column = int((x + AHEAD_M * math.cos(angle) - corner[0]) / cell)
            row = int((y + AHEAD_M * math.sin(angle) - corner[1]) / cell)
            if (
                0 <= row < COARSE
                and 0 <= column < COARSE
                and left[row, column] < least - 0.5 * cell
            ):
                least, way = left[row, column], angle
        if least < np.inf:
            heading = way
    off = abs(heading - yaw) % (2.0 * math.pi)
    return min(off, 2.0 * math.pi - off)
