"""Simulated drives with ground truth, for the tests of planar localisation."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from perception.filtering.consistency import nees
from perception.planar.config import PlanarConfig
from perception.planar.planar import Journey
from perception.primitives.gaussian import Gaussian

PLACES = np.array(
    [(4.0, 0.0), (4.0, 3.0), (0.0, 4.5), (-4.0, 3.0), (-4.0, 0.2), (-4.0, -3.0), (0.5, -4.5),
     (4.0, -3.0), (2.2, 4.2), (-2.2, 4.3), (-2.0, -4.3), (2.5, -4.4)]
)  # fmt: skip
START = np.diag([0.02, 0.02, 0.01]) ** 2
CONFIG = PlanarConfig(
    along=0.02,
    across=0.01,
    turn_per_path=0.03,
    turn_per_turn=0.05,
    offset=0.05,
    depth_near=0.02,
    depth_far=0.001,
    bearing_sigma=0.006,
    bearing_turning=0.01,
    depth_shared=0.3,
    bearing_shared=0.003,
    place=0.01,
    gate=16.0,
)
"""The noise of `drive` without its faults."""


@dataclass(frozen=True)
class Drive:
    """A run and its ground truth, (n, 3)."""

    journey: Journey
    true: np.ndarray

    def anees(self, means: np.ndarray, covariances: np.ndarray) -> float:
        """Average NEES per degree of freedom."""
        return float(np.mean(nees(means - self.true, covariances, angles=(2,)))) / 3.0

    def errors_m(self, means: np.ndarray) -> np.ndarray:
        return np.hypot(*(means - self.true)[:, :2].T)


def drive(
    seed: int,
    seconds: float = 180.0,
    outliers: float = 0.0,
    blackout_s: tuple[float, float] = (0.0, 0.0),
    jump_m: float = 0.0,
    late_s: float = 0.0,
    kidnapped_m: float = 0.0,
) -> Drive:
    """Drive along curves at 0.3 m/s, with sightings ahead twice a second.

    Args:
        seed: Of all noise.
        seconds: Duration.
        outliers: Share of random sightings.
        blackout_s: Interval without sightings.
        jump_m: A jump of the odometry in the middle of the run.
        late_s: Delay of the sightings.
        kidnapped_m: A lateral displacement in the middle of the run, with a turn of one radian.
    """
    rng = np.random.default_rng(seed)
    dt, p = 0.1, CONFIG
    pace, turning = 1.0 + 0.03 * rng.normal(), 1.0 + 0.03 * rng.normal()
    pose = np.array([1.0, -1.0, 0.5])
    start = Gaussian(rng.multivariate_normal(pose, START), START)
    places = PLACES + p.place * rng.normal(size=PLACES.shape)
    shared = np.array([p.depth_shared, p.bearing_shared]) * rng.normal(size=2)
    steps, first, marks, seen, true = [], [0], [], [], []
    for k in range(round(seconds / dt)):
        away = np.hypot(*pose[:2]) > 2.5
        to_middle = math.atan2(-pose[1], -pose[0]) - pose[2]
        told = np.array(
            [0.3 * dt, dt * (0.6 * math.sin(to_middle) if away else 0.3 * math.sin(k / 70))]
        )
        path = pace * told[0] + p.along * math.sqrt(told[0]) * rng.normal()
        turn = turning * told[1] + rng.normal() * math.sqrt(
            p.turn_per_path**2 * told[0]
            + p.turn_per_turn**2 * abs(told[1])
            + p.turn_per_time**2 * dt
        )
        before, middle = pose, pose[2] + turn / 2.0
        side = p.across * math.sqrt(told[0]) * rng.normal()
        pose = pose + np.array(
            [
                path * math.cos(middle) - side * math.sin(middle),
                path * math.sin(middle) + side * math.cos(middle),
                turn,
            ]
        )
        if k == round(seconds / dt / 2):
            told[0] += jump_m
            if kidnapped_m:
                pose = pose + np.array([0.0, -math.copysign(kidnapped_m, pose[1]), 1.0])
        steps.append([dt, *told])
        true.append(pose)
        looks = k % 5 == 0 and not blackout_s[0] <= k * dt < blackout_s[1]
        at = pose + (before - pose) * (late_s / dt)
        for m, place in enumerate(places if looks else ()):
            x, y = place - at[:2]
            c, s = math.cos(at[2]), math.sin(at[2])
            ahead, bearing = c * x + s * y, math.atan2(c * y - s * x, c * x + s * y)
            if not (0.5 < ahead < 6.0 and abs(bearing) < 0.5):
                continue
            sigma = math.hypot(p.depth_near, p.depth_far * ahead**2)
            turned = math.hypot(p.bearing_sigma, p.bearing_turning * told[1] / dt)
            noise = [sigma * (shared[0] + rng.normal()), shared[1] + turned * rng.normal()]
            told_of = np.array([p.offset + p.scale * ahead, bearing]) + noise
            if rng.random() < outliers:
                told_of = np.array([rng.uniform(0.5, 6.0), rng.uniform(-0.5, 0.5)])
            marks.append(m)
            seen.append(told_of)
        first.append(len(marks))
    journey = Journey(
        start, np.array(steps), np.array(first), np.array(marks), np.array(seen), PLACES
    )
    return Drive(journey, np.array(true))
