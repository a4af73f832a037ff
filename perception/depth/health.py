"""Whether depth shows the floor ahead well enough to walk by, from footstep to footstep.

For each depth image the share of the floor just ahead that has valid depth is computed; the best image counts. A few
low shares in a row mean that depth is lost, a few high ones that it is back, so that one image of a wall or
during a turn changes nothing.

Source: ours; falling back to walking by colour where stereo finds no texture follows seeds 000 and 003.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ..primitives.errors import ConfigError
from ..primitives.frame import Depth
from ..primitives.plane import Plane
from ..primitives.settings import setting
from .coverage import answered_share


@dataclass(frozen=True)
class DepthHealthConfig:
    """When depth counts as lost, and when as back."""

    fall_back: bool = setting(True, "", "walk by colour while depth is lost; else stand", "ours")
    nearest_m: float = 0.2  # seed 003: stereo is reliable from here on
    farthest: float = 4.0  # ours, in camera heights: beyond, ToF sees the floor at a grazing angle
    lost_share: float = setting(
        0.15,
        "",
        "share of the floor ahead with depth below which depth is lost",
        "ours: a floor without texture gives 0 to 0.02, a textured one 0.40 to 0.95",
    )
    found_share: float = 0.30  # ours: above lost_share, as hysteresis
    footsteps: int = 3  # ours: in a row; 2 s, or 14 cm of floor that was seen before

    def __post_init__(self) -> None:
        if not (self.nearest_m >= 0.0 and self.farthest > 0.0):
            raise ConfigError(
                f"depth_health: nearest_m={self.nearest_m} must not be negative, "
                f"farthest={self.farthest} must be positive"
            )
        if not 0.0 < self.lost_share <= self.found_share <= 1.0:
            raise ConfigError(
                f"depth_health: lost_share={self.lost_share} must be positive and not above "
                f"found_share={self.found_share}, which must not exceed 1"
            )
        if self.footsteps < 1:
            raise ConfigError(f"depth_health: footsteps={self.footsteps} must be at least 1")


class DepthHealth:
    """Depth health from footstep to footstep."""

    def __init__(self, config: DepthHealthConfig) -> None:
        self._config = config
        self._contrary = 0  # footsteps in a row that contradict the present state
        self.healthy = True
        """Whether depth may be used; True at the start."""
        self.share: float | None = None
        """Share of the floor ahead with depth at the last footstep; None if no camera looked there."""

    def update(self, seen: Sequence[tuple[Depth, Plane, float]]) -> bool:
        """Take in one footstep; whether depth may be used now.

        Args:
            seen: Each depth image of a footstep with the floor in its camera frame and the sensor's reach, m; empty if
                there is none.
        """
        self.share = self.best_share(seen)
        if self.share is None:
            return self.healthy
        config = self._config
        contrary = (
            self.share < config.lost_share if self.healthy else self.share >= config.found_share
        )
        self._contrary = self._contrary + 1 if contrary else 0
        if self._contrary >= config.footsteps:
            self.healthy, self._contrary = not self.healthy, 0
        return self.healthy

    def best_share(self, seen: Sequence[tuple[Depth, Plane, float]]) -> float | None:
        """Largest share over the images; None if all look elsewhere, 0 without images."""
        config = self._config
        shares = [
            answered_share(
                depth, floor, config.nearest_m, min(config.farthest * floor.offset_m, reach_m)
            )
            for depth, floor, reach_m in seen
        ]
        looking = [share for share in shares if share is not None]
        return max(looking) if looking else (None if shares else 0.0)
