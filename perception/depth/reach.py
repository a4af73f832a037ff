"""The range of depths that is used, for each kind of depth sensor."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..primitives.errors import ConfigError
from ..primitives.frame import Depth
from ..primitives.settings import setting

NARROW = 160  # ours: columns; of a narrower image every pixel is used
PAIR_PX_M = (
    22.2  # seed 003: focal length, 554 px, times baseline, 40 mm, of the pair whose reach is 2 m
)


@dataclass(frozen=True)
class ReachConfig:
    """The part of a depth image that is used."""

    nearest_m: float = setting(
        0.15, "m", "depth below which pixels are ignored", "ours: limits of each sensor"
    )
    farthest_m: float = setting(
        3.0,
        "m",
        "depth beyond which pixels are ignored, but for the surface map (`surface.farthest_m`); times the root of "
        "f B / 22.2 px m for a stereo pair with a larger product of focal length and baseline",
        "ours: limits of each sensor",
    )
    stride: int = 1  # 2: every second row and column

    def __post_init__(self) -> None:
        if not 0.0 <= self.nearest_m < self.farthest_m:
            raise ConfigError(
                f"reach: nearest_m={self.nearest_m} must not be negative and be below "
                f"farthest_m={self.farthest_m}"
            )
        if self.stride < 1:
            raise ConfigError(f"reach: stride={self.stride} must be at least 1")


@dataclass(frozen=True)
class ReachesConfig:
    """The range of depths used from each kind of sensor."""

    tof: ReachConfig = ReachConfig(0.15, 3.0, 1)  # seed 004: 5 m ambiguity, noise 20 mm at 3 m
    stereo: ReachConfig = ReachConfig(
        0.20, 2.0, 2
    )  # seed 003: to 3 m; beyond 2 m TOF is better; see `of`
    depth: ReachConfig = ReachConfig(0.30, 4.0, 2)  # Kinect: quantised to centimetres beyond 4 m

    def of(self, source: str, depth: Depth) -> ReachConfig:
        """The range of a depth source with such images; a user's own has that of an RGB-D camera.

        sigma_Z = Z^2 sigma_d / (f B): with a longer baseline or focal length than that of seed 003's pair, depth is
        as good as at that pair's farthest up to a distance that grows with the root of f B.
        """
        found: ReachConfig = getattr(self, source, self.depth)
        pair = depth.camera.fx * depth.baseline_m if source == "stereo" else 0.0
        farther = math.sqrt(max(1.0, pair / PAIR_PX_M))
        return ReachConfig(
            found.nearest_m,
            found.farthest_m * farther,
            1 if depth.camera.width < NARROW else found.stride,
        )
