"""Compiled contacts along plans: the walked places, cells touched there, and a disc's mass under a Gaussian."""

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
    Gait,
    Movers,
)

CHORDS, SHARES = np.polynomial.legendre.leggauss(10)
"""Gauss-Legendre nodes and weights on [-1, 1]."""

ROOT2 = math.sqrt(2.0)
LEAST = 1e-6
"""Smaller probabilities count as none."""

FAR = 4.0
"""Standard deviations beyond which there is no contact."""


@njit(cache=True)
def walked(
    robot: np.ndarray, plan: np.ndarray, target: np.ndarray, gait: Gait, steps: int
) -> np.ndarray:
    """(2 * steps, 3) poses in the middle and at the end of every step of a plan, as `roll_out` walks it.

    Args:
        robot: (x, y, yaw), world frame, m and rad.
        plan: (8,), see `_guard_arguments`.
        target: (x, y), m.
        gait: Limits of a step.
        steps: How many.
    """
    found = np.empty((2 * steps, 3))
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
                    turn = min(max(error, -gait.max_turn_rad), gait.max_turn_rad)
                    forward *= max(0.0, math.cos(error - turn))
        c, s = math.cos(yaw), math.sin(yaw)
        dx = 0.5 * (c * forward - s * left)
        dy = 0.5 * (s * forward + c * left)
        turned = (yaw + turn + math.pi) % (2.0 * math.pi) - math.pi
        found[2 * step] = x + dx, y + dy, turned
        x, y, yaw = x + 2.0 * dx, y + 2.0 * dy, turned
        found[2 * step + 1] = x, y, yaw
    return found


@njit(cache=True)
def touch_cells(
    robot: np.ndarray, plans: np.ndarray, target: np.ndarray, gait: Gait, steps: int, cells: Cells
) -> np.ndarray:
    """Whether every plan (c, 8) comes nearer to an occupied cell than at contact; arguments as for `walked`."""
    found = np.zeros(len(plans), np.bool_)
    for i in range(len(plans)):
        poses = walked(robot, plans[i], target, gait, steps)
        for n in range(len(poses)):
            for k in range(len(cells.places)):
                x, y = poses[n, 0] - cells.places[k, 0], poses[n, 1] - cells.places[k, 1]
                least = cells.needed[k, 1] - 1e-6
                if x * x + y * y < least * least:
                    found[i] = True
                    break
            if found[i]:
                break
    return found


@njit(cache=True)
def disc_mass(x: float, y: float, xx: float, yy: float, xy: float, radius: float) -> float:
    """Probability that a Gaussian offset lies within a disc about the origin.

    Args:
        x, y: Its mean, m.
        xx, yy, xy: Its variances and covariance, m^2.
        radius: Of the disc, m.
    """
    middle, half = 0.5 * (xx + yy), 0.5 * (xx - yy)
    apart = math.sqrt(half * half + xy * xy)
    major, minor = math.sqrt(middle + apart), math.sqrt(max(middle - apart, 1e-12))
    if math.sqrt(x * x + y * y) > radius + FAR * major:
        return 0.0
    angle = 0.5 * math.atan2(2.0 * xy, xx - yy)
    c, s = math.cos(angle), math.sin(angle)
    u, v = c * x + s * y, c * y - s * x
    low, high = (
        max(-radius, v - FAR * minor),
        min(radius, v + FAR * minor),
    )  # across, on the minor axis
    if low >= high:
        return 0.0
    total = 0.0
    for k in range(len(CHORDS)):
        w = 0.5 * (low + high) + 0.5 * (high - low) * CHORDS[k]
        chord = math.sqrt(max(radius * radius - w * w, 0.0))
        along = math.erf((chord - u) / (ROOT2 * major)) - math.erf((-chord - u) / (ROOT2 * major))
        e = (w - v) / minor
        total += SHARES[k] * 0.5 * along * math.exp(-0.5 * e * e)
    return min(total * 0.5 * (high - low) / (minor * math.sqrt(2.0 * math.pi)), 1.0)


@njit(cache=True)
def spreads(covariances: np.ndarray) -> np.ndarray:
    """(k, n, m) largest standard deviations of covariances (k, n, m, 2, 2), m."""
    obstacles, samples, modes = covariances.shape[:3]
    found = np.empty((obstacles, samples, modes))
    for k in range(obstacles):
        for n in range(samples):
            for m in range(modes):
                P = covariances[k, n, m]
                half = 0.5 * (P[0, 0] - P[1, 1])
                apart = math.sqrt(half * half + P[0, 1] * P[0, 1])
                found[k, n, m] = math.sqrt(max(0.5 * (P[0, 0] + P[1, 1]) + apart, 1e-12))
    return found


