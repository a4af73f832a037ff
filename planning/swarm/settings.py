"""Settings of the planner of seed 000."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from perception.primitives.errors import ConfigError
from perception.primitives.settings import setting

from .objective import PRINTED, ObjectiveConfig
from .search import SwarmConfig

PREDICTIONS = ("tracks", "flow")
VERSIONS = ("ours", "published", "printed")


@dataclass(frozen=True)
class SwarmWalkerConfig:
    """Objective, search, prediction, and the schedule of the goals.

    Args:
        version: "ours": the values below. "published": the walker of the paper with its misprints corrected: a
            swarm with constriction, prediction by optical flow, steps of 0.04 m; no guard, no glances, and no
            exemption that is ours. "printed": to the letter.
    """

    version: str = setting(
        "ours", "", "ours, published or printed: which form of the paper", "ours"
    )
    objective: ObjectiveConfig = field(default_factory=ObjectiveConfig)
    search: SwarmConfig = field(default_factory=SwarmConfig)
    prediction: str = setting(
        "tracks", "", "prediction of moving obstacles: tracks or flow", "ours; seed 000: flow"
    )
    glances: bool = setting(
        True, "", "looks aside for moving obstacles out of sight", "ours; seed 000: none"
    )
    tilt_deg: float = setting(30.0, "deg", "tilt of the head, down positive", "seed 000")
    goal_times_s: tuple[float, ...] = setting(
        (),
        "s",
        "time from which each goal holds; empty: from the arrival at the one before",
        "seed 000, section 6.5.1",
    )
    guarded: bool = True  # ours: the guard looks 7.8 s ahead, the paper one step

    @property
    def as_walked(self) -> SwarmWalkerConfig:
        """The settings with those that the version implies."""
        if self.version == "ours":
            return self
        printed = self.version == "printed"
        return replace(
            self,
            objective=PRINTED if printed else self.objective,
            search=replace(self.search, mode="literal" if printed else "constriction"),
            glances=False,
            prediction="flow",
            guarded=False,
        )

    def __post_init__(self) -> None:
        if self.version not in VERSIONS:
            raise ConfigError(
                f"swarm: version={self.version!r} is unknown; choose {', '.join(VERSIONS)}"
            )
        if not 0.0 <= self.tilt_deg <= 60.0:
            raise ConfigError(f"swarm: tilt_deg={self.tilt_deg} must lie in [0, 60]")
        if self.prediction not in PREDICTIONS:
            raise ConfigError(
                f"swarm: prediction={self.prediction!r} is unknown; choose {', '.join(PREDICTIONS)}"
            )
        if list(self.goal_times_s) != sorted(self.goal_times_s):
            raise ConfigError(f"swarm: goal_times_s={self.goal_times_s} must not decrease")
