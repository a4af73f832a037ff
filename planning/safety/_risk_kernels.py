"""Compiled probabilities of contact along plans, from a disc's mass under a Gaussian."""

from __future__ import annotations

import math

import numpy as np

from perception.primitives.compiled import njit

from ._guard_arguments import Movers

CHORDS, SHARES = np.polynomial.legendre.leggauss(10)
"""Gauss-Legendre nodes and weights on [-1, 1]."""

ROOT2 = math.sqrt(2.0)
LEAST = 1e-6
"""Smaller probabilities count as none."""

FAR = 4.0
"""Standard deviations beyond which there is no contact."""


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
def risk(robot: np.ndarray, places: np.ndarray, rests: int, movers: Movers, most: float) -> float:
    """Probability of contact on a plan: at its start, in the middle and at the end of each step.

    Then the robot stands for some steps: else backing away would do as long as plans are judged.

    Of each mode of an obstacle the most dangerous instant counts: the error of a prediction hardly changes from one
    instant to the next. Modes exclude each other, obstacles are independent.

    Args:
        robot: (x, y, yaw) at the start, world frame, m and rad.
        places: (n, 3) poses in the middle and at the end of every step.
        rests: Steps for which it stands.
        movers: At n + 2 * `rests` samples or more.
        most: A result of this or more means only that the probability is not less.
    """
    weights, means, widest = movers.weights, movers.means, movers.widest
    spared = 1.0
    for k in range(weights.shape[0]):
        touched = 0.0
        for m in range(weights.shape[2]):
            worst = 0.0
            for n in range(len(places) + 2 * rests):
                if weights[k, n, m] <= max(worst, LEAST):
                    continue
                here = robot if n == 0 else places[min(n, len(places)) - 1]
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
    robot: np.ndarray, places: np.ndarray, samples: int, rests: int, movers: Movers
) -> np.ndarray:
    """`risk` of the first samples of every plan, with poses (c, n, 3)."""
    found = np.empty(len(places))
    for i in range(len(places)):
        found[i] = risk(robot, places[i, :samples], rests, movers, 2.0)
    return found


@njit(cache=True)
def cheapest(
    robot: np.ndarray, places: np.ndarray, rests: int, movers: Movers, costs: np.ndarray, risk_cost: float
) -> int:  # fmt: skip
    """Number of the plan with the least sum of its cost and `risk_cost` times its `risk`.

    In the order of their costs, so that most risks need not be computed to the end, or at all.

    Args:
        robot, rests, movers: As for `risk`.
        places: (c, n, 3) poses of the plans.
        costs: (c,), infinite for plans that are not allowed.
        risk_cost: In the unit of the costs.
    """
    best, least = 0, math.inf
    for i in np.argsort(costs, kind="mergesort"):
        if costs[i] >= least:
            break
        most = (least - costs[i]) / risk_cost
        found = risk(robot, places[i], rests, movers, most)
        if costs[i] + risk_cost * found < least:
            best, least = i, costs[i] + risk_cost * found
    return best
