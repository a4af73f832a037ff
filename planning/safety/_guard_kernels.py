"""Compiled rollouts of the guard: the poses of candidate plans, and their distances to occupied cells and the target.

A step moves the body along its old heading, then turns it. Positions are sampled in the middle and at the end of every
step.
"""

from __future__ import annotations

import math

import numpy as np

from perception.primitives.compiled import njit

from ._guard_arguments import (
    FORWARD,
    LEFT,
    PURSUES,
    REPEAT,
    THEN_FORWARD,
    THEN_LEFT,
    THEN_TURN,
    TURN,
    Cells,
    Costs,
)


@njit(cache=True)
def walked(
    robot: np.ndarray, plans: np.ndarray, target: np.ndarray, max_turn_rad: float, steps: int
) -> np.ndarray:
    """(c, 2 * steps, 3) poses in the middle and at the end of every step of the plans.

    Args:
        robot: (x, y, yaw), world frame, m and rad.
        plans: (c, 8), see `_guard_arguments`.
        target: (x, y), m.
        max_turn_rad: Largest turn of a step.
        steps: How many.
    """
    found = np.empty((len(plans), 2 * steps, 3))
    for i in range(len(plans)):
        plan = plans[i]
        x, y, yaw = robot[0], robot[1], robot[2]
        for step in range(steps):
            if step < plan[REPEAT]:
                forward, left, turn = plan[FORWARD], plan[LEFT], plan[TURN]
            else:
                forward, left, turn = plan[THEN_FORWARD], plan[THEN_LEFT], plan[THEN_TURN]
                if plan[PURSUES] > 0.0:
                    dx, dy = target[0] - x, target[1] - y
                    if math.sqrt(dx * dx + dy * dy) < 0.5 * forward:
                        forward, turn = 0.0, 0.0
                    else:
                        error = math.atan2(dy, dx) - yaw
                        error = (error + math.pi) % (2.0 * math.pi) - math.pi
                        turn = min(max(error, -max_turn_rad), max_turn_rad)
                        forward *= max(0.0, math.cos(error - turn))
            c, s = math.cos(yaw), math.sin(yaw)
            dx = 0.5 * (c * forward - s * left)
            dy = 0.5 * (s * forward + c * left)
            turned = (yaw + turn + math.pi) % (2.0 * math.pi) - math.pi
            found[i, 2 * step] = x + dx, y + dy, turned
            x, y, yaw = x + 2.0 * dx, y + 2.0 * dy, turned
            found[i, 2 * step + 1] = x, y, yaw
    return found


@njit(cache=True)
def judge(
    robot: np.ndarray, places: np.ndarray, target: np.ndarray, half_s: float, cells: Cells, costs: Costs
) -> np.ndarray:  # fmt: skip
    """(c, 3) cost of cells, m; distance to the target, m (the least, and a tenth of what the last exceeds it); angle
    off the target at the end, rad.

    Args:
        robot: (x, y, yaw), world frame, m and rad.
        places: (c, n, 3) poses of the plans, see `walked`.
        target: (x, y), m.
        half_s: Time between two of them.
        cells: What stands.
        costs: Of missing distance to it.
    """
    found = np.empty((len(places), 3))
    apart, widest = np.empty(len(cells.places)), 0.0
    for k in range(len(cells.places)):
        x, y = cells.places[k, 0] - robot[0], cells.places[k, 1] - robot[1]
        apart[k] = math.sqrt(x * x + y * y) - 1e-6
        widest = max(widest, cells.needed[k, 0])
    fades = np.exp(-half_s / costs.fade_s * np.arange(1, places.shape[1] + 1))
    away = math.sqrt((target[0] - robot[0]) ** 2 + (target[1] - robot[1]) ** 2)
    for i in range(len(places)):
        standing, nearest, last = 0.0, away, away
        for n in range(places.shape[1]):
            x, y = places[i, n, 0], places[i, n, 1]
            gone = math.sqrt((x - robot[0]) ** 2 + (y - robot[1]) ** 2) + widest
            for k in range(len(apart)):
                if apart[k] > gone:  # so are all later ones
                    break
                dx, dy = x - cells.places[k, 0], y - cells.places[k, 1]
                square = dx * dx + dy * dy
                if square < cells.needed[k, 0] ** 2:
                    gap = math.sqrt(square)
                    cost = costs.steep * (cells.needed[k, 0] - gap)
                    if gap < cells.needed[k, 1]:
                        cost += costs.contact_cost_m
                    standing = max(standing, cost * fades[n])
            last = math.sqrt((target[0] - x) ** 2 + (target[1] - y) ** 2)
            nearest = min(nearest, last)
        x, y, yaw = places[i, -1]
        error = math.atan2(target[1] - y, target[0] - x) - yaw
        off = abs((error + math.pi) % (2.0 * math.pi) - math.pi)
        found[i] = standing, nearest + 0.1 * (last - nearest), off if nearest > 0.1 else 0.0
    return found


@njit(cache=True)
def touch_cells(places: np.ndarray, samples: int, cells: Cells) -> np.ndarray:
    """Whether every plan, with poses (c, n, 3), comes nearer to what stands than at contact in its first samples."""
    found = np.zeros(len(places), np.bool_)
    for i in range(len(places)):
        for n in range(samples):
            for k in range(len(cells.places)):
                x, y = places[i, n, 0] - cells.places[k, 0], places[i, n, 1] - cells.places[k, 1]
                least = cells.needed[k, 1] - 1e-6
                if x * x + y * y < least * least:
                    found[i] = True
                    break
            if found[i]:
                break
    return found


@njit(cache=True)
def covered(places: np.ndarray, samples: int, cells: np.ndarray, radius_m: float) -> np.ndarray:
    """(c,) cells that the body covers at once in the first samples of every plan, most of them all.

    Args:
        places: (c, n, 3) poses of the plans, see `walked`.
        samples: How many.
        cells: (k, 2) middles, world frame, m.
        radius_m: Of the body.
    """
    found = np.zeros(len(places))
    for i in range(len(places)):
        for n in range(samples):
            count = 0
            for k in range(len(cells)):
                x, y = places[i, n, 0] - cells[k, 0], places[i, n, 1] - cells[k, 1]
                count += x * x + y * y < radius_m * radius_m
            found[i] = max(found[i], count)
    return found
