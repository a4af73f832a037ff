"""Compiled loops of the footsteps: A* over them, by the way left on a coarse map.

Surfaces are packed: their sides in one table, see `_chance_kernels`, and one row of `PLANE` columns a surface.
"""

from __future__ import annotations

import heapq
import math

import numpy as np

from perception.primitives.compiled import njit

from ._chance_kernels import chances, inside, margin, spans
from ._way_kernels import COARSE, ROUND_M, estimate, off_way, toll, way_left

NODE = 10  # of a node: x, y, yaw and height of its foot, surface, foot (+1 left), cost, chances missed and unseen, parent
MOVE = 3  # of a node: the footstep that leads to it
YAWS, CELLS = 32, 1 << 14  # headings told apart; most places told apart
# Ours: of a longest level step; places nearer than that count as one (experiment `footholds`, seeds 3002 to 3035).
PLACE = 0.3
SLOTS = 1 << 16
GOAL, HORIZON, BORDER = 0, 1, 2  # where a plan ends
GREED = 1.7  # ours: weight of the estimate, by which a plan may cost more than the best
FACING = 5.0  # ours: weight of a turn away from the way to the goal where a plan ends at a border: the robot is to look there
FAR = 1e3  # farther ahead than any side
ABOVE_M = 0.03  # ours: of two surfaces at one place; nearer ones may be the same ground, seen twice


@njit(cache=True)
def boxes_of(sides: np.ndarray, planes: np.ndarray) -> np.ndarray:
    """Least x, y and most x, y of every surface."""
    found = np.empty((len(planes), 4))
    for j in range(len(planes)):
        part = sides[int(planes[j, 0]) : int(planes[j, 1])]
        found[j, 0], found[j, 1] = part[:, 0].min(), part[:, 1].min()
        found[j, 2], found[j, 3] = part[:, 0].max(), part[:, 1].max()
    return found


@njit(cache=True)
def within_reach(
    boxes: np.ndarray,
    planes: np.ndarray,
    x: float,
    y: float,
    z: float,
    reach: float,
    limits: np.ndarray,
) -> list[int]:
    """Surfaces that are level enough, near a place, and not far too high or too low."""
    found = [0 for _ in range(0)]
    for j in range(len(planes)):
        if math.hypot(planes[j, 5], planes[j, 6]) > limits[8]:
            continue
        dx = max(boxes[j, 0] - x, x - boxes[j, 2], 0.0)
        dy = max(boxes[j, 1] - y, y - boxes[j, 3], 0.0)
        if dx * dx + dy * dy > reach * reach:
            continue
        here = planes[j, 4] + planes[j, 5] * (x - planes[j, 2]) + planes[j, 6] * (y - planes[j, 3])
        if (
            here - z > limits[4] + 2.0 * limits[8] * reach
            or z - here > limits[5] + 2.0 * limits[8] * reach
        ):
            continue
        found.append(j)
    return found


@njit(cache=True)
def sides_near(
    sides: np.ndarray,
    planes: np.ndarray,
    near_by: list[int],
    x: float,
    y: float,
    reach: float,
    found: np.ndarray,
    firsts: np.ndarray,
) -> None:
    """The sides that matter within a reach of a place, of some surfaces: those there, and those that tell which side is inside.

    Args:
        found: As long as `sides`, written: the sides, surface after surface.
        firsts: One longer than `near_by`, written: where those of each begin.
    """
    count = 0
    for k in range(len(near_by)):
        firsts[k] = count
        for i in range(int(planes[near_by[k], 0]), int(planes[near_by[k], 1])):
            ax, ay, bx, by = sides[i, 0], sides[i, 1], sides[i, 2], sides[i, 3]
            if max(ax, bx) >= x - reach and min(ay, by) <= y + reach and max(ay, by) >= y - reach:
                found[count] = sides[i]
                count += 1
    firsts[len(near_by)] = count


@njit(cache=True)
def room_beside(
    sides: np.ndarray,
    firsts: np.ndarray,
    planes: np.ndarray,
    near_by: list[int],
    x: float,
    y: float,
    yaw: float,
    z: float,
    side: float,
    h: float,
    apart: float,
) -> bool:
    """Whether there is ground of the same level where the other foot stands beside: no foot stands beside a flight."""
    ox, oy = x + side * 2.0 * h * math.sin(yaw), y - side * 2.0 * h * math.cos(yaw)
    for k in range(len(near_by)):
        j = near_by[k]
        here = planes[j, 4] + planes[j, 5] * (ox - planes[j, 2])
        here += planes[j, 6] * (oy - planes[j, 3])
        if abs(here - z) <= apart and inside(sides, firsts[k], firsts[k + 1], ox, oy):
            return True
    return False


