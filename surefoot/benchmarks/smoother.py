"""Smoothing as the walk goes on, against GTSAM's batch optimiser on the same graph.

A walk of 1000 poses, ten a second, among known and unknown landmarks. Ours takes in one instant after the other, from
our factors to the newest pose; the peer solves the whole graph by Levenberg-Marquardt, as one would have to
do at every instant without iSAM2. It starts where dead reckoning leads, and what it costs to build is not
counted.
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
STEP = np.array([0.02, 0.002, math.radians(0.5)])  # deviations of odometry: m, m, rad
SIGHT = np.array([0.03, math.radians(1.0)])  # of range and bearing
START = Gaussian(np.zeros(3), np.diag([0.01, 0.01, 0.01]) ** 2)
LAST = 100  # updates that are judged, with a batch before every tenth
RELINEARISE = 0.01  # m and rad: a third of the deviations of a sighting


def walk(rng: np.random.Generator) -> list[tuple[float, list[Factor]]]:
    """Rounds through a room of 8 m: (stamp, factors) of each instant; every second landmark is unknown."""
    true = Pose2()
    marks = np.stack([4.0 * np.cos(np.arange(12)), 4.0 * np.sin(np.arange(12)) + 2.0], axis=-1)
    frames: list[tuple[float, list[Factor]]] = [(0.0, [])]
    for k in range(1, POSES):
        told = Pose2(0.1, 0.0, 0.05)
        factors: list[Factor] = [Motion(k - 1, k, told, np.diag(STEP**2))]
        true = true @ Pose2(*(float(v) for v in told.vector + STEP * rng.standard_normal(3)))
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
    """Median of the last 100 updates against the median of ten batches between them."""
    frames = walk(np.random.default_rng(0))
    endless = FixedLagSmoother(START, (), SmootherConfig(lag_s=math.inf, relinearise=RELINEARISE))
    for stamp, factors in frames[:-LAST]:
        endless.update(stamp, factors)
    peer = Batch(frames)
    peer.solve()  # warm
    updates, batches = [], []
    for number, (stamp, factors) in enumerate(frames[-LAST:], start=POSES - LAST):
        if number % 10 == 0:
            begun = time.process_time_ns()
            peer.solve()
            batches.append((time.process_time_ns() - begun) / 1e6)
        begun = time.process_time_ns()
        endless.update(stamp, factors)
        newest = endless.mean(number)
        updates.append((time.process_time_ns() - begun) / 1e6)
    assert isinstance(newest, Pose2)
    ours, batch = float(np.median(updates)), float(np.median(batches))
    bounded, sure = fixed_lag(frames)
    return Comparison(
        {
            "update_ms": ours,
            "update_worst_ms": float(np.max(updates)),
            "batch_ms": batch,
            "fixed_lag_10s_at_10hz_ms": bounded,
            "fixed_lag_with_covariance_ms": sure,
        },
        {"ratio_batch": batch / ours},
        {
            "newest_pose_difference_m": math.hypot(*(newest.vector - peer.newest())[:2]),
            "newest_yaw_difference_rad": abs(float(newest.yaw - peer.newest()[2])),
        },
    )


def fixed_lag(frames: Sequence[tuple[float, list[Factor]]]) -> tuple[float, float]:
    """Median times of an update with 10 s of lag, ms: without and with the newest pose's covariance."""
    smoother = FixedLagSmoother(START, (), SmootherConfig(lag_s=10.0, relinearise=RELINEARISE))
    plain, sure = [], []
    for number, (stamp, factors) in enumerate(frames):
        begun = time.process_time_ns()
        smoother.update(stamp, factors)
        smoother.mean(number)
        middle = time.process_time_ns()
        smoother.pose(number)
        if number >= POSES // 2:
            plain.append((middle - begun) / 1e6)
            sure.append((time.process_time_ns() - begun) / 1e6)
    return float(np.median(plain)), float(np.median(sure))


class Batch:
    """The whole graph in GTSAM's hands, from dead reckoning."""

    def __init__(self, frames: Sequence[tuple[float, list[Factor]]]) -> None:
        from perception.smoothing import graph
        from perception.smoothing.factors import PoseSeen

        factors: list[Factor] = [PoseSeen(0, START)]
        factors += [factor for _, told in frames for factor in told]
        built = graph.Graph()
        for number, guess in graph.first_guesses(factors, {}).items():
            built.add_pose(number, guess)
        for factor in factors:
            built.add(factor)
        self._factors, self._start, _ = built.take()
        self._solved = self._start
        self._newest = graph.pose_key(POSES - 1)

    def solve(self) -> None:
        """By Levenberg-Marquardt, GTSAM's own parameters."""
        import gtsam

        self._solved = gtsam.LevenbergMarquardtOptimizer(self._factors, self._start).optimize()

    def newest(self) -> np.ndarray:
        """(x, y, yaw) of the last pose."""
        pose = self._solved.atPose2(self._newest)
        return np.array([pose.x(), pose.y(), pose.theta()])


BENCHMARK = Benchmark(
    "smoother", "Smoothing of 1000 poses, one more at a time", run, {"ratio_batch": 100.0}
)
