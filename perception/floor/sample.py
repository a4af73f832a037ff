"""A small sample of the points to search in, and what makes a plane a floor.

The sample is stratified over the image: one point at random of each of some two thousand equal runs of
points in row order. Searching it costs the same for every image size; the final fit takes all points.

Source: ours; the threshold tau(Z) seed 003, section 3.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..depth.points import Points
from ..primitives.errors import ConfigError
from ..primitives.plane import Plane
from . import _search_kernels as kernels
from .prior import Gate


@dataclass(frozen=True)
class ScoreConfig:
    """When a point is on a plane, and what points below it weigh."""

    size: int = (
        2048  # performance study: 2048 stratified points find the floor in half a millisecond
    )
    base_m: float = 0.01  # seed 003: tau = 0.01 + 3 sigma_Z h / Z
    sigmas: float = 3.0  # seed 003
    sharp: float = 3.0  # ours: a point counts within tau / sharp; more, and floor and ramp are one
    penalty: float = (
        6.0  # ours: points a point below outweighs; a table shows its legs and the floor
    )

    def __post_init__(self) -> None:
        if self.size < 50:
            raise ConfigError(f"floor: size={self.size} of the sample must be at least 50")
        for name in ("base_m", "sigmas", "sharp"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"floor: {name}={value} must be positive and finite")
        if not self.penalty >= 0.0:
            raise ConfigError(f"floor: penalty={self.penalty} must not be negative")


@dataclass(frozen=True)
class Sample:
    """Points in columns, camera frame, m; slack is tau's part that grows with the camera's height."""

    x: Float[np.ndarray, "n"]
    y: Float[np.ndarray, "n"]
    z: Float[np.ndarray, "n"]
    slack: Float[np.ndarray, "n"]

    def __len__(self) -> int:
        return len(self.x)

    def without(self, plane: Plane, config: ScoreConfig) -> Sample:
        """Those that do not lie on the plane."""
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
    if len(index) > config.size:
        runs = (np.arange(config.size) + rng.random(config.size)) * (len(index) / config.size)
        index = index[runs.astype(np.int64)]
    return Sample(*kernels.take(points.xyz, points.sigma, index, config.sigmas))


def score(sample: Sample, plane: Plane, config: ScoreConfig, penalty: float | None = None) -> float:
    """Points on the plane, less those below it times the penalty (the configured one if None)."""
    a, b, c = (float(v) for v in plane.normal)
    return float(
        kernels.score(
            sample.x,
            sample.y,
            sample.z,
            sample.slack,
            a,
            b,
            c,
            plane.offset_m,
            config.base_m,
            config.penalty if penalty is None else penalty,
            config.sharp**2,
            -math.inf,
        )
    )
