"""Everything that the walker of seed 000 can be told."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from perception.primitives.errors import ConfigError

from .glances import GlanceConfig
from .ground_memory import GroundMemoryConfig
from .objective import PRINTED, ObjectiveConfig
from .search import SwarmConfig

PREDICTIONS = ("tracks", "flow")
VERSIONS = ("ours", "published", "printed")


@dataclass(frozen=True)
class SwarmWalkerConfig:
    """Objective, search and memory, and when which goal holds.

    Args:
        version: "ours": as the values below say. "published": the seed's walker, its misprints mended: a
            swarm with constriction, prediction by flow, neither guard nor glances. "printed": to the letter.
    """

    version: str = "ours"
    objective: ObjectiveConfig = field(default_factory=ObjectiveConfig)
    search: SwarmConfig = field(default_factory=SwarmConfig)
    standing: GroundMemoryConfig = field(default_factory=GroundMemoryConfig)
    glance: GlanceConfig = field(default_factory=GlanceConfig)
    prediction: str = "tracks"  # ours: "flow" is the seed's, by two pictures 0.2 s apart
    guarded: bool = True  # ours: the guard looks 7.8 s ahead, the seed one step
    tilt_deg: float = 30.0  # seed 000: the head is bowed
    goal_times_s: tuple[
        float, ...
    ] = ()  # from when each goal holds; none: when the last is reached

    @property
    def as_walked(self) -> SwarmWalkerConfig:
        """The same with what the version means put in."""
        if self.version == "ours":
            return self
        printed = self.version == "printed"
        return replace(
            self,
            objective=PRINTED if printed else replace(self.objective, inside=False),
            search=replace(self.search, mode="literal" if printed else "constriction"),
            glance=replace(self.glance, enabled=False),
            prediction="flow",
            guarded=False,
        )

    def __post_init__(self) -> None:
        if self.version not in VERSIONS:
            raise ConfigError(
                f"swarm: version={self.version!r} is unknown; choose {', '.join(VERSIONS)}"
            )
        if not 0.0 <= self.tilt_deg <= 60.0:
            raise ConfigError(
                f"swarm: tilt_deg={self.tilt_deg} must lie in [0, 60], where the head can look"
            )
        if self.prediction not in PREDICTIONS:
            raise ConfigError(
                f"swarm: prediction={self.prediction!r} is unknown; choose {', '.join(PREDICTIONS)}"
            )
        if list(self.goal_times_s) != sorted(self.goal_times_s):
            raise ConfigError(f"swarm: goal_times_s={self.goal_times_s} must not go back in time")
