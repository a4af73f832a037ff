"""Plane regions and edges as measurements of a staircase, linearised, with the covariance of all of them together.

The parameters are (tilt, tilt, yaw, s0, tread, h0, riser): the two tilts of up about the tangents of the prior, the yaw of
the direction of rise about up, and the lines s0 + k tread and h0 + k riser of nosings and levels. A level measures its
tilts and the height of its middle (3 numbers; below the camera the height would change with the square of the tilts), a
riser or a nosing its yaw and its place along the direction (2 numbers).

Source: ours.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..primitives.plane import Plane
from .matching import Match, Nosing
from .region import Region


class Measurements(NamedTuple):
    """Residuals: predicted minus measured.

    Args:
        residual: (n,).
        H: (n, 7), derivative of the prediction.
        weighing: (n, n), covariance if the distortion of one region did not tell that of another.
        covariance: (n, n) of the measurements.
        rows: Rows of each measurement: the levels of a match, then its nosings; the prior is not among them.
    """

    residual: Float[np.ndarray, "n"]
    H: Float[np.ndarray, "n 7"]
    weighing: Float[np.ndarray, "n n"]
    covariance: Float[np.ndarray, "n n"]
    rows: list[slice]


def measured(
    regions: list[Region], prior: Plane, match: Match, x: Float[np.ndarray, "7"]
) -> Measurements:
    """All measurements of a match, linearised at parameters x."""
    up, direction, left = match.axes(prior, x[:3])
    tilts = prior.tangents
    used = [index for index, _ in match.levels]
    used += [one.region for one in match.nosings if one.region not in used]
    place = {index: 3 * k for k, index in enumerate(used)}
    planes, edges = 3 * len(used), 2 * len(match.nosings)
    count = 2 + 3 * len(match.levels) + 2 * len(match.nosings)
    residual, H = np.zeros(count), np.zeros((count, 7))
    G = np.zeros(
        (count, 2 + planes + edges)
    )  # of the errors of the prior, the planes and the edges
    residual[:2], H[:2, :2], G[:2, :2] = x[:2], np.eye(2), np.eye(2)
    mark = np.zeros(count)  # outward shift of all edges
    rows, row = [], 2
    for index, k in match.levels:
        plane, middle = regions[index].plane, regions[index].middle
        here = slice(row, row + 3)
        level = Plane(up, -float(x[5] + k * x[6]))
        residual[here] = plane.error_to(level)
        residual[row + 2] = level.distance(middle)
        H[row : row + 2, :2] = plane.tangents @ tilts.T
        H[row + 2, :2] = tilts @ middle
        H[row + 2, 5], H[row + 2, 6] = -1.0, -float(k)
        at_middle = np.eye(3)
        at_middle[2, :2] = plane.tangents @ middle
        G[here, 2 + place[index] : 5 + place[index]] = at_middle
        rows.append(here)
        row += 3
    for number, one in enumerate(match.nosings):
        here = slice(row, row + 2)
        mark[row + 1] = one.shared_m
        yaw, lever = _line(regions[one.region], one, direction, left)
        residual[here] = yaw, x[3] + one.number * x[4] - direction @ one.middle
        H[row, 2] = 1.0
        H[row + 1, 2] = -float(left @ one.middle)
        H[row + 1, :2] = (tilts @ direction) * float(up @ one.middle)
        H[row + 1, 3], H[row + 1, 4] = 1.0, float(one.number)
        G[here, 2 + place[one.region] : 5 + place[one.region]] = lever
        G[here, 2 + planes + 2 * number : 4 + planes + 2 * number] = np.eye(2)
        rows.append(here)
        row += 2
    own = np.zeros((G.shape[1], G.shape[1]))
    own[:2, :2] = prior.covariance[:2, :2]
    shared = np.zeros((G.shape[1], regions[used[0]].shared.shape[1]))
    for index in used:
        here = slice(2 + place[index], 5 + place[index])
        own[here, here] = regions[index].own
        shared[here] = regions[index].shared
    for number, one in enumerate(match.nosings):
        here = slice(2 + planes + 2 * number, 4 + planes + 2 * number)
        own[here, here] = one.covariance
    common = np.column_stack([G @ shared, mark])
    independent = G @ own @ G.T
    covariance = independent + common @ common.T
    for here in rows:
        independent[here, here] = covariance[here, here]
    return Measurements(residual, H, independent, covariance, rows)


def _line(
    region: Region,
    one: Nosing,
    direction: Float[np.ndarray, "3"],
    left: Float[np.ndarray, "3"],
) -> tuple[float, Float[np.ndarray, "2 3"]]:
    """Yaw of the direction less that of a riser or an edge, and how yaw and place of it depend on its plane."""
    plane = region.plane
    lever = np.zeros((2, 3))
    if one.is_riser:
        facing = -plane.normal
        yaw = -float(facing @ left) / float(facing @ direction)
        turn = plane.tangents @ left  # of the normal, about up
        lever[0, :2] = -turn / float(facing @ direction)
        lever[1] = np.array([*(plane.tangents @ one.middle), 1.0]) / float(facing @ direction)
        return yaw, lever
    along = one.ends[1] - one.ends[0]
    across = float(along @ direction) / float(
        along @ left
    )  # tangent of the edge against the line across
    shifts = []
    for end in (*one.ends, one.middle):
        push = (
            np.array([*(plane.tangents @ end), 1.0]) / plane.offset_m
        )  # of the point along its ray
        shifts.append(float(end @ direction) * push)
    lever[0] = -(shifts[1] - shifts[0]) / float(along @ left)
    lever[1] = shifts[2]
    return across, lever