@njit(cache=True)
def risk(
    robot: np.ndarray, plan: np.ndarray, target: np.ndarray, gait: Gait, steps: int, rests: int,
    movers: Movers, most: float,
) -> float:  # fmt: skip
    """Probability of contact on the first steps of a plan: at its start, in the middle and at the end of each step.

    Then the robot stands for some steps: else backing away would do as long as plans are judged.

    Of each mode of an obstacle the most dangerous instant counts: the error of a prediction hardly changes from one
    instant to the next. Modes exclude each other, obstacles are independent.

    Args:
        robot, plan, target, gait, steps: As in `walked`.
        rests: Steps for which it stands.
        movers: At 2 * (`steps` + `rests`) samples or more.
        most: A result of this or more means only that the probability is not less.
    """
    weights, means, widest = movers.weights, movers.means, movers.widest
    places = walked(robot, plan, target, gait, steps)
    spared = 1.0
    for k in range(weights.shape[0]):
        touched = 0.0
        for m in range(weights.shape[2]):
            worst = 0.0
            for n in range(2 * (steps + rests)):
                if weights[k, n, m] <= max(worst, LEAST):
                    continue
                here = robot if n == 0 else places[min(n, 2 * steps) - 1]
                x, y = means[k, n, m, 0] - here[0], means[k, n, m, 1] - here[1]
                gap = math.sqrt(x * x + y * y) - movers.radii[k]
                if gap > FAR * widest[k, n, m]:
                    continue
                beyond = 0.5 * math.erfc(gap / (ROOT2 * widest[k, n, m]))  # of a half plane
                if weights[k, n, m] * beyond > max(worst, LEAST):
                    P = movers.covariances[k, n, m]
                    mass = disc_mass(x, y, P[0, 0], P[1, 1], P[0, 1], movers.radii[k])
                    worst = max(worst, weights[k, n, m] * mass)
            touched += worst
        spared *= 1.0 - min(touched, 1.0)
        if 1.0 - spared >= most:
            break
    return 1.0 - spared


@njit(cache=True)
def risks(
    robot: np.ndarray, plans: np.ndarray, target: np.ndarray, gait: Gait, steps: int, rests: int,
    movers: Movers,
) -> np.ndarray:  # fmt: skip
    """`risk` of every plan (c, 8)."""
    found = np.empty(len(plans))
    for i in range(len(plans)):
        found[i] = risk(robot, plans[i], target, gait, steps, rests, movers, 2.0)
    return found


@njit(cache=True)
def cheapest(
    robot: np.ndarray, plans: np.ndarray, target: np.ndarray, gait: Gait, steps: int, rests: int,
    movers: Movers, costs: np.ndarray, risk_cost: float,
) -> int:  # fmt: skip
    """Number of the plan (c, 8) with the least sum of its cost and `risk_cost` times its `risk`.

    In the order of their costs, so that most risks need not be computed to the end, or at all.

    Args:
        robot, plans, target, gait, steps, rests, movers: As for `risk`.
        costs: (c,), infinite for plans that are not allowed.
        risk_cost: In the unit of the costs.
    """
    best, least = 0, math.inf
    for i in np.argsort(costs, kind="mergesort"):
        if costs[i] >= least:
            break
        most = (least - costs[i]) / risk_cost
        found = risk(robot, plans[i], target, gait, steps, rests, movers, most)
        if costs[i] + risk_cost * found < least:
            best, least = i, costs[i] + risk_cost * found
    return best


@njit(cache=True)
def out_of_view(
    robot: np.ndarray, plans: np.ndarray, target: np.ndarray, gait: Gait, steps: int, movers: Movers,
    reach: float, near: float, far: float,
) -> np.ndarray:  # fmt: skip
    """Expected number of near movers that every plan (c, 8) has out of view after some steps.

    Args:
        robot, plans, target, gait, steps, movers: As for `risk`.
        reach: Largest bearing that is seen with the head turned, rad.
        near, far: Up to `near`, m, a mover counts whole, beyond `far` not at all.
    """
    found = np.zeros(len(plans))
    n = 2 * steps - 1
    for i in range(len(plans)):
        x, y, yaw = walked(robot, plans[i], target, gait, steps)[n]
        for k in range(movers.weights.shape[0]):
            for m in range(movers.weights.shape[2]):
                dx, dy = movers.means[k, n, m, 0] - x, movers.means[k, n, m, 1] - y
                away = math.sqrt(dx * dx + dy * dy)
                if away >= far:
                    continue
                bearing = math.atan2(dy, dx) - yaw
                bearing = (bearing + math.pi) % (2.0 * math.pi) - math.pi
                if abs(bearing) > reach:
                    found[i] += movers.weights[k, n, m] * min((far - away) / (far - near), 1.0)
    return found
