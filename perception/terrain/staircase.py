"""A staircase from plane regions: riser, tread, direction and first edge, with their joint covariance.

Level regions are treads, upright ones are risers. The levels of treads are h0 + k r above the camera, nosings and risers
lie at s0 + k t along the direction of rise, k the number of the step. All planes and edges are fitted together, with the
upright direction: r is the distance of parallel planes, which no single pair of them tells as well. The errors of a view's
distortion are common to all of them and enter as such (`Region.shared`).

A staircase is claimed only if at least two levels and two nosings, five in all, fit one riser and one tread; of boards
without risers three edges. No tread may lie midway between two of its levels: every second step of a flight is evenly
spaced, too. Everything else is unknown, not a staircase.

Source: ours; weighted least squares. Bounds of riser and tread: building codes, wider.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.special import gammaincinv

from ..primitives.plane import Plane
from .matching import LEAST_COMMON, LEVEL_RAD, RISER_M, TREAD_M, Match, matches
from .measurements import Measurements, measured
from .region import Region

CONFIDENCE = 0.999  # ours: of the chi-square tests
TURNS = 4  # ours: linearisations
LEAST_LEVELS, LEAST_NOSINGS, LEAST_NEAR_EDGES = 2, 2, 3  # ours: boards hide parts of each other
LEAST_SUM = 5  # ours: levels and nosings
BETWEEN = 0.25  # ours: of a riser; a tread farther from every level is nearer to the middle of two


@dataclass(frozen=True)
class Staircase:
    """A staircase seen by one camera; camera frame, m and rad.

    Args:
        riser_m: Rise of a step.
        tread_m: Going of a step: distance of nosings along the direction.
        steps: Number of risers seen.
        direction: Horizontal unit vector in which it rises.
        up: Unit vector.
        first_edge: A point on the nosing nearest to the camera, in the middle of what is seen.
        ascends: Whether it rises away from the camera.
        covariance: (5, 5) of (riser, tread, yaw of the direction about `up`, place of the first edge along `direction` and
            along `up`, beside `first_edge`), with what is not known of `up`.
        treads: Indices of the regions that are its treads, the landings included; the lowest first.
    """

    riser_m: float
    tread_m: float
    steps: int
    direction: Float[np.ndarray, "3"]
    up: Float[np.ndarray, "3"]
    first_edge: Float[np.ndarray, "3"]
    ascends: bool
    covariance: Float[np.ndarray, "5 5"]
    treads: tuple[int, ...]


def find(regions: list[Region], prior: Plane) -> Staircase | None:
    """The staircase that explains most regions.

    Args:
        regions: Of one view, from `segmentation.find`.
        prior: Predicted floor, camera frame, with covariance; only its tilt is used.

    Returns:
        The staircase; None if too few levels and nosings are evenly spaced.
    """
    for match in matches(regions, prior):
        found = _fitted(regions, prior, match)
        if found is not None:
            return found
    return None


def _fitted(regions: list[Region], prior: Plane, match: Match) -> Staircase | None:
    """The staircase of a match, without what does not fit it; None if too little is left."""
    while True:
        nosings = {one.number for one in match.nosings}
        levels = {number for _, number in match.levels}
        least = LEAST_NEAR_EDGES if _by_near_edges(regions, prior, match) else LEAST_NOSINGS
        if len(levels) < LEAST_LEVELS or len(nosings) < least:
            return None
        if len(levels) + len(nosings) < LEAST_SUM:
            return None
        x = np.array([0.0, 0.0, match.yaw, match.s0, match.tread_m, match.h0, match.riser_m])
        P = np.eye(7)
        for _ in range(TURNS):
            linear = measured(regions, prior, match, x)
            x, P = _solved(linear, x)
        linear = measured(regions, prior, match, x)
        worst, excess = _worst(linear)
        if excess <= 1.0:
            if _is_part(regions, prior, match, x):
                return None
            return _staircase(regions, prior, match, x, _scale(linear) * P)
        match = match.without(worst)


def _is_part(regions: list[Region], prior: Plane, match: Match, x: Float[np.ndarray, "7"]) -> bool:
    """Whether a level region across the flight lies between two of its levels: the match has only some of the steps."""
    up, direction, left = match.axes(prior, x[:3])
    _, _, _, s0, tread, h0, riser = (float(v) for v in x)
    numbers = [one.number for one in match.nosings] + [number for _, number in match.levels]
    first, last = (s0 + k * tread for k in (min(numbers), max(numbers)))
    spans = np.array([np.sort(one.ends @ left) for one in match.nosings])
    low, high = spans[:, 0].max(), spans[:, 1].min()
    for one in regions:
        step = (float(up @ one.middle) - h0) / riser
        if not min(numbers) < step < max(numbers) or one.slope_rad(up) > LEVEL_RAD:
            continue
        across = one.outline @ left
        wide = min(across.max(), high) - max(across.min(), low)
        inside = first < float(direction @ one.middle) < last and wide > LEAST_COMMON * (high - low)
        if inside and abs(step - round(step)) > BETWEEN:
            return True
    return False


def _by_near_edges(regions: list[Region], prior: Plane, match: Match) -> bool:
    """Whether the nosings are edges of treads that lead up: those of boards without risers."""
    _, direction, _ = match.axes(prior, np.array([0.0, 0.0, match.yaw]))
    places = [float(direction @ regions[one.region].middle) for one in match.nosings]
    return not any(one.is_riser for one in match.nosings) and sum(places) > 0.0


def _solved(
    linear: Measurements, x: Float[np.ndarray, "7"]
) -> tuple[Float[np.ndarray, "7"], Float[np.ndarray, "7 7"]]:
    """Least squares: the parameters and their covariance.

    The weights take the distortion of each region as its own. Exact generalised least squares would take what regions
    share of it out of their differences, and trust its shape to a fraction that no sensor keeps.
    """
    weighted = np.linalg.solve(linear.weighing, linear.H)
    gain = np.linalg.solve(linear.H.T @ weighted, weighted.T)
    return x - gain @ linear.residual, gain @ linear.covariance @ gain.T


def _worst(linear: Measurements) -> tuple[int, float]:
    """The measurement that fits least, and its squared residual in units of the largest that chance explains."""
    worst, excess = 0, 0.0
    for index, rows in enumerate(linear.rows):
        e, P = linear.residual[rows], linear.covariance[rows, rows]
        bound = 2.0 * float(gammaincinv(len(e) / 2.0, CONFIDENCE))
        ratio = float(e @ np.linalg.solve(P, e)) / bound
        if ratio > excess:
            worst, excess = index, ratio
    return worst, excess


def _scale(linear: Measurements) -> float:
    """By how much the residuals exceed their covariance (Birge 1932); 1 if they do not."""
    e = linear.residual
    return max(
        1.0, float(e @ np.linalg.solve(linear.weighing, e)) / max(len(e) - linear.H.shape[1], 1)
    )


def _staircase(
    regions: list[Region],
    prior: Plane,
    match: Match,
    x: Float[np.ndarray, "7"],
    P: Float[np.ndarray, "7 7"],
) -> Staircase | None:
    """The values of the parameters, if they are those of a staircase."""
    up, direction, left = match.axes(prior, x[:3])
    numbers = [number for _, number in match.levels]
    nosings = [one.number for one in match.nosings]
    lowest = min(min(numbers), min(nosings) - 1)
    highest = max(max(numbers), max(nosings))
    middles = np.array([regions[index].middle for index, _ in match.levels])
    ascends = bool(np.mean(middles @ direction) > 0.0)
    first = lowest + 1 if ascends else highest
    _, _, _, s0, tread, h0, riser = (float(v) for v in x)
    if not (RISER_M[0] <= riser <= RISER_M[1] and TREAD_M[0] <= tread <= TREAD_M[1]):
        return None
    s, h = s0 + first * tread, h0 + first * riser
    across = float(np.mean(middles @ left))
    edge = s * direction + h * up + across * left
    J = np.zeros((5, 7))
    J[0, 6] = J[1, 4] = J[2, 2] = J[3, 3] = J[4, 5] = 1.0
    J[3, 4] = J[4, 6] = first
    J[3, :2], J[3, 2] = h * prior.tangents @ direction, -across  # lines turn about the camera,
    J[4, :2] = -prior.tangents @ edge  # so that the edge moves with the tilts and the yaw
    return Staircase(
        riser,
        tread,
        highest - lowest,
        direction,
        up,
        edge,
        ascends,
        J @ P @ J.T,
        tuple(index for index, _ in sorted(match.levels, key=lambda one: one[1])),
    )
