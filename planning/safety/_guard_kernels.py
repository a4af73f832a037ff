"""Compiled rollouts of the guard: where candidate plans lead, and what they come close to.

A step moves the body along its old heading, then turns it. Positions are sampled in the middle and at
the end of every step. Arrays and scalars only.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

MOST_EXTRA = 0.25  # m: what heading and loyalty may add to a plan's cost, at most


@njit(cache=True)
def _distance(x: float, y: float) -> float:
    """As `math.hypot`, which takes care of numbers that are not met here: 2.6 for 15 ns."""
    return math.sqrt(x * x + y * y)


@njit(cache=True)
def relative_places(
    mover: np.ndarray,
    robot: np.ndarray,
    times: np.ndarray,
    sure_s: float,
    acceleration: float,
    result: np.ndarray,
) -> None:
    """Covariance of the relative place, going straight on.

    Args:
        mover, robot: Covariances of (x, y, vx, vy) and of (x, y, yaw), world frame, m, m/s and rad.
        times: (n,) from now, s; what is later than `sure_s` counts as if it were then.
        acceleration: Of the mover, random, m/s^2.
        result: (n, 3), written: variances of x and of y, covariance of the two, m^2.
    """
    for k in range(len(times)):
        t = min(times[k], sure_s)
        noise = 0.5 * acceleration * t * t
        xx = mover[0, 0] + robot[0, 0] + 2.0 * t * mover[0, 2] + t * t * mover[2, 2]
        yy = mover[1, 1] + robot[1, 1] + 2.0 * t * mover[1, 3] + t * t * mover[3, 3]
        result[k, 0], result[k, 1] = xx + noise * noise, yy + noise * noise
        result[k, 2] = (
            mover[0, 1] + robot[0, 1] + t * (mover[0, 3] + mover[1, 2]) + t * t * mover[2, 3]
        )


@njit(cache=True)
def _need(base: float, doubt: np.ndarray, most: float, x: float, y: float) -> float:
    """Distance to be kept in a direction: the base and a deviation, no larger than `most`, along it."""
    square = max(x * x + y * y, 1e-18)
    along = (x * x * doubt[0] + y * y * doubt[1] + 2.0 * x * y * doubt[2]) / square
    return base + min(math.sqrt(max(along, 0.0)), most)


@njit(cache=True)
def _harm(gap: float, soft: float, ease: float, steep: float, touch: float, hard: float) -> float:
    """Cost of a gap short of what is needed (negative: beyond it), m of detour."""
    if gap <= -soft:
        return 0.0
    if gap <= 0.0:
        share = 1.0 + gap / soft
        return ease * share * share
    cost = ease + steep * gap
    return cost + hard if gap > touch else cost


@njit(cache=True)
def _too_late(
    ax: float,
    ay: float,
    yaw: float,
    vx: float,
    vy: float,
    beside: float,
    lead: float,
    react_s: float,
    top: float,
    side: float,
    turn_rate: float,
) -> float:
    """How far the robot is from being out of the way in time, if the mover turned back now, m; 0: in time.

    Args:
        ax, ay: Robot minus mover.
        yaw: Of the robot.
        vx, vy: Of the mover, before it turns.
        beside, lead: Distances to be kept across its way and along it.
        react_s: Until a turn is noticed and the robot moves.
        top, side: Speeds ahead, and aside or back.
        turn_rate: rad/s.
    """
    speed = math.sqrt(vx * vx + vy * vy)
    if speed < 1e-3:
        return 0.0
    ex, ey = vx / speed, vy / speed
    along = ax * ex + ay * ey
    across = ex * ay - ey * ax
    if along >= 0.0 or abs(across) >= beside:
        return 0.0
    lateral = beside - abs(across)
    free = -along - lead * math.sqrt(1.0 - (across / beside) ** 2)
    sign = 1.0 if across >= 0.0 else -1.0
    c, s = math.cos(yaw), math.sin(yaw)
    outward = sign * (c * -ey + s * ex)
    away = -(c * ex + s * ey)
    closing = max(speed - 0.9 * top * max(away, 0.0), 0.1 * speed)
    arrives = max(free, 0.0) / closing
    off = math.acos(min(max(outward, -1.0), 1.0))
    ahead_s = max(off - 0.6, 0.0) / turn_rate + lateral / (0.9 * top)
    aside_s = lateral / max(side * max(abs(outward) if outward < 0.0 else abs(away), 0.1), 1e-3)
    through_s = max(math.pi - off - 0.6, 0.0) / turn_rate + (beside + abs(across)) / (0.9 * top)
    late = react_s + min(ahead_s, aside_s, through_s) - arrives
    if late <= 0.0:
        return 0.0
    return min(late * top, lateral)


@njit(cache=True)
def _within_reach(
    robot: np.ndarray,
    plans: np.ndarray,
    places: np.ndarray,
    most: np.ndarray,
    turning: np.ndarray,
    soft: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Of each sample the discs that any plan can come near to, or that may turn there: numbers, how many."""
    longest = 0.0
    for i in range(plans.shape[0]):
        longest = max(longest, _distance(plans[i, 0], plans[i, 1]))
        longest = max(longest, _distance(plans[i, 4], plans[i, 5]))
    many, samples = most.shape
    near, counts = np.empty((samples, many), np.int64), np.zeros(samples, np.int64)
    for sample in range(samples):
        reach = 0.5 * (sample + 1) * longest + soft + 1e-6
        for h in range(many):
            need = most[h, sample]
            if need <= 0.0:
                continue
            x, y = places[h, sample, 0] - robot[0], places[h, sample, 1] - robot[1]
            if _distance(x, y) <= reach + need or turning[h, sample] > 0.0:
                near[sample, counts[sample]] = h
                counts[sample] += 1
    return near, counts


