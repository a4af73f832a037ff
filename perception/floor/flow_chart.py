"""The floor by the flow chart of seed 003 without changes, for comparison with `hough`.

It has three weaknesses, which experiment INT-3 measures:

- the plane's parameters are (rho, theta, phi) of `x cos(theta) sin(phi) + y sin(theta) sin(phi) +
  z cos(phi) = rho`. With z up, the floor is at phi = 0, where theta is undefined, so its votes scatter over
  all theta. (The sign of rho is opposite to the `n.p + rho = 0` of the same section.)
- rho is measured at the camera, where a degree of tilt is centimetres of rho.
- Least squares runs over points in space with the weight 1/Z^2, although the noise is along the ray.

Source: seed 003, section 3, Fig. 4, steps 1 to 6.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from ..depth.points import Points
from ..primitives.plane import Plane

NEAREST_M, FARTHEST_M, MOST_POINTS = 0.2, 3.0, 20_000  # step 1
K_MAX, T_V, T_MIN = 3000, 60, 15  # steps 2 and 4
MOST_TILT = math.radians(25.0)  # step 2
ANGLE_CELL, RHO_CELL_M = math.radians(2.0), 0.02  # step 3
BASE_M, SIGMAS = 0.01, 3.0  # step 5
LEAST_RATIO, MOST_TURN, MOST_LIFT_M = 0.2, math.radians(10.0), 0.05  # step 6


def find_as_printed(points: Points, prior: Plane, rng: np.random.Generator) -> Plane | None:
    """The floor by steps 1 to 6; None where the chart keeps the kinematic plane.

    Args:
        points: Camera frame, m.
        prior: The floor by the joint angles, camera frame; its covariance is not used.
        rng: Draws points and triples.

    Returns:
        The plane in the camera frame, without covariance.
    """
    reach = (points.xyz[:, 2] >= NEAREST_M) & (points.xyz[:, 2] <= FARTHEST_M)
    index = np.flatnonzero(reach)
    if len(index) > MOST_POINTS:
        index = rng.choice(index, MOST_POINTS, replace=False)
    if len(index) < 3:
        return None
    axes = np.stack([*prior.tangents, prior.normal])  # up is the third axis
    xyz, sigma = points.xyz[index] @ axes.T, points.sigma[index]
    z = points.xyz[index, 2]
    normal, height = _vote(xyz, rng)
    if height <= 0.0:
        return None
    for _ in range(2):
        near = np.abs(xyz @ normal + height) < BASE_M + SIGMAS * sigma * height / z
        if np.count_nonzero(near) < 3:
            return None
        normal, height = _least_squares(xyz[near], 1.0 / z[near] ** 2)
    near = np.abs(xyz @ normal + height) < BASE_M + SIGMAS * sigma * height / z
    plane = Plane(axes.T @ normal, height)
    accepted = (
        float(np.mean(near)) >= LEAST_RATIO
        and plane.angle_to(prior) <= MOST_TURN
        and abs(plane.offset_m - prior.offset_m) <= MOST_LIFT_M
    )
    return plane if accepted else None


def _vote(
    xyz: Float[np.ndarray, "n 3"], rng: np.random.Generator
) -> tuple[Float[np.ndarray, "3"], float]:
    """Normal and height of the first cell with T_v votes, or of the fullest; height 0 below T_min votes."""
    a, b, c = xyz[rng.integers(0, len(xyz), (3, K_MAX))]
    normals = np.cross(b - a, c - a)
    area = np.linalg.norm(normals, axis=1)
    good = area > 1e-6
    normals[good] /= area[good, None]
    normals *= np.where(normals[:, 2] < 0.0, -1.0, 1.0)[:, None]
    good &= normals[:, 2] >= math.cos(MOST_TILT)
    phi = np.arccos(np.clip(normals[:, 2], -1.0, 1.0))
    theta = np.arctan2(normals[:, 1], normals[:, 0])
    rho = np.einsum("ij,ij->i", normals, a)
    values = np.column_stack([theta, phi, rho])[good]
    cells = np.floor(values / [ANGLE_CELL, ANGLE_CELL, RHO_CELL_M]).astype(np.int64)
    table: dict[tuple[int, ...], list[int]] = {}
    fullest: list[int] = []
    for number, cell in enumerate(map(tuple, cells.tolist())):
        votes = table.setdefault(cell, [])
        votes.append(number)
        if len(votes) > len(fullest):
            fullest = votes
        if len(votes) >= T_V:
            break
    if len(fullest) < T_MIN:
        return np.array([0.0, 0.0, 1.0]), 0.0
    theta_mean, phi_mean, rho_mean = values[fullest].mean(axis=0)
    normal = np.array(
        [
            math.cos(theta_mean) * math.sin(phi_mean),
            math.sin(theta_mean) * math.sin(phi_mean),
            math.cos(phi_mean),
        ]
    )
    return normal, -float(rho_mean)


def _least_squares(
    xyz: Float[np.ndarray, "n 3"], weight: Float[np.ndarray, "n"]
) -> tuple[Float[np.ndarray, "3"], float]:
    """Weighted least-squares plane: normal, up, and height of the camera above it."""
    middle = weight @ xyz / weight.sum()
    centred = xyz - middle
    _, vectors = np.linalg.eigh((centred * weight[:, None]).T @ centred)
    normal = vectors[:, 0] * math.copysign(1.0, vectors[2, 0])
    return normal, -float(normal @ middle)
