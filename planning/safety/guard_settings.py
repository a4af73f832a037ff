"""What the guard is told: horizon, margins, hypotheses and prices.

Source: ours, from a study in simulation; the body's radius from seed 001.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from perception.primitives.errors import ConfigError

from .prediction import PredictionConfig

CELL_DISTANCE_M = 0.185
"""Ours: distance from the middle of a DARwIn-OP to that of an occupied cell, with 1 cm to spare; grows with the body."""

CELL_CONTACT_M = 0.15
"""Ours: the same at contact."""


@dataclass(frozen=True)
class GuardConfig:
    """Horizon, margins, hypotheses and prices."""

    prediction: PredictionConfig = field(default_factory=PredictionConfig)
    steps: int = 12  # own: 7.8 s, what the study found enough
    margin_m: float = 0.05  # ours: between surfaces, of movers
    sigmas: float = 1.0  # ours: share of the deviation added to the margin
    max_sigma_m: float = 0.15  # ours: more doubt than this would freeze the robot
    still_margin_m: float = 0.02  # ours: the same, of what stands: it is certain
    acceleration_mps2: float = 0.004  # ours: of movers, how their covariance grows
    sure_s: float = 3.0  # ours: covariances of later are taken from here: by then more is known
    small_radius_m: float = 0.20  # ours: larger standing tracks are left to the occupied cells
    doubt_s: float = (
        2.5  # ours (study: 3.3): how long the hypotheses that it turned back unseen are followed
    )
    longest_unseen_s: float = (
        15.0  # ours: a mover lost for longer is taken to be lost for this long
    )
    turns_every_s: float = 20.0  # navigation trials: movers turn every 12 to 25 s
    turn_weight: float = 0.25  # ours: a turn within the time that getting out of the way takes
    learnt_weight: float = 0.04  # ours: the same where it was never seen to turn
    lost_weight: float = 0.3  # ours: of what was lost somewhere on its line
    react_s: float = 1.3  # ours: until a turn is noticed and the robot makes its next step
    at_heels: float = 0.0  # ours: what each step close to who may turn back adds, as a share of
    # being late; for movers as slow as the robot: among faster ones, heeded at its worst moment alone, it
    # dawdled (22 for 30 of 40 hard courses)
    soft_m: float = 0.10  # ours: band beyond the margin that is avoided if it costs little
    uneasy_m: float = 0.15  # ours: m of detour that leaving the band is worth
    steep: float = 40.0  # ours: m of detour that each m of missing distance is worth
    contact_m: float = 4.0  # ours: m of detour that a contact is worth, beside that
    w_heading: float = 0.05  # ours: m per rad of facing away from the target at the end
    keep_m: float = 0.04  # ours: another plan must be better by so much than the one begun ...
    keep_share: float = 0.15  # ours: ... and by this share of its harm: who wavers is caught
    pass_m: float = 0.10  # ours: the desired step passes if it does no more harm than this
    fade_s: float = 8.0  # ours: harm this much later weighs 1/e; 4 puts squeezes off, 16 dawdles

    def __post_init__(self) -> None:
        if self.steps < 1:
            raise ConfigError(f"guard: steps={self.steps} must be at least 1")
        for name in ("doubt_s", "soft_m", "fade_s", "turns_every_s"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"guard: {name}={value} must be positive and finite")
        if not (math.isfinite(self.at_heels) and self.at_heels >= 0.0):
            raise ConfigError(f"guard: at_heels={self.at_heels} must be finite and not negative")
        if not 0.0 <= self.keep_share < 1.0:
            raise ConfigError(f"guard: keep_share={self.keep_share} must lie in [0, 1)")
