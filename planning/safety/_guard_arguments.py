"""Arguments of the compiled rollouts of the guard: columns of a plan, limits, costs, discs, cells and movers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

FORWARD, LEFT, TURN, REPEAT, THEN_FORWARD, THEN_LEFT, THEN_TURN, PURSUES = range(8)
"""Columns of a plan: the first step, m, m, rad; how many times it is made; the steps after it; whether these turn
to the target and stop there."""


class Gait(NamedTuple):
    """Limits of a step: turn, rad; duration, s; forward and lateral speed, m/s."""

    max_turn_rad: float
    step_s: float
    forward_mps: float
    side_mps: float


class Costs(NamedTuple):
    """How missing distance is charged; costs are metres of detour.

    Args:
        soft_m: Width of the band beyond the required distance.
        soft_cost_m: Cost at the inner edge of that band.
        steep: Cost per metre of missing distance.
        touch_m: Missing distance that is a contact.
        contact_cost_m: Further cost of a contact.
        fade_s: Time after which a cost counts 1/e.
        react_s: Time to react to a reversal.
        following: Share charged for every step within the band of an obstacle that may reverse.
        max_sigma_m: Largest standard deviation added to a distance.
    """

    soft_m: float
    soft_cost_m: float
    steep: float
    touch_m: float
    contact_cost_m: float
    fade_s: float
    react_s: float
    following: float
    max_sigma_m: float


class Discs(NamedTuple):
    """Predicted discs, h hypotheses at n samples, two a step.

    Args:
        places: (h, n, 2) world frame, m.
        velocities: (h, n, 2), m/s.
        needed: (h, n) required distance between the middles, m; 0 where a hypothesis does not apply.
        covariances: (h, n, 3) of the relative position, as `relative_covariances` writes them, m^2.
        weights: (h,) probabilities.
        turning: (h, n) probability of a reversal at that time.
    """

    places: np.ndarray
    velocities: np.ndarray
    needed: np.ndarray
    covariances: np.ndarray
    weights: np.ndarray
    turning: np.ndarray


class Cells(NamedTuple):
    """Occupied cells, nearest to the robot first.

    Args:
        places: (k, 2) middles, world frame, m.
        needed: (k, 2) required distance, and distance of contact, m.
    """

    places: np.ndarray
    needed: np.ndarray


class Movers(NamedTuple):
    """Obstacles that may move, relative to a robot that is surely where its mean is: k obstacles, n samples, m modes.

    Args:
        weights: (k, n, m) probabilities of the modes.
        means: (k, n, m, 2) places, world frame, m.
        covariances: (k, n, m, 2, 2), m^2.
        widest: (k, n, m) their largest standard deviations, m.
        radii: (k,) distances of contact, m.
    """

    weights: np.ndarray
    means: np.ndarray
    covariances: np.ndarray
    widest: np.ndarray
    radii: np.ndarray