@njit(cache=True)
def rise_to(planes: np.ndarray, on: int, other: int, x: float, y: float) -> float:
    """By how much one surface is higher than another at a place, m."""
    a, b = planes[on], planes[other]
    return (
        b[4] + b[5] * (x - b[2]) + b[6] * (y - b[3])
        - a[4] - a[5] * (x - a[2]) - a[6] * (y - a[3])
    )  # fmt: skip


@njit(cache=True)
def is_below(
    sides: np.ndarray,
    planes: np.ndarray,
    boxes: np.ndarray,
    on: int,
    x: float,
    y: float,
    yaw: float,
    half: np.ndarray,
) -> bool:
    """Whether a sole on a surface reaches below another one: the board of an open step, a bench, a table.

    Heights are compared where the other surface is: a strip that rises to the edge of the sole's is not above it.
    """
    c, s = math.cos(yaw), math.sin(yaw)
    reach = math.hypot(half[0], half[1])
    ends = np.empty((2, 2))  # of a side, in the axes of the sole
    for j in range(len(planes)):
        away = x + reach < boxes[j, 0] or x - reach > boxes[j, 2]
        away = away or y + reach < boxes[j, 1] or y - reach > boxes[j, 3]
        if j == on or away:
            continue
        rise = rise_to(planes, on, j, x, y)
        steeper = math.hypot(planes[j, 5] - planes[on, 5], planes[j, 6] - planes[on, 6])
        if rise + steeper * reach < ABOVE_M:
            continue  # nowhere on the sole
        first, last = int(planes[j, 0]), int(planes[j, 1])
        if rise >= ABOVE_M and inside(sides, first, last, x, y):
            return True
        for i in range(first, last):  # whether a side crosses the sole
            for k in range(2):
                dx, dy = sides[i, 2 * k] - x, sides[i, 2 * k + 1] - y
                ends[0, k], ends[1, k] = c * dx + s * dy, c * dy - s * dx
            begin, end = 0.0, 1.0
            for k in range(2):
                at, way = ends[k, 0], ends[k, 1] - ends[k, 0]
                if way == 0.0:
                    end = end if abs(at) < half[k] else -1.0
                else:
                    one, two = (-half[k] - at) / way, (half[k] - at) / way
                    begin, end = max(begin, min(one, two)), min(end, max(one, two))
            if begin >= end:
                continue
            for share in (begin, end):
                px = sides[i, 0] + share * (sides[i, 2] - sides[i, 0])
                py = sides[i, 1] + share * (sides[i, 3] - sides[i, 1])
                if rise_to(planes, on, j, px, py) >= ABOVE_M:
                    return True
    return False


@njit(cache=True)
def soles_meet(ahead: float, left: float, turn: float, half: np.ndarray) -> bool:
    """Whether two soles overlap, the other one that far ahead and left of the first, turned against it."""
    c, s = math.cos(turn), math.sin(turn)
    long = half[0] * (1.0 + abs(c)) + half[1] * abs(s)
    wide = half[1] * (1.0 + abs(c)) + half[0] * abs(s)
    apart = abs(ahead) >= long or abs(left) >= wide
    return not (apart or abs(c * ahead + s * left) >= long or abs(c * left - s * ahead) >= wide)


@njit(cache=True)
def slot_of(table: np.ndarray, key: int) -> int:
    """Slot of a key, or the free one where it belongs."""
    slot = (key * 2654435761) % SLOTS
    while table[slot] != -1 and table[slot] != key:
        slot = (slot + 1) % SLOTS
    return slot


