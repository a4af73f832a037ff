"""Claimed risk against what happened: contacts with movers within the horizon of each decision.

Source: ours; bands by Wilson's interval (Wilson 1927).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from planning.safety.guard_settings import RISK_S

from ...results.tables import Table
from .contacts import nearest_objects

EDGES = (0.0, 0.01, 0.05, 0.2, 1.0)
"""Classes of claimed risk."""

Z95 = 1.96


@dataclass(frozen=True)
class RiskClass:
    """Decisions of similar claimed risk.

    Args:
        decisions: How many.
        claimed: Mean claimed probability of contact.
        happened: Share after which a contact began within the horizon.
        low, high: 95 % band of `happened` as a probability; decisions within one horizon count as one.
    """

    decisions: int
    claimed: float
    happened: float
    low: float
    high: float

    @property
    def in_band(self) -> bool:
        """Whether the claim agrees with what happened."""
        return bool(self.low <= self.claimed <= self.high)


def followed_by_contact(
    commands: Table, clearance: Table, movers: Sequence[str]
) -> tuple[Float[np.ndarray, "n"], Bool[np.ndarray, "n"]]:
    """Claimed risk of every decision, and whether a contact with a mover began within `RISK_S` after it.

    Args:
        commands: commands.csv of a walk.
        clearance: clearance.csv of its ground truth.
        movers: Names of the moving objects.
    """
    stamps, risk = commands.numbers("stamp_s"), commands.numbers("risk")
    gaps, times = clearance.numbers("clearance_m"), clearance.numbers("stamp_s")
    named = np.isin(nearest_objects(clearance), list(movers))
    touching = (gaps <= 0.0) & named
    begun = times[touching & ~np.concatenate([[False], touching[:-1]])]
    after = begun[None, :] - stamps[:, None]
    happened: np.ndarray = ((after > 0.0) & (after <= RISK_S)).any(axis=1)
    known = np.isfinite(risk)
    return risk[known], happened[known]


def reliability(
    claimed: Float[np.ndarray, "n"], happened: Bool[np.ndarray, "n"], step_s: float
) -> list[RiskClass]:
    """The classes of claimed risk that occur.

    Args:
        claimed, happened: Of the decisions of any number of walks.
        step_s: Time between decisions.
    """
    found = []
    for low, high in itertools.pairwise(EDGES):
        inside = (claimed >= low) & ((claimed < high) | (high == EDGES[-1]))
        if inside.any():
            share = float(np.mean(happened[inside]))
            count = max(float(inside.sum()) * step_s / RISK_S, 1.0)
            band = wilson(share, count)
            found.append(RiskClass(int(inside.sum()), float(claimed[inside].mean()), share, *band))
    return found


def wilson(share: float, count: float) -> tuple[float, float]:
    """95 % band of a probability of which a share of `count` trials was seen."""
    z = Z95 * Z95 / count
    middle = (share + z / 2.0) / (1.0 + z)
    half = Z95 / (1.0 + z) * math.sqrt(share * (1.0 - share) / count + z / (4.0 * count))
    return max(middle - half, 0.0), min(middle + half, 1.0)
