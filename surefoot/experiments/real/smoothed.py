"""The same journey smoothed: every pose corrected by what was seen before and after it.

The smoother is told what the filter believed, with the filter's parameters: motions as the filter's last
estimate of pace and turn corrects them, sightings inside its gate as its last estimate of the lens corrects
them. The error that depths share is an unknown here too. What the filter carries as slowly changing errors of
bearing and place is noise, the larger the more sightings share it; that keeps the problem small.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from perception.planar._planar_kernels import DRIFT, LENS_EVEN, LENS_ODD, ODOMETRY_SCALE, TURN_SCALE
from perception.planar.config import PlanarConfig
from perception.planar.planar import FilteredJourney, Journey
from perception.primitives.pose import Pose2
from perception.smoothing.factors import (
    Effect,
    Factor,
    Glance,
    LandmarkSeen,
    Loss,
    Motion,
    Systematic,
)
from perception.smoothing.smoother import smooth

LEAST = 1e-4  # m and rad, deviation of a motion that did not take place
MOST_SHARING = 20.0  # sightings counted as one at most


def smooth_journey(
    journey: Journey, filtered: FilteredJourney, config: PlanarConfig
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3 3"]]:
    """Smooth a journey.

    Args:
        journey: What was told.
        filtered: What the filter made of it.
        config: Noise, as of the filter.

    Returns:
        Means and covariances of (x, y, yaw) at each instant.
    """
    factors: list[Factor] = []
    clock, seen_at, last_s = 0.0, dict[int, float](), 0.0
    for i, (dt, path, turn) in enumerate(journey.steps.tolist()):
        clock += dt
        factors.append(_motion(i, dt, path, turn, filtered.final, config))
        rows = np.arange(journey.first_row[i], journey.first_row[i + 1])
        rows = rows[filtered.status[rows] == 1]
        if len(rows) == 0:
            continue
        rate = abs(turn) / dt if dt > 1e-3 else 0.0
        seen = []
        for row in rows.tolist():
            mark = int(journey.marks[row])
            since = clock - seen_at.get(mark, -math.inf)
            seen_at[mark] = clock
            effect = (since, clock - last_s)
            seen.append(_sighting(journey, row, rate, effect, filtered.final, config))
            last_s = clock
        factors.append(Glance(i + 1, tuple(seen)))
    walk = config.depth_shared * math.sqrt(2.0 / config.depth_memory)
    depth = Systematic(
        "depth", np.zeros(3), np.array([config.depth_shared, 0.0, 0.0]), np.array([walk, 0.0, 0.0])
    )
    solved = smooth(factors, journey.start, [depth])
    return (
        np.array([pose.mean for pose in solved[1:]]),
        np.array([pose.covariance for pose in solved[1:]]),
    )


def _motion(
    i: int, dt: float, path: float, turn: float, state: np.ndarray, config: PlanarConfig
) -> Motion:
    """From instant i - 1 to instant i; the start has number 0."""
    length, told = abs(path), abs(turn)
    path, turn = (
        path * float(state[ODOMETRY_SCALE]),
        turn * float(state[TURN_SCALE]) + dt * float(state[DRIFT]),
    )
    variance = [
        config.along**2 * length,
        config.across**2 * length,
        config.turn_per_path**2 * length
        + config.turn_per_turn**2 * told
        + config.turn_per_time**2 * dt,
    ]
    motion = Pose2(path * math.cos(turn / 2.0), path * math.sin(turn / 2.0), turn)
    return Motion(i, i + 1, motion, np.diag(np.array(variance) + LEAST**2))


def _sighting(
    journey: Journey,
    row: int,
    rate: float,
    times: tuple[float, float],
    state: np.ndarray,
    config: PlanarConfig,
) -> LandmarkSeen:
    """One sighting as range on the floor and bearing; `times`: s since this landmark, and any, was seen."""
    since, since_any = times
    depth, bearing = journey.seen[row].tolist()
    side = 2.0 * bearing
    bearing -= side * side * float(state[LENS_EVEN] + side * state[LENS_ODD])
    ahead = max((depth - config.offset) / config.scale, 0.05)
    new = math.hypot(config.depth_near, config.depth_far * depth**2)

    def shared(deviation: float, memory_s: float) -> float:
        """Variance of an error of which many sightings have the same: for a steady row as for one."""
        keep = math.exp(-since / memory_s)
        return deviation**2 * min((1.0 + keep) / max(1.0 - keep, 1e-9), MOST_SHARING)

    place = shared(config.place, config.place_memory)
    variance = [
        new**2 + place,
        config.bearing_sigma**2
        + (config.bearing_turning * rate) ** 2
        + shared(config.bearing_shared, config.bearing_memory)
        + place / ahead**2,
    ]
    across = ahead * math.tan(bearing) / math.cos(bearing)
    root = np.array([[1.0 / math.cos(bearing), across], [0.0, 1.0]]) * np.sqrt(variance)
    spot = journey.places[int(journey.marks[row])]
    return LandmarkSeen(
        (float(spot[0]), float(spot[1])),
        np.array([ahead / math.cos(bearing), bearing]),
        root @ root.T,
        (Effect("depth", new, since_any),),
        Loss("huber"),
    )
