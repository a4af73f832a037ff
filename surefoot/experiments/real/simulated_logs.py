"""Logs of simulated robots that nobody tuned for: size, beacons, noise, scales, drift and start are drawn at random.

A robot drives curves through an arena of 6 to 60 m. It either measures ranges to radio beacons, or depth and bearing of
tags in the view of a camera. Noise of path and turn, wheel scale, gyro drift, noise, scale and offset of the distances,
share of outliers, and rates are drawn anew for each seed, over factors of several.

Source: ours.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from perception.filtering.models import wrap_angles
from perception.planar.planar_log import PlanarLog

DT = 0.1  # s, interval of the odometry


@dataclass(frozen=True)
class SimulatedLog:
    """A log and its truth: stamp, x, y, yaw, at the stamps of the odometry."""

    log: PlanarLog
    truth: Float[np.ndarray, "n 4"]


def simulated_log(
    seed: int,
    ranges: bool,
    seconds: float = 300.0,
    kidnapped: bool = False,
) -> SimulatedLog:
    """Draw a robot, its world and its log.

    Args:
        seed: Of everything.
        ranges: Radio beacons; else tags in the view of a camera.
        seconds: Duration.
        kidnapped: Half-way somebody turns the robot round and carries it across the arena.
    """
    rng = np.random.default_rng(seed)
    size = float(np.exp(rng.uniform(math.log(6.0), math.log(60.0))))
    speed = size / rng.uniform(20.0, 60.0)
    count = int(rng.integers(4, 9)) if ranges else int(rng.integers(10, 21))
    places = rng.uniform(-0.5, 0.5, (count, 2)) * size
    truth, told = _drive(rng, size, speed, round(seconds / DT), kidnapped)
    seen_s, marks, seen = _sightings(rng, truth, places, ranges, size)
    log = PlanarLog(
        truth[:, 0].copy(),
        np.cumsum(told, axis=0),
        np.array(seen_s),
        np.array(marks),
        np.array(seen),
        places,
    )
    return SimulatedLog(log, truth)


def _drive(
    rng: np.random.Generator, size: float, speed: float, count: int, kidnapped: bool
) -> tuple[np.ndarray, np.ndarray]:
    """True poses (n, 4), and path and turn of each step as odometry tells them (n, 2)."""
    wheel, turning = 1.0 + rng.uniform(-0.08, 0.08, 2)
    drift = math.radians(rng.uniform(-0.7, 0.7))
    path_noise, turn_noise = np.exp(rng.uniform(np.log([0.01, 0.002]), np.log([0.05, 0.02])))
    slip_memory = 20.0
    pose = np.array([*(rng.uniform(-0.2, 0.2, 2) * size), rng.uniform(-math.pi, math.pi)])
    truth, told, slip, bend = [[0.0, *pose]], [[0.0, 0.0]], 0.0, 0.0
    for k in range(1, count):
        bend = 0.98 * bend + 0.1 * rng.normal() * speed / size
        home = math.remainder(math.atan2(-pose[1], -pose[0]) - pose[2], 2.0 * math.pi)
        far = float(np.hypot(*pose[:2])) > 0.35 * size
        turn = DT * (8.0 * speed / size * math.sin(home / 2.0) if far else 3.0 * bend)
        path = speed * DT
        slip += -slip * DT / slip_memory + 0.01 * math.sqrt(2.0 * DT / slip_memory) * rng.normal()
        told.append(
            [
                path * (1.0 + slip) / wheel + path_noise * math.sqrt(abs(path)) * rng.normal(),
                turn / turning + drift * DT + turn_noise * math.sqrt(abs(path)) * rng.normal(),
            ]
        )
        middle = pose[2] + turn / 2.0
        pose = pose + np.array([path * math.cos(middle), path * math.sin(middle), turn])
        if kidnapped and k == count // 2:
            pose = np.array([0.1 * size - pose[0], -pose[1], pose[2] + math.pi])
        truth.append([k * DT, *pose])
    return np.array(truth), np.array(told)


def _sightings(
    rng: np.random.Generator, truth: np.ndarray, places: np.ndarray, ranges: bool, size: float
) -> tuple[list[float], list[int], list[list[float]]]:
    """Stamps, marks, and distance with bearing."""
    outliers = rng.uniform(0.0, 0.1)
    every = int(rng.integers(2, 11 if ranges else 5))
    noise = np.exp(rng.uniform(np.log([0.003, 0.003]), np.log([0.02, 0.02])))  # of the size; rad
    gain, offset = rng.uniform(-0.07, 0.07), rng.uniform(-0.02, 0.02) * size
    if not ranges:
        gain, offset = rng.uniform(-0.02, 0.02), rng.uniform(-0.05, 0.05)
    view, reach = rng.uniform(0.4, 0.9), rng.uniform(0.5, 1.0) * size
    seen_s, marks, seen = [], [], []
    for row in truth[1::every]:
        x, y = (places - row[1:3]).T
        far = np.hypot(x, y)
        bearing = wrap_angles(np.arctan2(y, x) - row[3])
        visible = np.flatnonzero(far > 0.02 * size)
        if not ranges:
            visible = np.flatnonzero((np.abs(bearing) < view) & (far < reach) & (far > 0.02 * size))
        if len(visible) == 0:
            continue
        mark = int(rng.choice(visible))
        depth = far[mark] if ranges else far[mark] * math.cos(bearing[mark])
        told = (
            offset
            + (1.0 + gain) * depth
            + noise[0] * size * (0.3 if not ranges else 1.0) * rng.normal()
        )
        angle = math.nan if ranges else float(bearing[mark] + noise[1] * rng.normal())
        if rng.random() < outliers:
            told = rng.uniform(0.05, 1.0) * size
            angle = angle if ranges else rng.uniform(-view, view)
        seen_s.append(float(row[0]))
        marks.append(mark)
        seen.append([max(float(told), 0.05), angle])
    return seen_s, marks, seen


def with_drift(log: PlanarLog, rate: float) -> PlanarLog:
    """The log with a gyro that drifts, rad/s."""
    totals = log.totals.copy()
    totals[:, 1] += rate * (log.stamps_s - log.stamps_s[0])
    return dataclasses.replace(log, totals=totals)


def with_outliers(log: PlanarLog, share: float, rng: np.random.Generator) -> PlanarLog:
    """The log with a share of its sightings exchanged for those of another instant."""
    seen = log.seen.copy()
    bad = np.flatnonzero(rng.random(len(seen)) < share)
    seen[bad] = seen[rng.integers(0, len(seen), len(bad))]
    return dataclasses.replace(log, seen=seen)
