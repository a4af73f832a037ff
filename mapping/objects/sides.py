"""Sides of an outline: which of them were seen, and how well their places are known.

A side was seen where parts of vertical faces lie on it that were seen from its outer side, over at least half of its
length. Where only a top ends, the picture may have ended. The variance of its place has three parts: the uncertainty of
the pose from which it was seen, which all its points share; the noise of its points, which averages over the length of
the side; and the bias of a face in fused depth. Opposite sides share the uncertainty of the pose as far as both have it,
because poses drift: what is added between two of them is the difference of their variances. The shared part moves a box
and leaves its size alone.

Source: ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from .columns import CELL_M, Columns
from .free_cells import Ring

EDGE_SIGMA_M = 0.01  # ours: standard deviation of the bias of a face in fused depth
NEAR_M = 0.04  # ours: columns this close to a side are on it
SEEN_SHARE = 0.5  # ours: of the length of a side that must be seen


@dataclass(frozen=True, eq=False)
class Sides:
    """Sides of an outline.

    Args:
        seen: Whether each was seen.
        sigma_m: Standard deviation of the place of each; NaN where it was not seen.
        pose_m: The part of it by the uncertainty of the pose.
    """

    seen: Bool[np.ndarray, "k"]
    sigma_m: Float[np.ndarray, "k"]
    pose_m: Float[np.ndarray, "k"]


@dataclass(frozen=True, eq=False)
class Box:
    """A rectangle on the floor.

    Args:
        centre: (2,), world frame, m.
        length_m: The longer side.
        width_m: The shorter side.
        yaw_rad: Direction of the longer side, in [-pi/2, pi/2).
        sigma_length_m, sigma_width_m: Standard deviations; NaN where an end was not seen.
        covariance: (2, 2) of the centre, m^2; NaN where an end was not seen.
    """

    centre: Float[np.ndarray, "2"]
    length_m: float
    width_m: float
    yaw_rad: float
    sigma_length_m: float
    sigma_width_m: float
    covariance: Float[np.ndarray, "2 2"]


def sides_of(ring: Ring, columns: Columns) -> Sides:
    """Sides of an outline that runs counter-clockwise, by the columns of the object."""
    count = len(ring)
    seen, (sigma, pose) = np.zeros(count, np.bool_), np.full((2, count), np.nan)
    towards = columns.to_sensor
    for k in range(count):
        start, step = ring[k], ring[(k + 1) % count] - ring[k]
        length = float(np.linalg.norm(step))
        if length < 1e-9:
            continue
        tangent = step / length
        outward = np.array([tangent[1], -tangent[0]])
        off = (columns.xy - start) @ outward
        along = (columns.xy - start) @ tangent
        near = (np.abs(off) <= NEAR_M) & (along >= 0.0) & (along <= length)
        front = towards @ outward > 0.0
        front |= np.isnan(towards).any(axis=1)
        near &= front & columns.upright
        strips = np.unique(np.floor(along[near] / (2 * CELL_M))).size
        if strips < SEEN_SHARE * math.ceil(length / (2 * CELL_M)):
            continue
        seen[k] = True
        noise = float(np.average(columns.noise_variance[near], weights=columns.weight[near]))
        shared = float(np.average(columns.pose_variance[near], weights=columns.weight[near]))
        spread = 1.48 * float(np.median(np.abs(off[near] - np.median(off[near]))))
        pose[k] = math.sqrt(shared)
        sigma[k] = math.sqrt(EDGE_SIGMA_M**2 + shared + (noise + spread**2) / strips)
    return Sides(seen, sigma, pose)


def box_of(ring: Ring, sides: Sides) -> Box | None:
    """The box of an outline of four sides; None of any other."""
    if len(ring) != 4:
        return None
    along, across = ring[1] - ring[0], ring[3] - ring[0]
    size = np.array([np.linalg.norm(along), np.linalg.norm(across)])
    axes = np.stack([along / size[0], across / size[1]])
    deviations = np.stack([sides.sigma_m, sides.pose_m])[:, [[1, 3], [0, 2]]]  # +x -x, +y -y
    whole, pose = np.where(sides.seen[[[1, 3], [0, 2]]], deviations, np.nan) ** 2
    shared = pose.min(axis=1)
    spread = whole.sum(axis=1) - 2.0 * shared
    yaw = math.atan2(along[1], along[0])
    covariance = axes.T @ np.diag(shared + spread / 4.0) @ axes
    if size[0] < size[1]:
        size, spread, yaw = size[::-1], spread[::-1], yaw + math.pi / 2
    return Box(
        ring.mean(axis=0),
        float(size[0]),
        float(size[1]),
        (yaw + math.pi / 2) % math.pi - math.pi / 2,
        math.sqrt(spread[0]),
        math.sqrt(spread[1]),
        covariance,
    )
