"""Whether depth is to be trusted, footstep by footstep, by what the sensors themselves answer.

Each depth image is asked how much of the floor just ahead it answers for; the best one counts. A few bare
answers in a row lose the trust, a few good ones give it back: one image at a wall or in a turn decides nothing.

Source: ours; that a walker by colour is the way out where stereo has no texture follows seeds 000 and 003.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ..primitives.errors import ConfigError
from ..primitives.frame import Depth
from ..primitives.plane import Plane
from .coverage import answered_share


@dataclass(frozen=True)
class DepthTrustConfig:
    """When the walker by colour takes over from a planner that needs depth, and when it hands back."""

    fall_back: bool = True  # ours: where there is a colour camera
    nearest_m: float = 0.2  # seed 003: stereo is reliable from here on
    farthest_m: float = 1.5  # ours: beyond, time of flight sees the floor too aslant for an echo
    lost_share: float = (
        0.15  # ours: a bare floor answers with 0 to 2 %, a painted one with 40 to 95 %
    )
    found_share: float = 0.30  # ours: apart from the first, or it would go to and fro
    footsteps: int = 3  # ours: in a row; 2 s, 14 cm over floor that was seen before

    def __post_init__(self) -> None:
        if not 0.0 <= self.nearest_m < self.farthest_m:
            raise ConfigError(
                f"depth_trust: nearest_m={self.nearest_m} must not be negative and be below "
                f"farthest_m={self.farthest_m}"
            )
        if not 0.0 < self.lost_share <= self.found_share <= 1.0:
            raise ConfigError(
                f"depth_trust: lost_share={self.lost_share} must be positive and not above "
                f"found_share={self.found_share}, which must not exceed 1"
            )
        if self.footsteps < 1:
            raise ConfigError(f"depth_trust: footsteps={self.footsteps} must be at least 1")


class DepthTrust:
    """Lives from footstep to footstep."""

    def __init__(self, config: DepthTrustConfig) -> None:
        self._config = config
        self._against = 0
        self.trusted = True
        """At first it is: there is no reason yet why not."""
        self.share: float | None = None
        """Of the floor ahead answered for at the last footstep; None if nobody looked there."""

    def update(self, seen: Sequence[tuple[Depth, Plane]]) -> bool:
        """Whether depth is trusted now.

        Args:
            seen: Each depth image of a footstep, when every camera looks, and the floor in its camera
                frame; none if nobody gave depth.
        """
        self.share = self.best_share(seen)
        if self.share is None:
            return self.trusted
        config = self._config
        contrary = (
            self.share < config.lost_share if self.trusted else self.share >= config.found_share
        )
        self._against = self._against + 1 if contrary else 0
        if self._against >= config.footsteps:
            self.trusted, self._against = not self.trusted, 0
        return self.trusted

    def best_share(self, seen: Sequence[tuple[Depth, Plane]]) -> float | None:
        """Of the floor ahead, what the best of the images answers for; None if all look elsewhere."""
        config = self._config
        shares = [
            answered_share(depth, floor, config.nearest_m, config.farthest_m)
            for depth, floor in seen
        ]
        looking = [share for share in shares if share is not None]
        return max(looking) if looking else (None if shares else 0.0)
