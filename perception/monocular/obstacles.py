"""How obstacles move: each corner's way on the floor, the least of an obstacle's, and where that leads.

A point above the floor seems to move although it stands, the more the higher it is; of an obstacle's flows
the least is the one nearest the floor. It is biased low for what really moves, so the median is told too.

Source: seed 000, section 3.4 (minimum flow) and section 3.5 (prediction).
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float, Int

from .back_projection import floor_points
from .deviations import Sureness
from .edges import Edges
from .result import Flows, Picture, SeenObstacle


def floor_flows(
    begin: Float[np.ndarray, "n 2"],
    end: Float[np.ndarray, "n 2"],
    previous: Picture,
    current: Picture,
    owners: Int[np.ndarray, "n"],
    farthest_m: float,
) -> Flows:
    """Flows with their velocity on the floor; each end by the pose of its own picture, so that the robot's
    own motion drops out for what touches the floor.

    Source: seed 000, section 3.4: v = (P_w(p_cur; M_C) - P_w(p_prev; M_P)) / dT.
    """
    was = floor_points(begin, previous.camera, previous.T_world_camera, farthest_m)
    now = floor_points(end, current.camera, current.T_world_camera, farthest_m)
    velocity = (now - was) / (current.stamp_s - previous.stamp_s)
    return Flows(begin, end, owners, velocity)


def least_speeds(
    flows: Flows, previous: Picture, current: Picture, static_mps: float, noise_px: float
) -> Float[np.ndarray, "n"]:
    """What each flow must reach to count as motion: the threshold, or what an error of `noise_px` down the
    picture makes of standing still, m/s. NaN where the corner does not look at the floor.
    """
    pose, camera = current.T_world_camera, current.camera
    here = floor_points(flows.current, camera, pose, math.inf)
    there = floor_points(flows.current + np.array([0.0, noise_px]), camera, pose, math.inf)
    seconds = current.stamp_s - previous.stamp_s
    return np.asarray(np.maximum(static_mps, np.hypot(*(there - here).T) / seconds))


def seen_obstacles(
    edges: Edges,
    flows: Flows,
    current: Picture,
    horizon_s: float,
    farthest_m: float,
    threshold_mps: Float[np.ndarray, "n"],
    fastest_mps: float,
    sureness: Sureness,
) -> tuple[SeenObstacle, ...]:
    """Every group of edges with its least flow and where that takes it within the horizon.

    `threshold_mps` is what each flow must reach to count as motion; beyond `fastest_mps` it took one corner for
    another, or somebody ran past: where no other flow is left, nothing is known of the speed but that it may be
    that great. `sureness` is whence the covariances come.
    """
    speed = np.hypot(*flows.velocity_world.T)
    found = []
    for index, edge in enumerate(edges.groups):
        contact = floor_points(
            edge.astype(np.float64), current.camera, current.T_world_camera, farthest_m
        )
        owned = np.flatnonzero((flows.obstacle == index) & np.isfinite(speed))
        mine = owned[speed[owned] <= fastest_mps]
        least, velocity, median = -1, np.zeros(2), np.zeros(2)
        if len(mine):
            least = int(mine[np.argmin(speed[mine])])
            velocity = flows.velocity_world[least]
            median = np.median(flows.velocity_world[mine], axis=0)
        moving = least >= 0 and bool(speed[least] >= threshold_mps[least])
        if not moving:
            velocity = np.zeros(2)
        predicted = contact + velocity * horizon_s
        said = flows.velocity_world[mine if len(mine) else owned]
        sure = sureness.of_obstacle(edge.astype(np.float64), contact, flows, least, velocity, said)
        found.append(SeenObstacle(edge, contact, least, velocity, median, moving, predicted, *sure))
    return tuple(found)
