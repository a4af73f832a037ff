"""Fusion of the straight sides of a surface over images.

Source: ours.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from .measured import Side

TURN_RAD, SIGMAS = (
    math.radians(8.0),
    3.0,
)  # ours: lines of one side differ in direction by the larger of both at most
MOST_M, LEAST_M = 0.08, 0.01  # ours: largest and smallest gate for their distance
APART_M = 0.15  # ours: largest gap between two parts of one side


def fuse(sides: list[Side], new: Side) -> None:
    """Fuse a measured side with the same side of the surface, or add it as a new one.

    Of two sides that disagree on what is beyond, the one that more images showed remains.

    Args:
        sides: Of the surface; changed.
        new: As measured.
    """
    best, least = -1, math.inf
    for index, old in enumerate(sides):
        away = _apart(old, new)
        if away is not None and away < least:
            best, least = index, away
    if best < 0:
        sides.append(new)
    elif sides[best].border != new.border:
        old = sides[best]
        if (new.views, -new.variance_at(0.0)) > (old.views, -old.variance_at(0.0)):
            sides[best] = new
    else:
        sides[best] = _fused(sides[best], new)


def moved(side: Side, body: Float[np.ndarray, "2"], covariance: Float[np.ndarray, "3 3"]) -> Side:
    """A side after a motion of the body with the covariance of (x, y, yaw).

    Args:
        side: Map frame.
        body: New (x, y) of the body, m.
        covariance: Along the axes of the map frame.
    """
    lever = side.place - body
    effect = np.array(
        [[0.0, 0.0, -1.0], [*(-side.outward), -float(side.outward @ [-lever[1], lever[0]])]]
    )
    return replace(side, covariance=side.covariance + effect @ covariance @ effect.T)


def _apart(old: Side, new: Side) -> float | None:
    """Distance between two sides in the middle of the new one, in standard deviations; None if they differ."""
    if float(old.outward @ new.outward) <= 0.0:
        return None
    turn, _, P = _seen_from(old, new)
    turn_sigma = math.sqrt(float(P[0, 0] + old.covariance[0, 0]))
    if abs(turn) > max(TURN_RAD, SIGMAS * turn_sigma):
        return None
    runs = old.run(new.ends)
    if max(runs.min() - old.reach[1], old.reach[0] - runs.max()) > APART_M:
        return None
    middle = float(runs.mean())
    away = abs(float(new.across(old.place + middle * old.along)))
    sigma = math.sqrt(old.variance_at(middle) + new.variance_at(0.0))
    if away > min(max(SIGMAS * sigma, LEAST_M), MOST_M):
        return None
    return away / sigma


def _seen_from(old: Side, new: Side) -> tuple[float, float, Float[np.ndarray, "2 2"]]:
    """Turn and distance outwards of a side from another at the place of that, and the covariance there."""
    turn = math.atan2(
        float(old.outward[0] * new.outward[1] - old.outward[1] * new.outward[0]),
        float(old.outward @ new.outward),
    )
    off = -float(new.across(old.place)) / math.cos(turn)
    shift = np.array([[1.0, 0.0], [-float(new.run(old.place)), 1.0]])
    return turn, off, shift @ new.covariance @ shift.T


def _fused(old: Side, new: Side) -> Side:
    """One side of both."""
    turn, off, P = _seen_from(old, new)
    K = old.covariance @ np.linalg.inv(old.covariance + P)
    turn, off = (float(v) for v in K @ np.array([turn, off]))
    c, s = math.cos(turn), math.sin(turn)
    outward = np.array([[c, -s], [s, c]]) @ old.outward
    place = old.place + off * old.outward
    weight = min(max(float(K[1, 1]), 0.0), 1.0)
    fused = replace(
        old,
        place=place,
        outward=outward,
        covariance=(np.eye(2) - K) @ old.covariance,
        lasting_m=(1.0 - weight) * old.lasting_m + weight * new.lasting_m,
        shared_m=(1.0 - weight) * old.shared_m + weight * new.shared_m,
        views=old.views + new.views,
    )
    runs = np.concatenate([fused.run(old.ends), fused.run(new.ends)])
    return replace(fused, reach=(float(runs.min()), float(runs.max())))
