"""Arguments of the compiled rollouts of the guard: columns of a plan, costs, cells and movers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

FORWARD, LEFT, TURN, REPEAT, THEN_FORWARD, THEN_LEFT, THEN_TURN, PURSUES = range(8)
"""Columns of a plan: the first step, m, m, rad; how many times it is made; the steps after it; whether these turn
to the target and stop there."""


class Costs(NamedTuple):
    """How missing distance is charged; costs are metres of detour.

    Args:
        steep: Cost per metre of missing distance.
        contact_cost_m: Further cost of a contact.
        fade_s: Time after which a cost counts 1/e.
    """

    steep: float
    contact_cost_m: float
    fade_s: float


class Cells(NamedTuple):
    """Occupied cells, and small things that stand and that no cell shows, nearest to the robot first.

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
