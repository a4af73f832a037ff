"""A stratified sample of the points for the plane search, and the score of a plane as the floor.

The sample takes one random point of each of some two thousand equal runs of points in row order. The cost of
searching it does not depend on the image size; the final fit uses all points.

Source: ours; threshold tau(Z): seed 003, section 3.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..depth.points import Points
from ..primitives.errors import ConfigError
from ..primitives.plane import Plane
from ..primitives.settings import setting
from . import _search_kernels as kernels
from .prior import Gate

SIZE = 2048  # ours: this many stratified points find the floor in half a millisecond
SHARP = 3.0  # ours: a point counts within tau / SHARP; wider, and floor and ramp become one plane
PENALTY = 6.0  # ours: points on the plane that one point below outweighs; a table has floor below


@dataclass(frozen=True)
class ScoreConfig:
    """Distance from a plane within which a point is on it: tau = base_m + sigmas sigma_Z h / Z."""

    base_m: float = setting(
        0.01, "m", "constant part of the floor threshold tau in the plane search", "seed 003"
    )
    sigmas: float = setting(
        3.0, "", "standard deviations of height noise in the floor threshold tau", "seed 003"
    )

    def __post_init__(self) -> None:
        for name in ("base_m", "sigmas"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"floor: {name}={value} must be positive and finite")


class Sample(NamedTuple):
    """Points as columns, camera frame, m; `slack` times the camera height is the noise part of tau."""

    x: Float[np.ndarray, "n"]
    y: Float[np.ndarray, "n"]
    z: Float[np.ndarray, "n"]
    slack: Float[np.ndarray, "n"]

    @property
    def size(self) -> int:
        """Number of points."""
        return len(self.x)

    def without(self, plane: Plane, config: ScoreConfig) -> Sample:
        """The points that are not on the plane."""
        n = plane.normal
        d = n[0] * self.x + n[1] * self.y + n[2] * self.z + plane.offset_m
        rest = np.abs(d) >= config.base_m + self.slack * plane.offset_m
        return Sample(self.x[rest], self.y[rest], self.z[rest], self.slack[rest])


def draw(
    points: Points, prior: Plane, gate: Gate, rng: np.random.Generator, config: ScoreConfig
) -> Sample:
    """A stratified sample of the points that a plane within the gate could pass through."""
    half = max(gate.highest_m - prior.offset_m, prior.offset_m - gate.lowest_m)
    index = kernels.within(
        points.xyz, prior.normal, prior.offset_m, half + config.base_m, math.tan(gate.tilt_rad)
    )
    if len(index) > SIZE:
        runs = (np.arange(SIZE) + rng.random(SIZE)) * (len(index) / SIZE)
        index = index[runs.astype(np.int64)]
    return Sample(*kernels.take(points.xyz, points.sigma, index, config.sigmas))


def score(
    sample: Sample,
    plane: Plane,
    config: ScoreConfig,
    penalty: float = PENALTY,
    flank: float = 0.0,
) -> float:
    """Points on the plane, minus `penalty` for each one below it and `flank` for each one on its flanks."""
    a, b, c = (float(v) for v in plane.normal)
    return float(
        kernels.score(
            sample, a, b, c, plane.offset_m, config.base_m, penalty, flank, SHARP**2, -math.inf
        )
    )
