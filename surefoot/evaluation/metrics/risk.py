"""Claimed risk against what happened: contacts with movers within the horizon of each decision.

Source: ours; bands by Wilson's interval (Wilson 1927).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from planning.safety.guard_settings import RISK_S

from ...results.run_folder import RunFolder
from ...results.tables import Table
from .contact_classes import movers_by_name
from .contacts import nearest_objects

EDGES = (0.0, 0.01, 0.05, 0.2, 1.0)
"""Classes of claimed risk."""

CLASS_COUNT = len(EDGES) - 1
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


@dataclass(frozen=True)
class RiskTally:
    """Decisions by class of claimed risk, as sums, so that those of many walks add up.

    Args:
        decisions: How many of each class.
        horizons: The same in units of the horizon `RISK_S`: decisions within one horizon count as one.
        claimed: Sum of their claimed probabilities.
        happened: How many were followed by a contact with a mover within the horizon.
    """

    decisions: Float[np.ndarray, "c"]
    horizons: Float[np.ndarray, "c"]
    claimed: Float[np.ndarray, "c"]
    happened: Float[np.ndarray, "c"]

    def __add__(self, other: RiskTally) -> RiskTally:
        return RiskTally(*(a + b for a, b in zip(self.sums(), other.sums(), strict=True)))

    def sums(self) -> tuple[Float[np.ndarray, "c"], ...]:
        """decisions, horizons, claimed and happened."""
        return self.decisions, self.horizons, self.claimed, self.happened

    def classes(self) -> list[RiskClass]:
        """The classes of claimed risk that occur."""
        found = []
        for count, horizons, claimed, happened in zip(*self.sums(), strict=True):
            if count:
                share = float(happened / count)
                band = wilson(share, max(float(horizons), 1.0))
                found.append(RiskClass(int(count), float(claimed / count), share, *band))
        return found


def tally(
    claimed: Float[np.ndarray, "n"], happened: Bool[np.ndarray, "n"], step_s: float
) -> RiskTally:
    """Decisions by class of claimed risk.

    Args:
        claimed, happened: Of the decisions of a walk.
        step_s: Time between decisions.
    """
    of = np.clip(np.searchsorted(EDGES, claimed, side="right") - 1, 0, CLASS_COUNT - 1)
    decisions, claims, contacts = (
        np.bincount(of, weights, CLASS_COUNT) for weights in (None, claimed, happened)
    )
    decisions = decisions.astype(np.float64)
    return RiskTally(decisions, decisions * step_s / RISK_S, claims, contacts)


def risk_metrics(found: RiskTally) -> dict[str, float | bool]:
    """risk_claimed_mean, risk_happened_share (contacts with movers within 2.6 s), risk_in_band (in every class)."""
    count = found.decisions.sum()
    return {
        "risk_claimed_mean": float(found.claimed.sum() / count),
        "risk_happened_share": float(found.happened.sum() / count),
        "risk_in_band": all(one.in_band for one in found.classes()),
    }


def risk_of_run(run: RunFolder) -> RiskTally | None:
    """Claimed risks of a simulated walk and what happened; None without a guard, movers or ground truth."""
    commands, clearance = run.read_csv("commands.csv"), run.read_csv("truth/clearance.csv")
    obstacles = run.read_csv("truth/obstacles.csv")
    if commands is None or clearance is None or obstacles is None:
        return None
    if "risk" not in commands.columns or "name" not in obstacles.columns:
        return None
    movers = movers_by_name(obstacles)
    claimed, happened = followed_by_contact(commands, clearance, tuple(movers))
    if not movers or len(claimed) < 2:
        return None
    return tally(claimed, happened, float(np.median(np.diff(commands.numbers("stamp_s")))))


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


def wilson(share: float, count: float) -> tuple[float, float]:
    """95 % band of a probability of which a share of `count` trials was seen."""
    z = Z95 * Z95 / count
    middle = (share + z / 2.0) / (1.0 + z)
    half = Z95 / (1.0 + z) * math.sqrt(share * (1.0 - share) / count + z / (4.0 * count))
    return max(middle - half, 0.0), min(middle + half, 1.0)
