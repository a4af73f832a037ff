"""The walking robot's sigma-point filter, against the same filter by filterpy.

A frame is a prediction by step odometry, an update by the gyro and one by ranges and bearings of three landmarks, over
the ten states of the localiser. The hardest peer is the textbook filter in NumPy, all sigma points at once, with the
gyro, which is linear in the state, as a Kalman update.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from perception.filtering import models
from perception.filtering.models import GYRO_BIAS, TURN, WALKER_SIZE, YAW
from perception.filtering.square_root import SigmaPoints
from perception.localisation.ukf_engines import (
    ENGINES,
    UkfEngine,
    measure_all,
    predict_all,
    ukf_engine,
)
from perception.primitives.gaussian import Gaussian
from perception.primitives.pose import Pose2

from .benchmark import Benchmark, Comparison, race

FRAMES = 60
DT_S, STEPS = 0.325, 0.5
MARKS = np.array([[2.0, 1.0], [-2.0, 0.5], [0.5, -2.0]])
SIGMAS = np.array([0.02, 0.02, 0.03])  # of the ranges, m
R = np.diag(np.column_stack([SIGMAS, [0.01, 0.01, 0.02]]).ravel() ** 2)
TURN_SIGMA_RAD = 0.01
Q = np.diag([4e-3, 3e-3, 2e-2, 1e-4, 1e-4, 1e-4, 1e-5, 1e-5, 1e-3, 2e-2]) ** 2
START = Gaussian(
    np.zeros(WALKER_SIZE),
    np.diag([0.05, 0.05, 0.05, 5e-3, 2e-3, 1e-2, 2e-3, 1e-2, 1.0, 1e-2]) ** 2,
)


class Step(NamedTuple):
    """What one frame measures: motion by step odometry, turn by the gyro, rad, (range, bearing, ...)."""

    motion: Pose2
    turn_rad: float
    seen: np.ndarray


def walk(rng: np.random.Generator) -> list[Step]:
    """A walk among the landmarks."""
    pose, steps = Pose2(), []
    for _ in range(FRAMES):
        motion = Pose2(0.02, 0.0, rng.uniform(-0.2, 0.2))
        pose = pose @ motion
        seen = models.range_bearing(pose.vector, MARKS) + rng.normal(size=6) * np.sqrt(np.diag(R))
        noisy = Pose2(*(motion.vector + rng.normal(size=3) * [4e-3, 3e-3, 2e-2]))
        steps.append(Step(noisy, motion.yaw + rng.normal(0.0, TURN_SIGMA_RAD), seen))
    return steps


def by(engine: UkfEngine, steps: Sequence[Step]) -> Gaussian:
    """Mean and covariance of an engine after the walk."""
    engine.reset(START)
    for step in steps:
        engine.predict(step.motion, STEPS, Q)
        engine.update_turn(step.turn_rad, TURN_SIGMA_RAD, DT_S)
        engine.update(step.seen, R, MARKS, SIGMAS)
    return engine.state


def in_numpy(steps: Sequence[Step]) -> Gaussian:
    """Mean and covariance of the textbook filter after the walk."""
    x, P = START.mean, START.covariance
    reach, of_mean, weights = SigmaPoints.scaled(WALKER_SIZE)
    turn = np.zeros(WALKER_SIZE)
    turn[TURN], turn[GYRO_BIAS] = 1.0, DT_S

    def draw() -> np.ndarray:
        out = reach * np.linalg.cholesky(P).T
        return np.concatenate([x[None], x + out, x - out])

    for step in steps:
        moved = predict_all(draw(), step.motion, STEPS)
        x = models.walker_mean(moved, of_mean)
        away = moved - x
        away[:, YAW] = models.wrap_angles(away[:, YAW])
        P = away.T @ (weights[:, None] * away) + Q
        gain = P @ turn / (turn @ P @ turn + TURN_SIGMA_RAD**2)
        x = x + gain * (step.turn_rad - turn @ x)
        P = P - np.outer(gain, turn @ P)
        points = draw()
        seen = measure_all(points, MARKS, SIGMAS)
        expected = models.sighting_mean(seen, of_mean)
        off = seen - expected
        off[:, 1::2] = models.wrap_angles(off[:, 1::2])
        S = off.T @ (weights[:, None] * off) + R
        K = np.linalg.solve(S, off.T @ (weights[:, None] * (points - x))).T
        x = x + K @ models.sighting_difference(step.seen, expected)
        P = P - K @ S @ K.T
        x[[YAW]] = models.wrap_angles(x[[YAW]])
    return Gaussian(x, P)


def apart(one: Gaussian, other: Gaussian) -> float:
    """Largest difference of two states: of the means, and of the covariances, in standard deviations."""
    sigma = np.sqrt(np.diag(one.covariance))
    mean = models.walker_difference(one.mean, other.mean) / sigma
    covariance = (one.covariance - other.covariance) / np.outer(sigma, sigma)
    return float(max(np.abs(mean).max(), np.abs(covariance).max()))


def run() -> Comparison:
    """Times are those of one frame."""
    steps = walk(np.random.default_rng(0))
    candidates = {name: partial(by, ukf_engine(name, START), steps) for name in ENGINES}
    candidates["numpy"] = partial(in_numpy, steps)
    ours, *others = (candidate() for candidate in candidates.values())
    taken = race(candidates, rounds=9)
    ratios = {f"ratio_{who}": taken[who] / taken["compiled"] for who in ("filterpy", "numpy")}
    return Comparison(
        {f"{who}_ms": value / FRAMES for who, value in taken.items()},
        ratios,
        {"largest_difference": max(apart(ours, other) for other in others)},
        {"the textbook filter in NumPy": ratios["ratio_numpy"]},
    )


BENCHMARK = Benchmark(
    "ukf",
    "The localiser's sigma-point filter, one frame",
    run,
    {"ratio_filterpy": 10.0},
    {"largest_difference": 1e-9},
)
