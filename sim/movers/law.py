"""A law of motion, and the names of all laws.

A law answers, every tick, with the velocity that a mover wants; `traffic` moves it there if nothing is in the way.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from perception.primitives.errors import ConfigError
from perception.primitives.settings import setting

from ..scene import TO_AND_FRO

LAWS = (
    TO_AND_FRO,
    "waypoints",
    "curves",
    "stop_and_go",
    "follower",
    "stream",
    "group",
    "social_force",
    "social_force_reacting",
    "unicycle",
    "standing",
)
"""Names of the laws; see `traffic.law_of`."""

MIXED = "mixed"
"""Each mover by a law that the seed draws."""

Velocity = tuple[float, float]
"""(vx, vy), m/s."""


@dataclass
class Mover:
    """The state of a mover.

    Args:
        x, y, vx, vy: Place and velocity, m and m/s.
        radius_m: Of the circle that it covers.
        heading_rad: Direction in which it moved last.
        travelled_m: Length of its path, for its legs.
    """

    x: float
    y: float
    vx: float
    vy: float
    radius_m: float
    heading_rad: float = 0.0
    travelled_m: float = 0.0


@runtime_checkable
class Law(Protocol):
    """How one mover moves.

    Args:
        sidesteps: Whether it goes round what is in the way, as people do; else it stands.
    """

    sidesteps: bool

    def velocity(
        self, stamp_s: float, me: Mover, movers: Sequence[Mover], robot: Mover | None
    ) -> Velocity:
        """The velocity that it wants for the next tick.

        Args:
            stamp_s: Time, s.
            me: The mover.
            movers: All movers, itself included.
            robot: The robot; None without one. Most laws do not see it.
        """

    def blocked(self, stamp_s: float) -> None:
        """Its last wish was impossible: something was in the way, and it stands."""


@dataclass(frozen=True)
class MoversConfig:
    """How the moving objects of a scene move."""

    law: str = setting(
        TO_AND_FRO,
        "",
        f"law of all moving objects: {', '.join(LAWS)}; or {MIXED}, one drawn for each",
        "ours; to_and_fro: as the scene sets each",
    )
    legs: bool = setting(
        False, "", "people have two legs that swing instead of a round foot", "ours"
    )

    def __post_init__(self) -> None:
        if self.law not in (*LAWS, MIXED):
            raise ConfigError(
                f"movers: law={self.law!r} is unknown; choose {', '.join(LAWS)} or {MIXED}"
            )
