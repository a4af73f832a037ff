"""Which part of a depth image is used."""

from __future__ import annotations

from dataclasses import dataclass

from ..primitives.errors import ConfigError


@dataclass(frozen=True)
class ReachConfig:
    """Which part of a depth image is believed."""

    nearest_m: float = 0.15
    farthest_m: float = 3.0
    stride: int = 1  # 2 takes every second row and column

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
    """The reach of each kind of depth sensor."""

    tof: ReachConfig = ReachConfig(0.15, 3.0, 1)  # seed 004: 5 m wrap, noise 20 mm at 3 m
    stereo: ReachConfig = ReachConfig(
        0.20, 2.0, 2
    )  # seed 003: floor to 3 m; beyond 2 m TOF is better
    depth: ReachConfig = ReachConfig(0.30, 4.0, 2)  # Kinect kind: steps of centimetres beyond 4 m
