"""Compiled rollouts of the guard: where candidate steps lead, and what they come close to.

A step moves the body along its old heading, then turns it. Positions are sampled in the middle and at
the end of every step. Arrays and scalars only.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True)
def roll_out(
    robot: np.ndarray,
    candidates: np.ndarray,
    target: np.ndarray,
    steps: int,
    max_turn: float,
    hypotheses: np.ndarray,
    needed: np.ndarray,
    cells: np.ndarray,
    cells_needed: np.ndarray,
    weight: float,
    soft: float,
    step_s: float,
    fade_s: float,
    results: np.ndarray,
) -> None:
    """Roll every candidate out.

    Args:
        robot: (x, y, yaw).
        candidates: (c, 8): forward, left, turn of a first step; for how many steps it is repeated; then
            forward, left, turn of the steps after; whether these pursue the target (turning to it,
            stopping at it).
        target: (x, y).
        steps: Steps to roll out.
        max_turn: Of one step, for pursuit.
        hypotheses: (h, 2 steps, 2) positions of moving discs at the samples.
        needed: (h, 2 steps) least distance to each; 0 where the hypothesis says nothing.
        cells: (k, 2) middles of occupied cells.
        cells_needed: (k,) least distance to each.
        weight: Of a violation of these.
        soft: Width of the band beyond the needed distance in which a rollout is clear but uneasy.
        step_s: Time of one step.
        fade_s: Time in which the weight of a violation falls by e: the later, the more can be done.
        results: (c, 4) output: worst weighted violation (0: clear), worst weighted unease in [0, 1],
            distance to the target (least, and a little of the last), angle off it at the end.
    """
    for i in range(candidates.shape[0]):
        x, y, yaw = robot[0], robot[1], robot[2]
        worst, unease = 0.0, 0.0
        nearest = math.hypot(target[0] - x, target[1] - y)
        last = nearest
        off = 0.0
        for step in range(steps):
            if step < candidates[i, 3]:
                forward, left, turn = candidates[i, 0], candidates[i, 1], candidates[i, 2]
            else:
                forward, left, turn = candidates[i, 4], candidates[i, 5], candidates[i, 6]
                if candidates[i, 7] > 0.0:
                    dx, dy = target[0] - x, target[1] - y
                    if math.hypot(dx, dy) < 0.5 * forward:
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
                fade = math.exp(-(sample + 1) * 0.5 * step_s / fade_s)
                for h in range(hypotheses.shape[0]):
                    need = needed[h, sample]
                    if need <= 0.0:
                        continue
                    ax = x - hypotheses[h, sample, 0]
                    ay = y - hypotheses[h, sample, 1]
                    square = ax * ax + ay * ay
                    if square < (need + soft) ** 2:
                        distance = math.sqrt(square)
                        if distance < need:
                            worst = max(worst, (need - distance) * fade)
                        unease = max(unease, fade * min(1.0, (need + soft - distance) / soft))
                for k in range(cells.shape[0]):
                    ax = x - cells[k, 0]
                    ay = y - cells[k, 1]
                    square = ax * ax + ay * ay
                    if square < cells_needed[k] ** 2:
                        worst = max(worst, weight * (cells_needed[k] - math.sqrt(square)) * fade)
            last = math.hypot(target[0] - x, target[1] - y)
            nearest = min(nearest, last)
        error = math.atan2(target[1] - y, target[0] - x) - yaw
        off = abs((error + math.pi) % (2.0 * math.pi) - math.pi)
        results[i, 0] = worst
        results[i, 1] = unease
        results[i, 2] = nearest + 0.1 * (last - nearest)
        results[i, 3] = off if nearest > 0.1 else 0.0
