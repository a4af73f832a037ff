"""Smoothing of a planar trajectory: every pose is corrected by the sightings before and after it.

The smoother uses the filter's parameters, its final estimates of odometry and lens errors, and the sightings inside its
gate. The common depth error is a state here too. Slowly varying errors of bearing and position, which are states of the
filter, are noise with a variance that grows with the number of sightings that share them; this keeps the problem small.

Source: ours.
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

MIN_SIGMA = 1e-4  # m and rad; standard deviation of a motion without path or turn
MAX_SHARING = 20.0  # greatest number of sightings with a common error


def smooth_journey(
    journey: Journey, filtered: FilteredJourney, config: PlanarConfig
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3 3"]]:
    """Smooth a planar trajectory.

    Args:
        journey: Odometry and sightings.
        filtered: Result of the filter.
        config: Noise parameters of the filter.

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
    """Motion factor from instant i - 1 to instant i; the start has number 0."""
    length, angle = abs(path), abs(turn)
    path, turn = (
        path * float(state[ODOMETRY_SCALE]),
        turn * float(state[TURN_SCALE]) + dt * float(state[DRIFT]),
    )
    variance = [
        config.along**2 * length,
        config.across**2 * length,
        config.turn_per_path**2 * length
        + config.turn_per_turn**2 * angle
        + config.turn_per_time**2 * dt,
    ]
    motion = Pose2(path * math.cos(turn / 2.0), path * math.sin(turn / 2.0), turn)
    return Motion(i, i + 1, motion, np.diag(np.array(variance) + MIN_SIGMA**2))


def _sighting(
    journey: Journey,
    row: int,
    rate: float,
    times: tuple[float, float],
    state: np.ndarray,
    config: PlanarConfig,
) -> LandmarkSeen:
    """Landmark factor with range on the floor and bearing; `times`: s since this and any landmark was seen."""
    since, since_any = times
    depth, bearing = journey.seen[row].tolist()
    side = 2.0 * bearing
    bearing -= side * side * float(state[LENS_EVEN] + side * state[LENS_ODD])
    ahead = max((depth - config.offset) / config.scale, 0.05)
    new = math.hypot(config.depth_near, config.depth_far * depth**2)

    def shared(deviation: float, memory_s: float) -> float:
        """Variance of an error that a series of sightings has in common."""
        keep = math.exp(-since / memory_s)
        return deviation**2 * min((1.0 + keep) / max(1.0 - keep, 1e-9), MAX_SHARING)

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
