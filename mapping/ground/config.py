"""Settings of the map of the ground."""

from __future__ import annotations

import math
from dataclasses import dataclass

from perception.primitives.errors import ConfigError
from perception.primitives.settings import setting

MOST_REACH_M = 50.0  # ours: cells within it are held in memory


@dataclass(frozen=True)
class GroundConfig:
    """How far the map reaches, and how well the joints know where the robot stands."""

    enabled: bool = setting(
        False,
        "",
        "keep a map of ground of several levels; needs the camera's place on the body",
        "ours: costs nearly half of a frame, and flat ground does not need it",
    )
    reach_m: float = setting(
        3.0, "m", "distance to which surfaces are kept", "ours: some steps ahead; sensors reach 3 m"
    )
    behind_m: float = 1.0  # ours: the same behind the robot; a step back, and the foot left behind
    # Ours: what is farther away or behind; else it stays, with an error that grows.
    forgets: bool = True
    start_m: float = 0.12  # ours: radius of the ground that is known at the start, unseen: a stance
    stand_sigma_m: float = (
        0.003  # ours: soles; standard deviation of the height of the ground below the feet
    )
    stand_tilt_deg: float = (
        0.5  # ours: floors are built level; standard deviation of its slopes at the start
    )
    lasting_share: float = setting(
        0.1,
        "",
        "part of the variance of the camera's pose that is the same in every view: joint offsets",
        "ours: walking trials, offsets .3 deg of 1.2 deg",
    )

    def __post_init__(self) -> None:
        for name in ("reach_m", "behind_m", "start_m", "stand_sigma_m", "stand_tilt_deg"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"ground: {name}={value} must be positive and finite")
        if self.reach_m > MOST_REACH_M:
            raise ConfigError(f"ground: reach_m={self.reach_m} must be at most {MOST_REACH_M:g} m")
        if not 0.0 <= self.lasting_share <= 1.0:
            raise ConfigError(f"ground: lasting_share={self.lasting_share} must lie within 0 and 1")
