"""Settings and constants of the guard: horizon, distances and costs.

Costs are lengths: the detour that avoiding them is worth.

Source: ours, from a study in simulation.
"""

from __future__ import annotations

from dataclasses import dataclass

from perception.primitives.errors import ConfigError
from perception.primitives.settings import setting

CELL_CONTACT_M = 0.15
"""Ours: distance of the middle of a DARwIn-OP to that of a cell at contact; grows with breadth."""

MOST_STEPS = 100  # ours: every plan is held in memory
STILL_MARGIN_M = 0.02  # ours: gap kept to what stands and no cell shows ...
MOST_SIGMA_M = 0.05  # ours: ... and for a standard deviation of its relative position, at most this
SMALL_RADIUS_M = 0.20  # ours: larger static tracks are represented by occupied cells alone
SURE_S = 3.0  # ours: the covariance grows no longer than this; later the obstacle is observed again
ACCELERATION_MPS2 = 0.004  # ours: random acceleration of an obstacle without modes of motion
TURNS_EVERY_S = 15.0  # ours: mean time between turns of an obstacle without modes of motion
ESCAPE_M = 0.4
"""Ours: way on which a DARwIn-OP gets out of the path of an obstacle, grows with breadth; after the end of a plan the risk
counts for the time that it takes at top speed."""

RISK_S = 2.6  # ours: time for which the probability of contact is bounded; until then a new plan can take effect
HAPPENS_SHARE = 0.4
"""Of the contacts that a plan would bring, the share that happens although the robot decides anew at every step; from 64
walks in homes and halls by geometric detections with 28 contacts, development laws, seeds 100 to 109."""
SAME_RISK = 0.004  # ours: smaller differences of the probability of contact do not make a plan the least dangerous
EXPECTED_CONTACT_M = 10.0
"""Ours: detour that avoiding a contact is worth. With 20 walks take a tenth longer and touch no less."""
UNSEEN_PER_M2 = 2.0
"""Ours, not measured: contacts per area of unseen ground that the body newly covers, in furnished rooms."""

SIZE_SIGMA_M = 0.01  # ours: standard deviation of the distance of contact by the two sizes
STEEP = 40.0  # ours: cost per metre of missing distance
CONTACT_COST_M = 4.0  # ours: further cost of a contact
FADE_S = 8.0  # ours: time after which a cost of what stands counts 1/e; 4 reacts late, 16 hesitates
KEEP_M = 0.04  # ours: another plan must be better than the present one by this ...
KEEP_SHARE = 0.15  # ours: ... and by this share of the present plan's cost of what stands
HEADING_COST_M = 0.05  # ours: cost per rad of facing away from the target at the end
PASS_M = 0.10  # ours: a desired step with no more cost than this passes


@dataclass(frozen=True)
class GuardConfig:
    """Horizon of the plans, and bound on the risk."""

    steps: int = setting(12, "", "steps that each plan is rolled out for", "ours: 7.8 s suffice")
    risk: float = setting(
        0.02,
        "",
        "largest probability of contact with what may move, in the next 2.6 s, that a step may have if another has less",
        "ours",
    )

    def __post_init__(self) -> None:
        if not 1 <= self.steps <= MOST_STEPS:
            raise ConfigError(f"guard: steps={self.steps} must be at least 1, at most {MOST_STEPS}")
        if not 0.0 < self.risk <= 1.0:
            raise ConfigError(f"guard: risk={self.risk} must lie in (0, 1]")
