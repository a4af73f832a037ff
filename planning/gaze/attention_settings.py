"""What attention is told: directions and weights, how urgency grows, what a landmark may tell.

Source: seeds 000 and 001 as noted; the rest is ours, from walks in simulation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from perception.primitives.errors import ConfigError

from .evaluations import EvaluationConfig
from .selection import GazeMapConfig

LIVE_MAP = GazeMapConfig(
    evaluation=EvaluationConfig(self_sigma_m=0.03),
    step_deg=3.0,
    map_weight=0.20,
    obstacle_weight=0.40,
)
"""Ours: with tags the place is known to 1 or 2 cm, which by T_sf = 0.10 m would never turn the head; contacts
are with what nobody looked at, so movers weigh more than stale ground; 3 deg take half the time of 2 deg."""


@dataclass(frozen=True)
class AttentionConfig:
    """Directions and weights, and how urgency grows."""

    map: GazeMapConfig = field(default_factory=lambda: LIVE_MAP)
    ground_m: float = (
        1.75  # ours: stale ground counts to the edge of the terrain map; seed 001: 1.3
    )
    unwatched_s: float = 2.0  # ours: the way not looked at for so long has its whole worth
    urgency_max: float = 4.0  # ours: and up to so many times that later
    way_floor: float = 0.3  # ours: psi_way counts at least this, or who is crowded walks blind
    seek_s: float = 1.0  # ours: a mover unseen for so long is worth a look ...
    near_m: float = 1.2  # ours: ... wholly if it is this near ...
    far_m: float = 2.2  # ours: ... and not at all beyond this
    receding: float = 0.5  # ours: share of that for a mover that goes away
    young_s: float = 3.0  # ours: a track followed for less than this may still prove to move
    young_share: float = 0.4  # ours: a look at such a thing is worth so much of one at a mover
    seek_max: float = 3.0  # ours: worth of the most overdue look, in those of one that is due
    again_share: float = 0.5  # ours: worth of a thing without a track after each look in vain ...
    met_s: float = 8.0  # ours: ... for so long
    hidden_m: float = 0.10  # ours: so much of a thing may be hidden beyond the edge of the view
    close_m: float = (
        0.7  # ours: a thing without a track this near is as urgent as a mover long unseen
    )
    new_apart_m: float = 0.25  # ours: nearer than this to a track, or to one before, it is the same
    turned_back_s: float = 3.0  # ours: unseen for longer, it may as well have turned back
    edge_deg: float = 12.0  # ours: kept off the sides of the view, where things are cut in two
    tag_across_deg: float = 90.0  # seed 000: the colour camera, which sees the landmarks
    tag_reach_m: float = 3.5  # ours: beyond it a tag is too small
    tag_range_per_m: float = (
        0.0035  # ours: deviation of a range to a tag, by its square, as claimed
    )
    tag_bearing_deg: float = 0.4  # ours: head play, roll of the stride, as claimed
    tag_doubt: float = 0.4  # ours: what a look in vain leaves of the trust that a tag can be seen
    tag_forget_s: float = 10.0  # ours: how soon that is forgotten: from elsewhere it may be seen

    def __post_init__(self) -> None:
        for name in (
            "unwatched_s",
            "seek_s",
            "met_s",
            "hidden_m",
            "tag_reach_m",
            "tag_forget_s",
        ):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"gaze: {name}={value} must be positive and finite")
        if not 0.0 < self.near_m < self.far_m:
            raise ConfigError(
                f"gaze: near_m={self.near_m} must be positive and below far_m={self.far_m}"
            )
        if not 0.0 < self.again_share <= 1.0:
            raise ConfigError(f"gaze: again_share={self.again_share} must lie in (0, 1]")
        if not 0.0 <= self.edge_deg < self.map.across_deg:
            raise ConfigError(
                f"gaze: edge_deg={self.edge_deg} must lie in [0, across_deg={self.map.across_deg})"
            )

    def nearness(self, away_m: float) -> float:
        """Share of its worth that a thing has at a distance, in [0, 1]."""
        return min(max((self.far_m - away_m) / (self.far_m - self.near_m), 0.0), 1.0)
