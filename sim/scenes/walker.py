"""For whom a scene is made: how much broader and higher than the small robot its walker is.

A scene that grows with its walker keeps the passages, rooms and distances as many times wider; others ignore it.
"""

from __future__ import annotations

from dataclasses import dataclass

from perception.primitives.errors import ConfigError

from ..free_space import ROBOT_TOP_M


@dataclass(frozen=True)
class Walker:
    """A robot as scenes know it.

    Args:
        breadth: Radius of the circle round it, relative to a DARwIn-OP's.
        top_m: Shapes above this height do not block it.
    """

    breadth: float = 1.0
    top_m: float = ROBOT_TOP_M

    def __post_init__(self) -> None:
        if not 0.2 <= self.breadth <= 10.0:
            raise ConfigError(f"scene: a robot {self.breadth:g} times as broad; expected 0.2 to 10")


SMALL = Walker()
"""A DARwIn-OP."""
