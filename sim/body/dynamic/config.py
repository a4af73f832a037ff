"""Parameters of the dynamic body and its floor."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from perception.primitives.errors import ConfigError
from perception.primitives.settings import setting

from ...ranges import check_ranges
from .anatomy import ANATOMIES, Anatomy
from .balance import BalanceConfig
from .physics import ENGINES


@dataclass(frozen=True)
class DynamicConfig:
    """The walking body and the imperfections of body and floor.

    Args:
        backlash_deg: Backlash of the gears, from flank to flank.
        offset_deg: Standard deviation of each joint's offset, constant within a run.
        encoder_deg: Resolution of the leg encoders.
        balance: Parameters of the balance control.
    """

    engine: str = setting(
        "pybullet",
        "",
        "physics engine: pybullet or mujoco (pip install 'surefoot[physics]')",
        "ours",
    )
    anatomy: str = setting(
        "darwin", "", "body dimensions, darwin or tall; also used by the kinematic body", "seed 004"
    )
    scale: float = setting(1.0, "", "factor of all lengths of the anatomy, 0.5 to 3", "ours")
    backlash_deg: float = 0.5  # hobby servos; without it the walk is unrealistically smooth
    offset_deg: float = 0.3  # ours: zeros adjusted by eye
    encoder_deg: float = 360.0 / 4096.0  # MX-28: 4096 counts per turn
    bump_m: float = setting(
        0.002, "m", "greatest height of floor bumps", "ours: floorboards, seams of carpets"
    )
    slope_rad: tuple[float, float] = setting(
        (0.0, 0.0), "rad", "slope of the floor along x and y of the world", "ours: level"
    )
    balance: BalanceConfig = field(default_factory=BalanceConfig)

    def __post_init__(self) -> None:
        if self.engine not in ENGINES:
            raise ConfigError(
                f"dynamic: engine={self.engine!r} is unknown; choose {', '.join(ENGINES)}"
            )
        if self.anatomy not in ANATOMIES:
            raise ConfigError(
                f"dynamic: anatomy={self.anatomy!r} is unknown; choose {', '.join(ANATOMIES)}"
            )
        ANATOMIES[self.anatomy].scaled(self.scale)
        check_ranges(
            "dynamic",
            self,
            backlash_deg=(0.0, 10.0),
            offset_deg=(0.0, 10.0),
            encoder_deg=(0.0, 10.0),
            bump_m=(0.0, 0.05),
        )
        if not all(abs(value) < 0.3 for value in self.slope_rad):
            raise ConfigError(f"dynamic: slope_rad={self.slope_rad} must be below 0.3 rad")

    @property
    def body(self) -> Anatomy:
        """The scaled anatomy."""
        return ANATOMIES[self.anatomy].scaled(self.scale)

    @property
    def up(self) -> tuple[float, float, float]:
        """Unit vector against gravity, world frame, where the floor stays z = 0 on a slope too."""
        x, y = (math.sin(rise) for rise in self.slope_rad)
        return x, y, math.sqrt(1.0 - x * x - y * y)
