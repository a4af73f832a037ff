"""Compiled loops of the baselines: rollouts at constant speed and turn, and times to contact."""

from __future__ import annotations

import math

import numpy as np

from perception.primitives.compiled import njit


@njit(cache=True)
def hold_speeds(
    robot: np.ndarray,
    pairs: np.ndarray,
    step_s: float,
    steps: int,
    discs: np.ndarray,
    cells: np.ndarray,
    cell_m: float,
    target: np.ndarray,
    result: np.ndarray,
) -> None:
    """Roll out each pair of speed and turn, footstep by footstep.

    Args:
        robot: (x, y, yaw).
        pairs: (c, 2) speed, m/s, and turn a step, rad.
        step_s, steps: Duration of a step, and number of steps.
        discs: (n, 5) of x, y, vx, vy, and distance of contact.
        cells: (k, 2) middles of occupied cells.
        cell_m: Distance of contact with these.
        target: (x, y).
        result: (c, 3) output: least gap, m; time without contact, s; angle off the target after the
            first step, rad.
    """
    for i in range(len(pairs)):
        x, y, yaw = robot[0], robot[1], robot[2]
        least, clear_s, off = 1e3, steps * step_s, 0.0
        for step in range(steps):
            x += pairs[i, 0] * step_s * math.cos(yaw)
            y += pairs[i, 0] * step_s * math.sin(yaw)
            yaw += pairs[i, 1]
            t = (step + 1) * step_s
            gap = 1e3
            for j in range(len(discs)):
                dx, dy = discs[j, 0] + t * discs[j, 2] - x, discs[j, 1] + t * discs[j, 3] - y
                gap = min(gap, math.sqrt(dx * dx + dy * dy) - discs[j, 4])
            for k in range(len(cells)):
                dx, dy = cells[k, 0] - x, cells[k, 1] - y
                away = math.sqrt(dx * dx + dy * dy) - cell_m
                if step < 3:
                    gap = min(gap, away + 0.05)
            if gap < 0.0 and clear_s > t:
                clear_s = t
            least = min(least, gap)
            if step == 0:
                error = math.atan2(target[1] - y, target[0] - x) - yaw
                off = abs((error + math.pi) % (2.0 * math.pi) - math.pi)
        result[i, 0], result[i, 1], result[i, 2] = least, clear_s, off


@njit(cache=True)
def times_to_contact(
    place: np.ndarray, velocities: np.ndarray, discs: np.ndarray, result: np.ndarray
) -> None:
    """Time at which each velocity brings a point into contact with the first disc.

    Args:
        place: (x, y).
        velocities: (c, 2), m/s.
        discs: (n, 6) of x, y, vx, vy, radius, and the horizon beyond which a contact does not count.
        result: (c,) output, s; infinite without contact. Inside a disc 0 for motion towards its middle.
    """
    for i in range(len(velocities)):
        first = math.inf
        for j in range(len(discs)):
            px, py = discs[j, 0] - place[0], discs[j, 1] - place[1]
            wx, wy = velocities[i, 0] - discs[j, 2], velocities[i, 1] - discs[j, 3]
            towards = px * wx + py * wy
            if towards <= 0.0:
                continue
            rest = px * px + py * py - discs[j, 4] ** 2
            if rest <= 0.0:
                first = 0.0
                continue
            square = wx * wx + wy * wy
            root = towards * towards - square * rest
            if root <= 0.0:
                continue
            t = (towards - math.sqrt(root)) / square
            if t < discs[j, 5]:
                first = min(first, t)
        result[i] = first
