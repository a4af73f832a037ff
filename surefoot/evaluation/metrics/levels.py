"""Walks over several levels: how every foot stood, and the heights of the map against the true ground.

A foot is on an edge if a tenth of its length or more has no ground below it. The robot falls where the middle of a sole has
none, or where the ground is lower or higher than expected by more than its lift (the run ends there). Heights are judged
relative to the ground below the standing foot, as the map states them.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from jaxtyping import Float

from mapping.ground.surface import Surface
from mapping.io import ground_file
from perception.primitives.pose import Pose2

from ...results.run_folder import RunFolder

CARRIED, STRUCK_M = 0.9, 0.01
CELL_M = 0.05  # ours: of the places at which heights are compared
WITHIN_M = 0.30  # ours: from the edges of a true floor; beyond the error of the robot's place
FLOOR_M2 = 1.5  # ours: a level so large is a floor, no tread
LEAST = 20  # cells of a surface that is judged


def level_metrics(run: RunFolder) -> dict[str, float]:
    """footsteps, feet_on_edges, feet_struck, edges_claimed; floors (seen of the true ones), floor_error_max_m, floor_nees.

    The error of a floor is that of the largest surface of the map on it, relative to the floor on which the robot stands. The
    mean NEES is over all surfaces on floors, with one degree of freedom. Empty without truth of the footsteps.
    """
    landings = run.read_csv("truth/footsteps.csv")
    steps = run.read_csv("footsteps.csv")
    if landings is None or steps is None:
        return {}
    carried = landings.numbers("carried")
    found = {
        "footsteps": float(len(carried)),
        "feet_on_edges": float(np.sum(carried < CARRIED)),
        "feet_struck": float(np.sum(landings.numbers("struck_m") > STRUCK_M)),
        "edges_claimed": float(np.nansum(steps.numbers("missed"))),
    }
    pieces = run.read_json("truth/ground.json")
    true = run.read_trajectory("truth/trajectory.txt")
    estimate = run.read_trajectory("trajectory.txt")
    if pieces is None or true is None or estimate is None or not run.has(ground_file.NAME):
        return found
    surfaces, body = ground_file.load(run.path(ground_file.NAME))
    last = _pose(true.positions[-1], true.yaws[-1])
    own = _pose(estimate.positions[-1], estimate.yaws[-1])
    T_world_body = last @ own.inverse() @ body  # where the frame of the map truly is
    return found | _floors(surfaces, T_world_body, pieces)


def _pose(place: Float[np.ndarray, "3"], yaw: float) -> Pose2:
    return Pose2(float(place[0]), float(place[1]), float(yaw))


def _floors(
    surfaces: tuple[Surface, ...], T_world_body: Pose2, pieces: list[dict[str, Any]]
) -> dict[str, float]:
    rings = [np.array(one["outline_m"]) for one in pieces]
    tops = np.array([float(one["top_m"]) for one in pieces])
    corners = np.concatenate([*rings, np.zeros((1, 2)), T_world_body.vector[None, :2]])
    low, high = corners.min(axis=0) - 0.5, corners.max(axis=0) + 0.5
    shape = tuple(np.ceil((high - low) / CELL_M).astype(int)[::-1])
    truth = np.zeros(shape, np.float32)
    for k in np.argsort(tops):
        cells = np.round((rings[k] - low) / CELL_M - 0.5).astype(np.int32)
        cv2.fillPoly(truth, [cells], float(tops[k]))
    size = 2 * round(WITHIN_M / CELL_M) + 1
    square = np.ones((size, size), np.uint8)
    even = cv2.dilate(truth, square) - cv2.erode(truth, square) < 1e-6
    levels = [
        z for z in np.unique(truth[even]) if np.sum(even & (truth == z)) * CELL_M**2 > FLOOR_M2
    ]
    row, column = np.nonzero(even & np.isin(truth, levels))
    places = T_world_body.inverse().apply((np.column_stack([column, row]) + 0.5) * CELL_M + low)
    z = truth[row, column]
    stand = np.round((T_world_body.vector[:2] - low) / CELL_M - 0.5).astype(int)
    here = float(truth[stand[1], stand[0]])
    best: dict[float, tuple[int, float]] = {}
    squared = []
    for one in surfaces:
        inside = one.contains(places)
        for level in levels:
            on = inside & (z == level)
            if np.sum(on) < LEAST:
                continue
            middle = places[on].mean(axis=0)
            height, sigma = (float(v) for v in one.height_at(middle))
            error = height - (float(level) - here)
            squared.append((error / sigma) ** 2)
            if np.sum(on) > best.get(float(level), (0, 0.0))[0]:
                best[float(level)] = int(np.sum(on)), error
    base = best.get(here, (0, 0.0))[1]
    errors = [abs(error - base) for _, error in best.values()]
    return {
        "floors": float(len(best)),
        "floors_true": float(len(levels)),
        "floor_error_max_m": max(errors) if len(best) == len(levels) else float("nan"),
        "floor_nees": float(np.mean(squared)) if squared else float("nan"),
    }