@njit(cache=True)
def _distances(
    velocities: np.ndarray, needed: np.ndarray, doubts: np.ndarray, widest: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of each disc and sample the largest distance to be kept, that across its way, and that along it."""
    many, samples = needed.shape
    most, beside, lead = np.zeros_like(needed), np.zeros_like(needed), np.zeros_like(needed)
    for h in range(many):
        for sample in range(samples):
            base, doubt = needed[h, sample], doubts[h, sample]
            if base <= 0.0:
                continue
            middle, half = 0.5 * (doubt[0] + doubt[1]), 0.5 * (doubt[0] - doubt[1])
            worst = max(middle + _distance(half, doubt[2]), 0.0)
            most[h, sample] = base + min(math.sqrt(worst), widest)
            vx, vy = velocities[h, sample, 0], velocities[h, sample, 1]
            beside[h, sample] = _need(base, doubt, widest, -vy, vx)
            lead[h, sample] = _need(base, doubt, widest, vx, vy)
    return most, beside, lead


@njit(cache=True)
def _begin_alike(plans: np.ndarray, i: int) -> bool:
    """Whether a plan begins as the one before it."""
    begin, before = plans[i], plans[i - 1]
    same = begin[0] == before[0] and begin[1] == before[1] and begin[2] == before[2]
    return bool(same and begin[3] == before[3])


@njit(cache=True)
def roll_out(
    robot: np.ndarray,
    plans: np.ndarray,
    target: np.ndarray,
    gait: np.ndarray,
    places: np.ndarray,
    velocities: np.ndarray,
    needed: np.ndarray,
    doubts: np.ndarray,
    weights: np.ndarray,
    turning: np.ndarray,
    cells: np.ndarray,
    cells_needed: np.ndarray,
    prices: np.ndarray,
    prune: bool,
    results: np.ndarray,
) -> None:
    """Roll every plan out; with `prune` no further than it takes to see that it is not the cheapest.

    One function on purpose: parted into steps, discs and cells it takes a third longer (1.8 for 1.3 ms).

    Args:
        robot: (x, y, yaw).
        plans: (c, 8): forward, left, turn of a first step; for how many steps it is repeated; then
            forward, left, turn of the steps after; whether these pursue the target (turning to it,
            stopping at it). Plans that begin alike and follow each other are begun only once.
        target: (x, y).
        gait: Greatest turn of a step, rad; time of a step, s; speeds ahead and aside, m/s.
        places: (h, 2 steps, 2) of moving discs at the samples.
        velocities: (h, 2 steps, 2) of these.
        needed: (h, 2 steps) least distance to each; 0 where the hypothesis says nothing.
        doubts: (h, 2 steps, 3) covariance of its place as `relative_places` writes it, m^2: one deviation
            towards the robot is added to the distance.
        weights: (h,) of each.
        turning: (h, 2 steps) probability that it turns back at that time.
        cells: (k, 2) middles of occupied cells, the nearest to the robot first.
        cells_needed: (k, 2): least distance to each; less than this is a contact.
        prices: Width of the uneasy band, m; price of its inner edge, m; price of missing distance, m/m;
            missing distance that is a contact, m; price of a contact, m; time in which prices fall by
            e, s; time to react, s; what a step within the band of who may turn back there counts; the
            largest deviation that is added, m.
        prune: Whether a plan that costs more than one before it already is given up (harm infinite).
        results: (c, 4) output: harm by movers, harm by cells, distance to the target (least, and a
            little of the last), angle off it at the end.
    """
    max_turn, step_s, top, side = gait[0], gait[1], gait[2], gait[3]
    soft, ease, steep, touch, hard = prices[0], prices[1], prices[2], prices[3], prices[4]
    fade_s, react_s, at_heels, doubtful = prices[5], prices[6], prices[7], prices[8]
    many, samples = needed.shape[0], needed.shape[1]
    most, beside, lead = _distances(velocities, needed, doubts, doubtful)
    worst = np.empty(many)
    late, heels = np.empty(many), np.empty(many)
    fades = np.empty(samples)
    cheapest = math.inf
    near, counts = _within_reach(robot, plans, places, most, turning, soft)
    apart, widest = np.empty(cells.shape[0]), 0.0
    for k in range(cells.shape[0]):
        apart[k] = _distance(cells[k, 0] - robot[0], cells[k, 1] - robot[1]) - 1e-6
        widest = max(widest, cells_needed[k, 0])
    for sample in range(samples):
        fades[sample] = math.exp(-(sample + 1) * 0.5 * step_s / fade_s)
    away = _distance(target[0] - robot[0], target[1] - robot[1])
    begun, begun_worst = np.empty(6), np.empty(many)
    begun_late, begun_heels = np.empty(many), np.empty(many)
    given_up, done = False, 0
    for i in range(plans.shape[0]):
        first = min(int(plans[i, 3]), samples // 2)
        alike = i > 0 and _begin_alike(plans, i)
        if alike and given_up and done < first:
            results[i] = results[i - 1]
            continue
        if alike and first > 0:
            x, y, yaw = float(begun[0]), float(begun[1]), float(begun[2])
            walls, nearest, last = float(begun[3]), float(begun[4]), float(begun[5])
            worst[:] = begun_worst
            late[:] = begun_late
            heels[:] = begun_heels
        else:
            x, y, yaw = float(robot[0]), float(robot[1]), float(robot[2])
            walls, nearest, last = 0.0, away, away
            worst[:] = 0.0
            late[:] = 0.0
            heels[:] = 0.0
        given_up = False
        for step in range(first if alike else 0, samples // 2):
            if step < first:
                forward, left, turn = plans[i, 0], plans[i, 1], plans[i, 2]
            else:
                forward, left, turn = plans[i, 4], plans[i, 5], plans[i, 6]
                if plans[i, 7] > 0.0:
                    dx, dy = target[0] - x, target[1] - y
                    if _distance(dx, dy) < 0.5 * forward:
                        forward, turn = 0.0, 0.0
                    else:
                        error = math.atan2(dy, dx) - yaw
                        error = (error + math.pi) % (2.0 * math.pi) - math.pi
                        turn = min(max(error, -max_turn), max_turn)
                        forward *= max(0.0, math.cos(error - turn))
            c, s = math.cos(yaw), math.sin(yaw)
            dx = 0.5 * (c * forward - s * left)
            dy = 0.5 * (s * forward + c * left)
            yaw += turn
            for half in range(2):
                x += dx
                y += dy
                sample = 2 * step + half
                fade = fades[sample]
                for one in range(counts[sample]):
                    h = near[sample, one]
                    ax = x - places[h, sample, 0]
                    ay = y - places[h, sample, 1]
                    square = ax * ax + ay * ay
                    close = square < (most[h, sample] + soft) ** 2
                    if close:
                        need = _need(needed[h, sample], doubts[h, sample], doubtful, ax, ay)
                        close = square < (need + soft) ** 2
                    if close:
                        gap = need - math.sqrt(square)
                        cost = fade * _harm(gap, soft, ease, steep, touch, hard)
                        if cost > worst[h]:
                            worst[h] = cost
                    heeds = at_heels > 0.0 or not close
                    if half == 1 and heeds and turning[h, sample] > 0.0:
                        missing = _too_late(
                            ax,
                            ay,
                            yaw,
                            velocities[h, sample, 0],
                            velocities[h, sample, 1],
                            beside[h, sample],
                            lead[h, sample],
                            react_s,
                            top,
                            side,
                            max_turn / step_s,
                        )
                        if missing > 0.0:
                            cost = (
                                fade
                                * turning[h, sample]
                                * _harm(missing, soft, ease, steep, touch, hard)
                            )
                            if close:
                                heels[h] += at_heels * cost
                            elif cost > late[h]:
                                late[h] = cost
                gone = _distance(x - robot[0], y - robot[1]) + widest
                for k in range(cells.shape[0]):
                    if apart[k] > gone:  # and so are all after it
                        break
                    ax = x - cells[k, 0]
                    ay = y - cells[k, 1]
                    square = ax * ax + ay * ay
                    if square < cells_needed[k, 0] ** 2:
                        gap = math.sqrt(square)
                        cost = steep * (cells_needed[k, 0] - gap)
                        if gap < cells_needed[k, 1]:
                            cost += hard
                        walls = max(walls, cost * fade)
            last = _distance(target[0] - x, target[1] - y)
            nearest = min(nearest, last)
            if prune:
                harm = walls
                for h in range(many):
                    harm += weights[h] * (worst[h] + late[h] + heels[h])
                left = (samples // 2 - 1 - step) * step_s * top
                if harm + max(nearest - left, 0.0) > cheapest:
                    given_up, done = True, step
                    break
            if step == first - 1:
                begun[:] = np.array((x, y, yaw, walls, nearest, last))
                begun_worst[:] = worst
                begun_late[:] = late
                begun_heels[:] = heels
        if given_up:
            results[i, 0], results[i, 1] = math.inf, 0.0
            results[i, 2], results[i, 3] = nearest, 0.0
            continue
        for h in range(many):  # who is caught up with after the end is charged at the end
            if needed[h, samples - 1] <= 0.0:
                continue
            missing = _too_late(
                x - places[h, samples - 1, 0],
                y - places[h, samples - 1, 1],
                yaw,
                -velocities[h, samples - 1, 0],
                -velocities[h, samples - 1, 1],
                beside[h, samples - 1],
                lead[h, samples - 1],
                0.0,
                top,
                side,
                max_turn / step_s,
            )
            if missing > 0.0:
                cost = fades[samples - 1] * _harm(missing, soft, ease, steep, touch, hard)
                worst[h] = max(worst[h], cost)
        error = math.atan2(target[1] - y, target[0] - x) - yaw
        off = abs((error + math.pi) % (2.0 * math.pi) - math.pi)
        harm = 0.0
        for h in range(many):
            harm += weights[h] * (worst[h] + late[h] + heels[h])
        results[i, 0] = harm
        results[i, 1] = walls
        results[i, 2] = nearest + 0.1 * (last - nearest)
        results[i, 3] = off if nearest > 0.1 else 0.0
        cheapest = min(cheapest, harm + walls + results[i, 2] + MOST_EXTRA)
