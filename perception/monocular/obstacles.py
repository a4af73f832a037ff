"""Obstacles with velocity and prediction: flows projected onto the floor, and the smallest flow of each obstacle.

Because of parallax a static point above the floor seems to move, the more the higher it is. The smallest flow of an
obstacle is therefore that of the point nearest to the floor; for a moving obstacle it is biased low.

Source: seed 000, section 3.4 (minimum flow) and section 3.5 (prediction).
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float, Int

from .back_projection import floor_points
from .contact_covariance import CovarianceModel
from .edges import Edges
from .result import Flows, Picture, SeenObstacle

CHANCE = 0.001  # ours: 16 walks; of a thing at rest to seem to move by errors of its flows


def floor_flows(
    begin: Float[np.ndarray, "n 2"],
    end: Float[np.ndarray, "n 2"],
    covariance: Float[np.ndarray, "n 2 2"],
    previous: Picture,
    current: Picture,
    owners: Int[np.ndarray, "n"],
    farthest_m: float,
) -> Flows:
    """Flows with their velocity on the floor.

    Each end is projected with the camera pose of its own picture, which cancels the robot's own motion for points
    on the floor.

    Source: seed 000, section 3.4: v = (P_w(p_cur; M_C) - P_w(p_prev; M_P)) / dT.
    """
    before = floor_points(begin, previous.camera, previous.T_world_camera, farthest_m)
    now = floor_points(end, current.camera, current.T_world_camera, farthest_m)
    velocity = (now - before) / (current.stamp_s - previous.stamp_s)
    return Flows(begin, end, covariance, owners, velocity)


def find_obstacles(
    edges: Edges,
    flows: Flows,
    current: Picture,
    farthest_m: float,
    static_mps: float,
    fastest_mps: float,
    covariances: CovarianceModel,
) -> tuple[SeenObstacle, ...]:
    """One obstacle per group of edges, with the velocity of its smallest flow and its predicted contact points.

    Args:
        edges: Contact edges of `current`.
        flows: Optical flows with the index of their group.
        current: The picture.
        farthest_m: Maximum length of a ray to the floor.
        static_mps: Speed from which a flow counts as motion, if its covariance hardly explains it (`CHANCE`).
        fastest_mps: Faster flows are outliers. If all flows of an obstacle are, it is predicted to stay, with a
            covariance of the velocity that covers them.
        covariances: Error propagation, with the time to the prediction.
    """
    speed = np.hypot(*flows.velocity_world.T)
    surprise = _surprise(flows, covariances)
    found = []
    for index, edge in enumerate(edges.groups):
        pixels = edge.astype(np.float64)
        contact = floor_points(pixels, current.camera, current.T_world_camera, farthest_m)
        owned = np.flatnonzero((flows.obstacle == index) & np.isfinite(speed))
        plausible = owned[speed[owned] <= fastest_mps]
        least = int(plausible[np.argmin(speed[plausible])]) if len(plausible) else -1
        rest = _chance_of_rest(surprise[plausible]) > CHANCE
        moving = not rest and bool(speed[least] >= static_mps)
        velocity = flows.velocity_world[least] if moving else np.zeros(2)
        predicted = contact + velocity * covariances.horizon_s
        measured = flows.velocity_world[plausible if len(plausible) else owned]
        P = covariances.of_obstacle(pixels, contact, flows, least, velocity, measured)
        found.append(SeenObstacle(edge, contact, least, velocity, moving, predicted, *P))
    return tuple(found)


def _chance_of_rest(surprise: Float[np.ndarray, "k"]) -> float:
    """Chance that all flows of a thing at rest are as far from zero as the nearest: chi-square, two degrees, independent."""
    return math.exp(-0.5 * float(surprise.min()) * len(surprise)) if len(surprise) else 1.0


def _surprise(flows: Flows, covariances: CovarianceModel) -> Float[np.ndarray, "n"]:
    """Squared Mahalanobis distance of each flow's velocity from rest; NaN above the horizon."""
    if not len(flows):
        return np.zeros(0)
    v = flows.velocity_world
    still = np.linalg.solve(covariances.of_flows(flows), v[..., None])[..., 0]
    return np.asarray(np.einsum("ni,ni->n", v, still))
