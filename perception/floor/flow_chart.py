"""The floor by the flow chart of seed 003: randomised Hough transform, weighted least squares, test against the joints.

The published floor finder, selected by `method = "printed"`. The votes go into cells of (tilt, tilt, distance), the two
tilts about the predicted up. With `literal`, they go into (theta, phi, rho) of `x cos(theta) sin(phi) +
y sin(theta) sin(phi) + z cos(phi) = rho` as that formula is printed: with z up, a floor is at phi = 0, where theta
is undefined, so its votes scatter over all theta. Experiment INT-3 measures both.

What `hough` does otherwise: it measures the distance from the middle of the points, because at the camera a degree of
tilt is centimetres of distance; it chooses among planes by the points below them; its fit has other weights, and
fuses the plane with the prior.

The weight 1 / Z^2 of the least squares is uniform in inverse depth, where the noise of stereo is uniform.

Source: seed 003, section 3, Fig. 4, steps 1 to 6. The covariance is ours.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Bool, Float

from ..depth.distortion import Distortion
from ..depth.points import Points
from ..primitives.plane import Plane
from . import _fit_kernels as kernels
from .common_error import BLOCK, common_covariance
from .prior import gate
from .refine import LEAST_EDGE, NONE, Fit, slope_jacobian
from .sample import SHARP

NEAREST_M, FARTHEST_M, MOST_POINTS = 0.2, 3.0, 20_000  # step 1
K_MAX, T_V, T_MIN = 3000, 60, 15  # steps 2 and 4
MOST_TILT = math.radians(25.0)  # step 2
ANGLE_CELL, RHO_CELL_M = math.radians(2.0), 0.02  # step 3
BASE_M, SIGMAS = 0.01, 3.0  # step 5
LEAST_RATIO, MOST_TURN, MOST_LIFT_M = 0.2, math.radians(10.0), 0.05  # step 6
PRIOR_SIGMAS = (
    4.0  # ours: the limits of steps 2 and 6 where the prior is less sure than a robot's joints
)
STEEPEST = math.radians(60.0)  # ours: with such a prior
LEAST_HEIGHT_M = 0.03  # ours: with such a prior
LEAST_BLOCKS = 5  # ours: image blocks of 10 deg; fewer do not tell correlated errors from a tilt
BAND_PART = 0.7  # ours: of tau, the narrower band; NEES 1.1 and 1.0 in 20 views by stereo and time of flight


def find(
    points: Points,
    prior: Plane,
    rng: np.random.Generator,
    distortion: Distortion = NONE,
    literal: bool = False,
) -> Fit | None:
    """The floor by steps 1 to 6; None where the chart keeps the kinematic plane.

    Args:
        points: Camera frame, m.
        prior: The floor by the joint angles, camera frame. Its covariance widens the limits of steps 2 and 6
            where it is larger than that of joints: a camera in the hand.
        rng: Draws points and triples.
        distortion: Error of depth common to all points, for the covariance.
        literal: Vote in (theta, phi, rho); for comparison.

    Returns:
        The plane in the camera frame, with covariance. It is not fused with the prior.
    """
    z = points.xyz[:, 2]
    index = np.flatnonzero((z >= NEAREST_M) & (z <= FARTHEST_M))
    if len(index) > MOST_POINTS:
        index = rng.choice(index, MOST_POINTS, replace=False)
    if len(index) < 3:
        return None
    wide = gate(prior, PRIOR_SIGMAS, STEEPEST, LEAST_HEIGHT_M)
    lift = max(MOST_LIFT_M, wide.highest_m - prior.offset_m)
    axes = np.stack([*prior.tangents, prior.normal])  # up is the third axis
    drawn = points.of(index)
    xyz = drawn.xyz @ axes.T
    normal, height = _vote(xyz, max(MOST_TILT, wide.tilt_rad), rng, literal)
    for _ in range(2):
        if height < LEAST_HEIGHT_M:
            return None
        near = _near(drawn, xyz @ normal + height, height)
        if np.count_nonzero(near) < 3:
            return None
        normal, height = _least_squares(xyz[near], 1.0 / drawn.xyz[near, 2] ** 2)
    if height < LEAST_HEIGHT_M:
        return None
    plane = Plane(axes.T @ normal, height)
    accepted = (
        float(np.mean(_near(drawn, plane.distance(drawn.xyz), height))) >= LEAST_RATIO
        and plane.angle_to(prior) <= max(MOST_TURN, wide.tilt_rad)
        and abs(plane.offset_m - prior.offset_m) <= lift
    )
    return (
        _with_covariance(points, drawn.of(np.flatnonzero(near)), plane, distortion)
        if accepted
        else None
    )


def _near(
    points: Points, distance: Float[np.ndarray, "n"], height: float, part: float = 1.0
) -> Bool[np.ndarray, "n"]:
    """Points within a part of tau of a plane at these distances."""
    tau = BASE_M + SIGMAS * points.sigma * height / points.xyz[:, 2]
    return np.asarray(np.abs(distance) < part * tau)


def _vote(
    xyz: Float[np.ndarray, "n 3"], most_tilt: float, rng: np.random.Generator, literal: bool
) -> tuple[Float[np.ndarray, "3"], float]:
    """Normal and height of the first cell with T_v votes, or of the fullest; height 0 below T_min votes."""
    a, b, c = xyz[rng.integers(0, len(xyz), (3, K_MAX))]
    normals = np.cross(b - a, c - a)
    area = np.linalg.norm(normals, axis=1)
    good = area > 1e-6
    normals[good] /= area[good, None]
    normals *= np.where(normals[:, 2] < 0.0, -1.0, 1.0)[:, None]
    good &= normals[:, 2] >= math.cos(most_tilt)
    normals, rho = normals[good], -np.einsum("ij,ij->i", normals[good], a[good])
    if literal:
        first = np.arctan2(normals[:, 1], normals[:, 0])  # theta
        second = np.arccos(np.clip(normals[:, 2], -1.0, 1.0))  # phi
    else:
        first, second = np.arctan2(normals[:, :2].T, normals[:, 2])
    values = np.column_stack([first, second, rho])
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
    one, two, height = (float(v) for v in values[fullest].mean(axis=0))
    if literal:
        normal = np.array(
            [math.cos(one) * math.sin(two), math.sin(one) * math.sin(two), math.cos(two)]
        )
    else:
        normal = np.array([math.tan(one), math.tan(two), 1.0])
    return normal / np.linalg.norm(normal), height


def _least_squares(
    xyz: Float[np.ndarray, "n 3"], weight: Float[np.ndarray, "n"]
) -> tuple[Float[np.ndarray, "3"], float]:
    """Weighted least-squares plane: normal, up, and height of the camera above it."""
    middle = weight @ xyz / weight.sum()
    centred = xyz - middle
    _, vectors = np.linalg.eigh((centred * weight[:, None]).T @ centred)
    normal = vectors[:, 0] * math.copysign(1.0, vectors[2, 0])
    return normal, -float(normal @ middle)


def _with_covariance(
    points: Points, used: Points, plane: Plane, distortion: Distortion
) -> Fit | None:
    """The plane with its covariance, and how all points lie about it; None if its points span too few image blocks.

    With r = p / Z and e = n.p / (rho Z) + 1 / Z the errors of inverse depth, the fit minimises the sum of e^2. The
    covariance is that of the jackknife over blocks of the image, because errors of neighbours are correlated, plus
    the shift by a narrower band, because the feet of obstacles within tau are all on one side, plus distortion.
    """
    z = used.xyz[:, 2]
    rays = used.xyz / z[:, None]
    distance = plane.distance(used.xyz)
    error = distance / (plane.offset_m * z)
    cells = ((rays[:, :2].T + kernels.SPAN) * kernels.GRAIN).astype(int)
    column, row = np.clip(cells, 0, kernels.CELLS - 1)
    _, block = np.unique((row // BLOCK) * kernels.CELLS + column // BLOCK, return_inverse=True)
    count = int(block.max()) + 1
    if count < LEAST_BLOCKS:
        return None
    A, g = np.zeros((count, 3, 3)), np.zeros((count, 3))
    np.add.at(A, block, rays[:, :, None] * rays[:, None, :])
    np.add.at(g, block, rays * error[:, None])
    left_out = np.linalg.solve(A.sum(axis=0) - A, g[:, :, None])[:, :, 0]
    core = _near(used, distance, plane.offset_m, BAND_PART)
    shift = np.linalg.lstsq(rays[core], error[core], rcond=None)[0]
    own = left_out.T @ left_out + np.outer(shift, shift)
    w = 1.0 / max(float(np.mean(error**2)), 1e-12)
    terms = np.column_stack([rays * (distance / z)[:, None], np.full(len(z), 1.0 / w), rays, 1.0 / z,
                             used.sigma / z**2])  # fmt: skip
    sums = np.zeros((kernels.CELLS**2, terms.shape[1]))
    np.add.at(sums, row * kernels.CELLS + column, w * terms)
    inverse = np.linalg.inv(w * A.sum(axis=0))
    edge = max(float(np.max(np.abs(rays[:, 0]))), LEAST_EDGE)
    common = common_covariance(
        sums, inverse, np.zeros(3), plane.offset_m, -plane.normal / plane.offset_m, distortion, edge
    )
    J = slope_jacobian(plane)
    everywhere = plane.distance(points.xyz)
    near = _near(points, everywhere, plane.offset_m)
    return Fit(
        Plane(plane.normal, plane.offset_m, J @ (own + common) @ J.T),
        Plane(plane.normal, plane.offset_m, J @ own @ J.T),
        float(np.mean(near)),
        float(np.mean(~_near(points, np.minimum(everywhere, 0.0), plane.offset_m, 2.0))),
        float(np.mean(_near(points, everywhere, plane.offset_m, 1.0 / SHARP)[near])),
    )
