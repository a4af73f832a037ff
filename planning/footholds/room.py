"""Where the body has room: what stands above the ground round the robot, and the chance that the body touches it.

Ground is what steps lead to from where the robot stands: a riser, the side of a flight or the edge of the upper floor is
no higher than the ground beside it and bars nothing; a wall, a table or a parapet is. What counts for a place is what lies
between the height of a step and the top of the robot above the ground of that place. Where no ground is known yet, what rises no
steeper than a flight may be ground, and bars nothing.

The gap between the body and an obstacle is Gaussian, by the place of the voxel and by that of the body. The voxel with the
largest chance counts, which need not be the nearest: a farther one may be known less well.

Source: ours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.stats import norm

from mapping.ground.obstacles import VOXEL_M, Voxels
from mapping.ground.surface import Surface
from perception.primitives.robot_model import RobotModel

from ..search.path import Terrain
from .search import SLOPE

COUNT = 128  # ours: cells of the map to each side
FIRST_M = -COUNT / 2 * VOXEL_M  # x and y of its corner
BODY_SIGMA_M = 0.02  # ours: of the trunk over the feet, sideways
RISK = 0.05  # ours: largest chance that the circle round the trunk touches something at a place
COMFORT_M, DEAR = 0.30, 4.0  # ours: beyond the gap of that chance, places cost more; most of it
# Ours: distance of ground that is lower than a step, and the cost of that.
EDGE_M, BESIDE, BRINK = 0.35, 2.0, 8.0
LOW_M = 0.10  # ours: above the ground of a place; lower things are stepped over or upon
GAP_M, SAME_M = 0.15, 0.03  # ours: between surfaces that a step crosses; heights of one level
LEVEL_M = 0.05  # ours: heights told apart
SPREAD_M = 0.005  # ours: standard deviations told apart


def terrain(
    surfaces: Sequence[Surface],
    voxels: Voxels,
    robot: RobotModel,
    middle: Float[np.ndarray, "2"],
) -> Terrain:
    """Cost of a place for the body, and places where it may not be.

    Where the robot stands nearer to something than it may, places that are no nearer stay allowed.

    Args:
        surfaces: That steps lead to (`reachable`), body frame; the robot stands at height 0.
        voxels: What stands round it, body frame.
        robot: Radius, height, and how high it steps.
        middle: (x, y) of the body, midway between the feet.
    """
    ground = _ground(surfaces)
    known = np.isfinite(ground)
    column, row = np.floor((voxels.places[:, :2] - FIRST_M) / VOXEL_M).astype(int).T
    inside = (row >= 0) & (row < COUNT) & (column >= 0) & (column < COUNT)
    row, column, z = row[inside], column[inside], voxels.places[inside, 2]
    sigma = np.sqrt(voxels.variance_m2[inside] + BODY_SIGMA_M**2)
    sigma = SPREAD_M * np.ceil(sigma / SPREAD_M - 1e-9)
    filled, away = _nearest(ground, known)
    # Beyond known ground a flight may begin, whose treads are as long as a sole at least.
    flight = filled + robot.steps.up_m / robot.foot_m[0] * away
    # The highest ground beside a voxel, for the error of its place.
    beside = cv2.dilate(np.where(known, ground, flight), np.ones((5, 5)))
    above = z - VOXEL_M / 2 > beside[row, column] + LOW_M
    row, column, z, sigma = row[above], column[above], z[above], sigma[above]
    level = np.round(filled / LEVEL_M).astype(int)
    safe = float(norm.isf(RISK))
    gap = np.full((COUNT, COUNT), math.inf)  # in standard deviations beyond the radius
    clear = np.full((COUNT, COUNT), math.inf)
    for one in np.unique(level):
        low = one * LEVEL_M + LOW_M
        high = (z + VOXEL_M / 2 > low) & (z - VOXEL_M / 2 < one * LEVEL_M + robot.height_m)
        at = level == one
        for spread in np.unique(sigma[high]):
            alike = high & (sigma == spread)
            away = VOXEL_M * _distance(at, row[alike], column[alike])
            away -= VOXEL_M / 2 + robot.radius_m
            gap[at] = np.minimum(gap[at], away / spread)
            clear[at] = np.minimum(clear[at], away - safe * spread)
    column, row = np.floor((middle - FIRST_M) / VOXEL_M).astype(int)
    here = float(gap[row - 1 : row + 2, column - 1 : column + 2].min()) - 1e-6
    least = min(safe, here)
    price = 1.0 + DEAR * np.clip(1.0 - clear / COMFORT_M, 0.0, 1.0) ** 2
    step_m, beside_m = robot.steps.down_m, robot.stance_m
    drop = ground - _lowest(ground, EDGE_M) > step_m
    price[known & drop] += BESIDE
    drop = ground - _lowest(ground, beside_m) > step_m
    rise = -_lowest(-ground, beside_m) - ground > step_m
    price[known & (drop | rise)] += BRINK
    blocked = gap < least
    return Terrain(price, blocked, blocked, np.full(2, FIRST_M), VOXEL_M)


def reachable(surfaces: Sequence[Surface], most_step_m: float) -> list[Surface]:
    """The surfaces that steps lead to from where the robot stands, and others at the height of one of them.

    Args:
        surfaces: Body frame, in the order of the map: the robot stands on the first one.
        most_step_m: Greatest difference of height of a step.
    """
    level = [one for one in surfaces if math.hypot(*one.height[1:]) <= SLOPE]
    if not level:
        return []
    masks, heights = _drawn(level)
    near = np.ones((2 * round(GAP_M / VOXEL_M) + 1,) * 2, np.uint8)
    wide = [cv2.dilate(mask, near).astype(np.bool_) for mask in masks]
    x, y = np.array([one.outline.mean(axis=0) for one in level]).T
    there = np.stack([_plane(one, x, y) for one in level])  # of each at the middle of all
    found = [0]
    for k in found:  # grows
        for other in range(len(level)):
            if other in found:
                continue
            same = abs(there[k, other] - there[other, other]) < SAME_M
            touch = wide[k] & wide[other]
            if same or (
                touch.any()
                and np.abs(heights[k][touch] - heights[other][touch]).min() <= most_step_m
            ):
                found.append(other)
    return [level[k] for k in sorted(found)]


def _ground(surfaces: Sequence[Surface]) -> Float[np.ndarray, "n n"]:
    """Height of the ground, the highest in each cell; NaN where there is none."""
    ground = np.full((COUNT, COUNT), np.nan)
    for mask, height in zip(*_drawn(surfaces), strict=True):
        np.fmax(ground, height, out=ground, where=mask.astype(np.bool_))
    return ground


def _drawn(
    surfaces: Sequence[Surface],
) -> tuple[list[np.ndarray], list[Float[np.ndarray, "n n"]]]:
    """The cells of each surface as an image, and the height of its plane in every cell."""
    axis = FIRST_M + (np.arange(COUNT) + 0.5) * VOXEL_M
    masks = []
    for one in surfaces:
        masks.append(np.zeros((COUNT, COUNT), np.uint8))
        corners = (one.outline - FIRST_M) / VOXEL_M - 0.5
        cv2.fillPoly(masks[-1], [np.round(16.0 * corners).astype(np.int32)], 1, shift=4)
    return masks, [_plane(one, axis, axis[:, None]) for one in surfaces]


def _plane(
    surface: Surface, x: Float[np.ndarray, "..."], y: Float[np.ndarray, "..."]
) -> Float[np.ndarray, "..."]:
    """Height of a surface at places, m."""
    z, along_x, along_y = surface.height
    (x0, y0) = surface.origin
    return np.asarray(z + along_x * (x - x0) + along_y * (y - y0))


def _lowest(ground: Float[np.ndarray, "n n"], within_m: float) -> Float[np.ndarray, "n n"]:
    """The lowest known ground within a distance."""
    size = 2 * round(within_m / VOXEL_M) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    return np.asarray(cv2.erode(np.where(np.isfinite(ground), ground, 99.0), disc))


def _distance(
    at: Bool[np.ndarray, "n n"], row: Int[np.ndarray, "k"], column: Int[np.ndarray, "k"]
) -> Float[np.ndarray, "m"]:
    """Distance of some cells to the nearest of others, in cells."""
    free = np.ones((COUNT, COUNT), np.uint8)
    free[row, column] = 0
    away = cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.asarray(away[at], np.float64)


def _nearest(
    ground: Float[np.ndarray, "n n"], known: Bool[np.ndarray, "n n"]
) -> tuple[Float[np.ndarray, "n n"], Float[np.ndarray, "n n"]]:
    """Unknown cells with the height of the nearest known one, 0 without any, and the distance to that, m."""
    if not known.any():
        return np.zeros_like(ground), np.zeros_like(ground)
    away, label = cv2.distanceTransformWithLabels(
        (~known).astype(np.uint8),
        cv2.DIST_L2,
        cv2.DIST_MASK_PRECISE,
        labelType=cv2.DIST_LABEL_PIXEL,
    )
    of_label = np.zeros(int(label.max()) + 1)
    of_label[label[known]] = ground[known]
    return of_label[label], VOXEL_M * away.astype(np.float64)
