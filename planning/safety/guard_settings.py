"""Settings and constants of the guard: horizon, margins, hypotheses and costs.

Costs are lengths: the detour that avoiding them is worth.

Source: ours, from a study in simulation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from perception.primitives.errors import ConfigError
from perception.primitives.settings import setting

CELL_CONTACT_M = 0.15
"""Ours: distance of the middle of a DARwIn-OP to that of a cell at contact; grows with breadth."""

MOST_STEPS = 100  # ours: every plan is held in memory
MOST_MARGIN_M = 5.0  # ours: cells within it are searched
STILL_MARGIN_M = 0.02  # ours: margin to a static obstacle
SMALL_RADIUS_M = 0.20  # ours: larger static tracks are represented by occupied cells alone
SURE_S = 3.0  # ours: the covariance grows no longer than this; later the obstacle is observed again
DOUBT_S = 2.5  # ours: how far ahead the hypotheses of an unseen reversal are followed
LONGEST_UNSEEN_S = 15.0  # ours: cap on the time since the last sighting
TURNS_EVERY_S = 15.0  # ours: mean time between turns of an obstacle without modes of motion
ESCAPE_S = 4.0
"""Ours: time in which the robot gets out of the path of an obstacle; after the end of a plan the risk counts for as long."""

LOST_WEIGHT = 0.3  # ours: weight of a target lost somewhere on its line
RISK_S = 2.6  # ours: time for which the probability of contact is bounded; until then a new plan can take effect
EXPECTED_CONTACT_M = 10.0
"""Ours: detour that avoiding a contact is worth. With 20 fewer walks arrive; with 100 a third does not."""

OUT_OF_VIEW_M = 0.3
"""Ours: detour that keeping a near mover in view is worth. With 1 there were more contacts and fewer arrivals; both with a
contact worth 20 m."""

HALF_VIEW_DEG = 25.0
"""Ours: half the field of view of the camera to aim; the whole is 44 deg for seed 004, 60 for seed 001."""

NEAR_M, FAR_M = 1.2, 2.2
"""Ours, from walks in simulation: up to the first a mover counts as near, beyond the second it does not; also for the gaze."""

SIZE_SIGMA_M = 0.01  # ours: standard deviation of the distance of contact by the two sizes
SOFT_M = 0.10  # ours: width of the band beyond the margin that costs a little
SOFT_COST_M = 0.15  # ours: cost at the inner edge of that band
STEEP = 40.0  # ours: cost per metre of missing distance
CONTACT_COST_M = 4.0  # ours: further cost of a contact
HEADING_COST_M = 0.05  # ours: cost per rad of facing away from the target at the end
PASS_M = 0.10  # ours: a desired step with no more cost than this passes


@dataclass(frozen=True)
class GuardConfig:
    """Horizon, margins, hypotheses and costs."""

    steps: int = setting(12, "", "steps that each plan is rolled out for", "ours: 7.8 s suffice")
    margin_m: float = setting(
        0.05, "m", "gap kept between the body and a moving obstacle", "ours: surface to surface"
    )
    sigmas: float = setting(
        1.0, "", "standard deviations of relative position added to the margin", "ours"
    )
    max_sigma_m: float = (
        0.15  # ours: more would freeze the robot; largest standard deviation that is added
    )
    acceleration_mps2: float = (
        0.004  # ours; random acceleration in the prediction of obstacles without modes of motion
    )
    react_s: float = setting(
        1.3, "s", "time until a reversal is noticed and the next step begins", "ours: two steps"
    )
    fade_s: float = (
        8.0  # ours: 4 reacts late, 16 hesitates; time after which a later cost counts 1/e
    )
    learnt_weight: float = 0.04  # ours: probability that an obstacle reverses, while the robot gets
    # out of its path, where it passed before without reversing
    following_cost: float = 0.0  # ours: share of the cost of every step behind an obstacle that
    # may reverse; for slow obstacles. Among faster ones it hesitates (22 for 30 of 40 hard courses)
    risk: float = setting(
        0.05,
        "",
        "largest probability of contact with what may move, in the next 2.6 s, that a step may have if another has less",
        "ours",
    )
    keep_m: float = 0.04  # ours: another plan must be better than the present one by this ...
    keep_share: float = 0.15  # ours: ... and by this share of the present plan's cost

    def __post_init__(self) -> None:
        if not 1 <= self.steps <= MOST_STEPS:
            raise ConfigError(f"guard: steps={self.steps} must be at least 1, at most {MOST_STEPS}")
        if self.margin_m > MOST_MARGIN_M:
            raise ConfigError(
                f"guard: margin_m={self.margin_m} must be at most {MOST_MARGIN_M:g} m"
            )
        for name in ("react_s", "fade_s"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"guard: {name}={value} must be positive and finite")
        for name in ("margin_m", "sigmas", "following_cost"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ConfigError(f"guard: {name}={value} must be finite and not negative")
        if not 0.0 < self.risk <= 1.0:
            raise ConfigError(f"guard: risk={self.risk} must lie in (0, 1]")
        if not 0.0 <= self.keep_share < 1.0:
            raise ConfigError(f"guard: keep_share={self.keep_share} must lie in [0, 1)")
