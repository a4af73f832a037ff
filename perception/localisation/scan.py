"""What rises from the floor, as one level line: the fronts of walls and furniture in every direction.

Of all obstacle points that lie in one direction those are taken that form an upright surface; each such
place gets the normal of the line through its neighbours. Such a scan is what registration compares: it
weighs a hundred places where the image has ten thousand points, and each is surer than any of these.

Source: ours; the use of lines between places: Censi, "An ICP variant using a point-to-line metric" (ICRA
2008).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..primitives.errors import ConfigError, InputError
from ..primitives.pose import Pose2
from . import _registration_kernels as kernels


@dataclass(frozen=True)
class ScanConfig:
    """Which points make an upright surface."""

    lowest_m: float = 0.04  # ours: below, floor and wall run into each other
    highest_m: float = 0.50  # seed 003: robot's height + 0.1 m, less the noise of the levelling
    bearings: int = 720  # ours: half a degree; two columns of the time-of-flight camera
    layer_m: float = 0.03  # ours: thickness of a surface with its noise, at 3 m
    least_points: int = 5  # ours: fewer in a layer are flying pixels
    least_share: float = 0.4  # ours: of the points in one direction
    shared_sigma_m: float = 0.003  # ours: what averaging in one direction does not remove
    neighbours_m: float = 0.10  # ours: a line is fitted to so much on either side
    spacing_m: float = 0.02  # ours: nearer places say the same
    flatness_m: float = 0.012  # ours: deviation from the line, at most
    least_neighbours: int = 4  # ours

    def __post_init__(self) -> None:
        if not self.lowest_m < self.highest_m:
            raise ConfigError(
                f"scan: lowest_m={self.lowest_m} must be below highest_m={self.highest_m}"
            )
        if self.bearings < 8 or self.least_points < 1 or self.least_neighbours < 2:
            raise ConfigError(
                f"scan: bearings={self.bearings} must be at least 8, "
                f"least_points={self.least_points} at least 1, "
                f"least_neighbours={self.least_neighbours} at least 2"
            )
        for name in ("layer_m", "shared_sigma_m", "neighbours_m", "flatness_m"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"scan: {name}={value} must be positive and finite")


@dataclass(frozen=True)
class Scan:
    """Fronts of what stands about.

    Args:
        places: On the floor, body frame, m.
        normals: Unit, towards the sensor.
        sigmas: Deviation along the normal, m; what all places of a scan have in common is not in it.
    """

    places: Float[np.ndarray, "n 2"]
    normals: Float[np.ndarray, "n 2"]
    sigmas: Float[np.ndarray, "n"]

    def __len__(self) -> int:
        return len(self.places)

    def at(self, pose: Pose2) -> Scan:
        """The same in the frame that the pose is in."""
        return Scan(pose.apply(self.places), self.normals @ pose.rotation.T, self.sigmas)


def scan(
    points: Float[np.ndarray, "n 3"],
    sigma: Float[np.ndarray, "n"],
    sensor: Float[np.ndarray, "2"],
    config: ScanConfig | None = None,
) -> Scan:
    """The fronts that one sensor sees.

    Args:
        points: Of what rises, nothing that moves among them; upright body frame, z above the floor, m.
        sigma: Deviation of each along its ray, m.
        sensor: Place of the sensor in the body frame, m.
        config: Defaults if None.

    Returns:
        Places in order of bearing; none if nothing upright is seen.

    Raises:
        InputError: Not as many deviations as points.
    """
    config = config or ScanConfig()
    if len(points) != len(sigma):
        raise InputError(f"scan: {len(points)} points but {len(sigma)} deviations")
    inside = (points[:, 2] > config.lowest_m) & (points[:, 2] < config.highest_m)
    inside &= np.isfinite(points).all(axis=1) & (sigma > 0.0) & np.isfinite(sigma)
    places, deviations = kernels.edges(
        np.ascontiguousarray(points[inside, :2], np.float64),
        np.ascontiguousarray(sigma[inside], np.float64),
        np.ascontiguousarray(sensor, np.float64),
        config.bearings,
        config.layer_m,
        config.least_points,
        config.least_share,
    )
    kept, normals = kernels.normals(
        places,
        np.ascontiguousarray(sensor, np.float64),
        config.neighbours_m,
        config.spacing_m,
        config.flatness_m,
        config.least_neighbours,
    )
    return Scan(places[kept], normals, np.hypot(deviations[kept], config.shared_sigma_m))


def joined(scans: list[Scan]) -> Scan:
    """Several scans of one instant as one."""
    if not scans:
        return Scan(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0))
    return Scan(
        np.concatenate([one.places for one in scans]),
        np.concatenate([one.normals for one in scans]),
        np.concatenate([one.sigmas for one in scans]),
    )