@njit(cache=True)
def search(
    sides: np.ndarray,
    planes: np.ndarray,
    start: np.ndarray,
    goal: np.ndarray,
    body: np.ndarray,
    limits: np.ndarray,
    costs: np.ndarray,
    noise: np.ndarray,
    risk: float,
    horizon_m: float,
    most: int,
    prices: np.ndarray,
    blocked: np.ndarray,
    grid: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, int, int, float]:
    """A* over footsteps from a standing foot.

    Args:
        sides, planes: The packed surfaces.
        start: x, y, yaw, height of the standing foot, surface (-1 unknown), foot (+1 left).
        goal: x, y, and the distance at which it is reached.
        body: Half of length and width of a sole, half of the stance, radius of the body.
        limits: Of a footstep ahead, back, to the side, turn; up, down, ahead to a higher level and to a lower one; slope.
        costs: Of a footstep, of a turn by 1 rad, of a rise and of a descent by 1 m, of a chance as large as the risk, m.
        noise: Variances of a foot's place.
        risk: Most chance of a foothold.
        horizon_m: Length of the way after which a plan ends.
        most: Nodes that are expanded.
        prices, blocked, grid: Cost of the ground, see `toll`.

    Returns:
        Nodes, their footsteps (ahead, left, turn), the last node of the plan, where it is (`GOAL`, `HORIZON`, `BORDER`), and by how
        much the way is shorter there, m.
    """
    room = min(CELLS, 100 * most)
    nodes = np.empty((room, NODE))
    moves = np.zeros((room, MOVE))
    table = np.full(SLOTS, -1, np.int64)
    owner = np.empty(SLOTS, np.int64)
    closed = np.zeros(room, np.bool_)
    half, h = body[:2], body[2]
    pace = max(limits[0], limits[6])
    cell = PLACE * limits[0]
    keys = np.full(room, -1, np.int64)
    nodes[0, :6], nodes[0, 6:9], nodes[0, 9] = start, 0.0, -1.0
    fx, fy = (
        start[0] + start[5] * h * math.sin(start[2]),
        start[1] - start[5] * h * math.cos(start[2]),
    )
    low = np.array([min(sides[:, 0].min(), fx, goal[0]), min(sides[:, 1].min(), fy, goal[1])])
    high = np.array([max(sides[:, 0].max(), fx, goal[0]), max(sides[:, 1].max(), fy, goal[1])])
    low, high = low - ROUND_M, high + ROUND_M
    fine = 1.001 * max(high[0] - low[0], high[1] - low[1]) / COARSE
    boxes = boxes_of(sides, planes)
    level_m = 0.1 * max(limits[4], limits[5])
    # that the feet of two steps may touch, and how far an error may shift a side or a foot
    wide = pace + 4.0 * h + math.hypot(half[0], half[1]) + 6.0 * math.sqrt(noise[0])
    wide += 6.0 * sides[:, 4].max()
    local, firsts = np.empty_like(sides), np.zeros(len(planes) + 1, np.int64)
    left = way_left(
        sides, planes, goal, low, fine, limits, costs, h + half[1], body[3], level_m, prices, blocked, grid,
    )  # fmt: skip
    left_m = estimate(left, low, fine, goal, fx, fy)
    per_m, per_turn = GREED * (1.0 + costs[0] / limits[0]), costs[1] + costs[0] / limits[3]
    heap = [(per_m * left_m, 0)]
    count, expanded, best, nearest = 1, 0, 0, left_m
    enough, whole = left_m - horizon_m, left_m
    nearest = np.inf
    while len(heap) > 0 and expanded < most:
        _, this = heapq.heappop(heap)
        if closed[this] or (this > 0 and owner[slot_of(table, keys[this])] != this):
            continue
        closed[this] = True
        x, y, yaw, z = nodes[this, 0], nodes[this, 1], nodes[this, 2], nodes[this, 3]
        on, side = int(nodes[this, 4]), -nodes[this, 5]  # side of the foot that swings
        c, s = math.cos(yaw), math.sin(yaw)
        fx, fy = x - side * h * s, y + side * h * c  # frame between the feet
        near_by = within_reach(boxes, planes, fx, fy, z, pace + 2.0 * h, limits)
        sides_near(sides, planes, near_by, fx, fy, wide, local, firsts)
        if this > 0 and not room_beside(
            local, firsts, planes, near_by, x, y, yaw, z, -side, h, level_m
        ):
            continue
        left_m = estimate(left, low, fine, goal, fx, fy)
        from_here = left_m + FACING * costs[1] * off_way(left, low, fine, goal, fx, fy, yaw)
        if math.hypot(goal[0] - fx, goal[1] - fy) <= goal[2]:
            return nodes, moves, this, GOAL, whole - left_m
        if left_m <= enough and left_m < whole:  # both may be infinite
            return nodes, moves, this, HORIZON, whole - left_m
        if from_here < nearest - 1e-9:
            best, nearest = this, from_here
        expanded += 1
        for turning in range(5):
            turn = (turning - 2) / 2.0 * limits[3]
            tc, ts = math.cos(yaw + turn), math.sin(yaw + turn)
            for aside in range(3):
                lateral = side * aside / 2.0 * limits[2]
                # the swing foot at a step of no length, and the direction that steps ahead move it
                bx, by = fx - lateral * s - side * h * ts, fy + lateral * c + side * h * tc
                for k in range(len(near_by)):
                    j, first, last = near_by[k], firsts[k], firsts[k + 1]
                    begin, end, near, far = spans(local, first, last, bx, by, c, s)
                    if begin > end or begin > pace:
                        continue
                    begin, end = max(begin, -FAR), min(end, FAR)
                    centre, front, behind = 0.5 * (begin + end), end, begin
                    if far >= 0:
                        front -= margin(local[far], c, s, yaw + turn, half, noise)
                    if near >= 0:
                        behind += margin(local[near], c, s, yaw + turn, half, noise)
                    for choice in range(6):
                        if choice == 0:
                            ahead = 0.0
                        elif choice == 1:
                            ahead = limits[0]
                        elif choice == 2:
                            ahead = 0.5 * limits[0]
                        elif choice == 3:
                            ahead = centre
                        elif choice == 4:
                            ahead = front
                        else:
                            ahead = behind
                        tx, ty = bx + ahead * c, by + ahead * s
                        height = planes[j, 4] + planes[j, 5] * (tx - planes[j, 2])
                        height += planes[j, 6] * (ty - planes[j, 3])
                        rise = height - z
                        level = j == on or abs(rise) < level_m
                        if level:
                            longest = limits[0]
                        elif choice in (1, 2) or turning not in (1, 2, 3):
                            continue
                        else:
                            longest = limits[6] if rise > 0.0 else limits[7]
                        if rise > limits[4] or -rise > limits[5]:
                            continue
                        if choice >= 3 and level:
                            if ahead >= longest or (choice > 3 and ahead <= -limits[1]):
                                continue  # as another choice
                            ahead = min(max(ahead, -limits[1]), longest)
                            tx, ty = bx + ahead * c, by + ahead * s
                        if ahead > longest + 1e-9 or ahead < -limits[1]:
                            continue
                        if soles_meet(
                            c * (tx - x) + s * (ty - y), c * (ty - y) - s * (tx - x), turn, half
                        ):
                            continue
                        gx, gy = tx + side * h * ts, ty - side * h * tc
                        price = toll(prices, blocked, grid, gx, gy)
                        if price == np.inf:
                            continue
                        cost = nodes[this, 6] + price * math.hypot(gx - fx, gy - fy) + costs[0]
                        cost += costs[1] * abs(turn)
                        cost += costs[2] * max(rise, 0.0) + costs[3] * max(-rise, 0.0)
                        heading = (yaw + turn) % (2.0 * math.pi)
                        key = (math.floor(tx / cell) + 4096) * 8192
                        key = (key + math.floor(ty / cell) + 4096) * YAWS
                        key = (key + int(heading / (2.0 * math.pi) * YAWS)) * 2 + int(side > 0)
                        slot = slot_of(table, key)
                        if table[slot] == key and nodes[owner[slot], 6] <= cost:
                            continue
                        missed, unseen = chances(
                            local, first, last, tx, ty, yaw + turn, half, noise, risk
                        )
                        if missed > risk or unseen > risk:
                            continue
                        if is_below(sides, planes, boxes, j, tx, ty, yaw + turn, half):
                            continue
                        cost += costs[4] * (missed + unseen) / risk
                        if table[slot] == key and nodes[owner[slot], 6] <= cost:
                            continue
                        if count >= room:
                            break
                        table[slot] = key
                        owner[slot], keys[count] = count, key
                        nodes[count, 0], nodes[count, 1], nodes[count, 2] = tx, ty, yaw + turn
                        nodes[count, 3], nodes[count, 4], nodes[count, 5] = height, j, side
                        nodes[count, 6], nodes[count, 7], nodes[count, 8] = cost, missed, unseen
                        nodes[count, 9] = this
                        moves[count, 0], moves[count, 1], moves[count, 2] = ahead, lateral, turn
                        ahead_m = estimate(left, low, fine, goal, gx, gy)
                        turn_left = off_way(left, low, fine, goal, gx, gy, yaw + turn)
                        rest = per_m * ahead_m + per_turn * turn_left
                        heapq.heappush(heap, (cost + rest, count))
                        count += 1
    return nodes, moves, best, BORDER, whole - nearest if nearest < np.inf else 0.0
