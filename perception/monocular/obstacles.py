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
from .flow import CORNER_SIGMA_PX
from .result import Flows, Picture, SeenObstacle


def floor_flows(
    begin: Float[np.ndarray, "n 2"],
    end: Float[np.ndarray, "n 2"],
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
    return Flows(begin, end, owners, velocity)


def speed_thresholds(
    flows: Flows, previous: Picture, current: Picture, static_mps: float
) -> Float[np.ndarray, "n"]:
    """Speed from which each flow counts as motion, m/s; NaN for corners above the horizon.

    It is the larger of `static_mps` and the speed that one standard deviation of a corner, along the column,
    simulates.
    """
    pose, camera = current.T_world_camera, current.camera
    here = floor_points(flows.current, camera, pose, math.inf)
    there = floor_points(flows.current + np.array([0.0, CORNER_SIGMA_PX]), camera, pose, math.inf)
    seconds = current.stamp_s - previous.stamp_s
    return np.asarray(np.maximum(static_mps, np.hypot(*(there - here).T) / seconds))


def find_obstacles(
    edges: Edges,
    flows: Flows,
    current: Picture,
    farthest_m: float,
    threshold_mps: Float[np.ndarray, "n"],
    fastest_mps: float,
    covariances: CovarianceModel,
) -> tuple[SeenObstacle, ...]:
    """One obstacle per group of edges, with the velocity of its smallest flow and its predicted contact points.

    Args:
        edges: Contact edges of `current`.
        flows: Optical flows with the index of their group.
        current: The picture.
        farthest_m: Maximum length of a ray to the floor.
        threshold_mps: Speed from which each flow counts as motion.
        fastest_mps: Faster flows are outliers. If all flows of an obstacle are, it is predicted to stay, with a
            covariance of the velocity that covers them.
        covariances: Error propagation, with the time to the prediction.
    """
    speed = np.hypot(*flows.velocity_world.T)
    found = []
    for index, edge in enumerate(edges.groups):
        pixels = edge.astype(np.float64)
        contact = floor_points(pixels, current.camera, current.T_world_camera, farthest_m)
        owned = np.flatnonzero((flows.obstacle == index) & np.isfinite(speed))
        plausible = owned[speed[owned] <= fastest_mps]
        least = int(plausible[np.argmin(speed[plausible])]) if len(plausible) else -1
        moving = least >= 0 and bool(speed[least] >= threshold_mps[least])
        velocity = flows.velocity_world[least] if moving else np.zeros(2)
        predicted = contact + velocity * covariances.horizon_s
        measured = flows.velocity_world[plausible if len(plausible) else owned]
        P = covariances.of_obstacle(pixels, contact, flows, least, velocity, measured)
        found.append(SeenObstacle(edge, contact, least, velocity, moving, predicted, *P))
    return tuple(found)
