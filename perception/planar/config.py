"""Noise parameters of planar localisation."""

from __future__ import annotations

import collections
import dataclasses
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ..primitives.errors import ConfigError


@dataclass(frozen=True)
class PlanarConfig:
    """Noise of odometry and sightings: initial guesses, which `planar_fit.fit` improves."""

    along: float = 0.05  # ours: m per root of a metre travelled
    across: float = 0.03  # ours: likewise
    turn_per_path: float = 0.02  # ours: rad per root of a metre
    turn_per_turn: float = 0.1  # ours: rad per root of a radian turned
    turn_per_time: float = 0.002  # ours: rad per root of a second
    odometry_scale_walk: float = 1e-4  # ours: per root of a second; wheels are nearly constant
    turn_scale_walk: float = 1e-4  # ours: likewise
    drift_walk: float = 1e-5  # ours: rad/s per root of a second
    gain_walk: float = 1e-5  # ours: per root of a second; scale of the depths
    lens_walk: float = 1e-5  # ours: rad per root of a second; a lens is nearly constant
    offset: float = 0.04  # ours: m, measured depth of a tag at the body's centre
    scale: float = 1.01  # ours: measured depth per true depth
    depth_near: float = 0.01  # ours: m, standard deviation of a small depth
    depth_far: float = 0.001  # ours: 1/m, its growth with the square of the depth
    bearing_sigma: float = 0.004  # ours: rad, about two pixels
    bearing_turning: float = (
        0.04  # ours: s, bearing error while turning, by exposure and time stamps
    )
    depth_shared: float = 1.0  # ours: common error of all depths, in their standard deviations
    depth_memory: float = 10.0  # ours: s, its correlation time
    bearing_shared: float = 0.008  # ours: rad, common error of all bearings
    bearing_memory: float = 5.0  # ours: s
    place: float = 0.02  # ours: m, position error of a tag in the map, per axis
    place_memory: float = 30.0  # ours: s; seen from elsewhere the error differs
    outlier: float = 0.01  # ours: share of outliers
    outlier_density: float = 0.15  # 1 / (7 m by 1 rad): the field of view of a small camera
    gate: float = 25.0  # ours: largest normalised innovation squared, five standard deviations
    recover_after: int = 6  # ours: rejected sightings in a row before recovery
    recovery_m: float = 0.3  # ours: standard deviation added then, doubled every next time
    recovery_rad: float = 0.3  # ours: likewise

    def __post_init__(self) -> None:
        for name, value in dataclasses.asdict(self).items():
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"planar: {name}={value} must be positive and finite")
        if self.outlier >= 1.0:
            raise ConfigError(f"planar: outlier={self.outlier} is a share and must lie below 1")

    @property
    def parameters(self) -> Parameters:
        """The same values for the kernels."""
        values: list[Any] = [float(value) for value in dataclasses.astuple(self)]
        return Parameters(*values)


if TYPE_CHECKING:
    Parameters = PlanarConfig
else:  # numba reads the fields of a named tuple
    Parameters = collections.namedtuple(
        "Parameters", [one.name for one in dataclasses.fields(PlanarConfig)]
    )
