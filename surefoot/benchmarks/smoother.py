"""Incremental smoothing during a walk, against GTSAM's batch optimiser on the same graph.

A walk of 1000 poses at 10 Hz among known and unknown landmarks. The time of ours is that of one update, from new
factors to the newest pose; the peer solves the whole graph by Levenberg-Marquardt, which every update would need
without iSAM2. It starts at dead reckoning; the time to build its graph does not count. The hardest peer starts at the
solution of the graph without the newest pose, and takes two steps of Gauss-Newton.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence

import numpy as np

from perception.primitives.gaussian import Gaussian
from perception.primitives.pose import Pose2
from perception.smoothing.factors import Factor, Glance, LandmarkSeen, Motion
from perception.smoothing.fixed_lag import FixedLagSmoother
from perception.smoothing.smoother import SmootherConfig

from .benchmark import Benchmark, Comparison

POSES = 1000
RATE_HZ = 10.0
LOOK_EVERY = 10  # poses
REACH_M = 3.0
STEP = np.array([0.02, 0.002, math.radians(0.5)])  # standard deviations of odometry: m, m, rad
SIGHT = np.array([0.03, math.radians(1.0)])  # standard deviations of range and bearing
START = Gaussian(np.zeros(3), np.diag([0.01, 0.01, 0.01]) ** 2)
LAST = 100  # timed updates, with a batch before every tenth
RELINEARISE = 0.01  # m and rad: a third of the standard deviations of a landmark measurement


def walk(rng: np.random.Generator) -> list[tuple[float, list[Factor]]]:
    """Circles in a room of 8 m: (stamp, factors) of each instant; every second landmark is unknown."""
    true = Pose2()
    marks = np.stack([4.0 * np.cos(np.arange(12)), 4.0 * np.sin(np.arange(12)) + 2.0], axis=-1)
    frames: list[tuple[float, list[Factor]]] = [(0.0, [])]
    for k in range(1, POSES):
        step = Pose2(0.1, 0.0, 0.05)
        factors: list[Factor] = [Motion(k - 1, k, step, np.diag(STEP**2))]
        true = true @ Pose2(*(float(v) for v in step.vector + STEP * rng.standard_normal(3)))
        if k % LOOK_EVERY == 0:
            seen = []
            for i, (x, y) in enumerate(true.inverse().apply(marks)):
                if math.hypot(x, y) < REACH_M:
                    noise = SIGHT * rng.standard_normal(2)
                    measured = np.array([math.hypot(x, y), math.atan2(y, x)]) + noise
                    place = i if i % 2 else (float(marks[i, 0]), float(marks[i, 1]))
                    seen.append(LandmarkSeen(place, measured, np.diag(SIGHT**2)))
            factors.append(Glance(k, tuple(seen)))
        frames.append((k / RATE_HZ, factors))
    return frames


def run() -> Comparison:
    """Median time of the last 100 updates, and of ten batch solutions between them."""
    frames = walk(np.random.default_rng(0))
    endless = FixedLagSmoother(START, (), SmootherConfig(lag_s=math.inf, relinearise=RELINEARISE))
    for stamp, factors in frames[:-LAST]:
        endless.update(stamp, factors)
    peer = Batch(frames)
    peer.solve()  # warm
    peer.solve_warm()
    updates, batches, warm = [], [], []
    for number, (stamp, factors) in enumerate(frames[-LAST:], start=POSES - LAST):
        if number % 10 == 0:
            begun = time.process_time_ns()
            peer.solve()
            batches.append((time.process_time_ns() - begun) / 1e6)
            begun = time.process_time_ns()
            peer.solve_warm()
            warm.append((time.process_time_ns() - begun) / 1e6)
        begun = time.process_time_ns()
        endless.update(stamp, factors)
        newest = endless.mean(number)
        updates.append((time.process_time_ns() - begun) / 1e6)
    assert isinstance(newest, Pose2)
    ours, batch, warmed = (float(np.median(spent)) for spent in (updates, batches, warm))
    bounded, with_covariance = fixed_lag(frames)
    return Comparison(
        {
            "update_ms": ours,
            "update_worst_ms": float(np.max(updates)),
            "batch_ms": batch,
            "gauss_newton_ms": warmed,
            "fixed_lag_10s_at_10hz_ms": bounded,
            "fixed_lag_with_covariance_ms": with_covariance,
        },
        {"ratio_batch": batch / ours, "ratio_gauss_newton": warmed / ours},
        {
            "newest_pose_difference_m": math.hypot(*(newest.vector - peer.newest())[:2]),
            "newest_yaw_difference_rad": abs(float(newest.yaw - peer.newest()[2])),
        },
        {"Gauss-Newton from the last solution, two steps": warmed / ours},
    )


def fixed_lag(frames: Sequence[tuple[float, list[Factor]]]) -> tuple[float, float]:
    """Median times of an update with a lag of 10 s, ms: without and with the covariance of the newest pose."""
    smoother = FixedLagSmoother(START, (), SmootherConfig(lag_s=10.0, relinearise=RELINEARISE))
    mean_only, with_covariance = [], []
    for number, (stamp, factors) in enumerate(frames):
        begun = time.process_time_ns()
        smoother.update(stamp, factors)
        smoother.mean(number)
        middle = time.process_time_ns()
        smoother.pose(number)
        if number >= POSES // 2:
            mean_only.append((middle - begun) / 1e6)
            with_covariance.append((time.process_time_ns() - begun) / 1e6)
    return float(np.median(mean_only)), float(np.median(with_covariance))


class Batch:
    """The whole graph in GTSAM, initialised by dead reckoning."""

    def __init__(self, frames: Sequence[tuple[float, list[Factor]]]) -> None:
        from perception.smoothing import graph
        from perception.smoothing.factors import PoseSeen

        factors: list[Factor] = [PoseSeen(0, START)]
        factors += [factor for _, added in frames for factor in added]
        built = graph.Graph()
        for number, guess in graph.first_guesses(factors, {}).items():
            built.add_pose(number, guess)
        for factor in factors:
            built.add(factor)
        self._factors, self._start, _ = built.take()
        self._solved = self._start
        self._newest, self._before = graph.pose_key(POSES - 1), graph.pose_key(POSES - 2)

    def solve(self) -> None:
        """Solve by Levenberg-Marquardt with the default parameters of GTSAM."""
        import gtsam

        self._solved = gtsam.LevenbergMarquardtOptimizer(self._factors, self._start).optimize()

    def solve_warm(self) -> None:
        """Two Gauss-Newton steps from the last solution, the newest pose by its odometry."""
        import gtsam

        guess = gtsam.Values(self._solved)
        step = gtsam.Pose2(0.1, 0.0, 0.05)
        guess.update(self._newest, self._solved.atPose2(self._before).compose(step))
        settings = gtsam.GaussNewtonParams()
        settings.setMaxIterations(2)
        self._solved = gtsam.GaussNewtonOptimizer(self._factors, guess, settings).optimize()

    def newest(self) -> np.ndarray:
        """(x, y, yaw) of the last pose."""
        pose = self._solved.atPose2(self._newest)
        return np.array([pose.x(), pose.y(), pose.theta()])


BENCHMARK = Benchmark(
    "smoother",
    "Smoothing of 1000 poses, one more at a time",
    run,
    {"ratio_batch": 100.0},
    {"newest_pose_difference_m": 1e-3, "newest_yaw_difference_rad": 1e-3},
)
