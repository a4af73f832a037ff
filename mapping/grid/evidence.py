"""Evidence: how one observation changes the occupancy probability of a cell.

The update rule of the seed is lost; this log-odds filter is the one that its specification proposes. A cell
that was never seen has p = 1, as in the seed, stored as log-odds +inf: no time stamp doubles as a mark.

A moving obstacle violates the filter's assumption of a static cell: three observations would be needed until
it shows on floor known to be free, and five until its trail is gone. Cells of an obstacle known to move
therefore take one small fixed value at once. One floor observation clears it, and it fades while the cell is
out of view (ours).

Source: seed 003, section 3, "Update of p".
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Int32, UInt8

from perception.primitives.errors import ConfigError, InputError
from perception.primitives.settings import setting

from . import _evidence_kernels

FIRST_OBSTACLE = 0.85  # seed 003: p after the first obstacle observation
FIRST_FLOOR = 0.15  # seed 003: p after the first floor observation
OBSTACLE_POINTS = 3  # seed 003: fewer obstacle points in a cell are noise
MOVING_LOG_ODDS = 0.8  # ours: below -floor, so that one floor observation clears a moving obstacle
AGEING_S = 10.0  # seed 003: time constant of p towards 0.5
FADED = 0.05  # ours: an aged cell this close to p = 0.5 counts as never seen


@dataclass(frozen=True)
class EvidenceConfig:
    """Weight of one observation of a cell."""

    obstacle: float = setting(
        1.73, "log-odds", "added to a cell by each further obstacle observation", "seed 003"
    )
    floor: float = setting(
        -0.85, "log-odds", "added to a cell by each further floor observation", "seed 003"
    )
    limit: float = setting(
        3.9, "log-odds", "largest magnitude of a cell's log-odds; 3.9 is p = 0.98", "seed 003"
    )

    def __post_init__(self) -> None:
        if not self.floor < 0.0 < self.obstacle:
            raise ConfigError(
                f"evidence: floor={self.floor} must be negative and obstacle={self.obstacle} positive"
            )
        if not self.limit >= MOVING_LOG_ODDS:
            raise ConfigError(f"evidence: limit={self.limit} must be at least {MOVING_LOG_ODDS}")


OCCUPIED = 0.5
"""Probability from which a cell counts as occupied and is never walked over; seed 003."""


def corner_m(cell_m: float) -> float:
    """Ours: distance kept between a body and the middle of an occupied cell: half its diagonal, to the millimetre."""
    return round(cell_m * math.sqrt(0.5), 3)


def log_odds(probability: float) -> float:
    """ln(p / (1 - p)) for p in (0, 1)."""
    return math.log(probability / (1.0 - probability))


def probability_of(odds: Float32[np.ndarray, "*cells"]) -> Float32[np.ndarray, "*cells"]:
    """p of log-odds; 1 where they are +inf."""
    return np.asarray(np.float32(1) / (np.float32(1) + np.exp(-odds)))


def kinds_of(
    is_obstacle: Bool[np.ndarray, "n"], is_moving: Bool[np.ndarray, "n"] | None
) -> UInt8[np.ndarray, "n"]:
    """Kind of each point for the kernels: floor, static obstacle or moving obstacle.

    Raises:
        InputError: The two arrays differ in length.
    """
    kinds = is_obstacle.astype(np.uint8)
    if is_moving is None:
        return kinds
    if is_moving.shape != is_obstacle.shape:
        raise InputError(
            f"is_moving has shape {is_moving.shape}, is_obstacle {is_obstacle.shape}; give one flag a point"
        )
    return kinds + (is_obstacle & is_moving).astype(np.uint8)


def update_cells(
    counts: Int32[np.ndarray, "3 rows columns"],
    layers: tuple[Float32[np.ndarray, "a b"], Float[np.ndarray, "a b"], Bool[np.ndarray, "a b"]],
    corner: tuple[int, int],
    stamp_s: float,
    config: EvidenceConfig,
) -> None:
    """Update each cell of a window of the map at most once, by the points counted in it.

    `OBSTACLE_POINTS` or more obstacle points are an obstacle observation, even if floor is seen beside them.
    Otherwise any floor point is a floor observation.

    Args:
        counts: Points of each kind (floor, static, moving) in each cell of the window.
        layers: Log-odds (+inf: never seen), time of the last update in s, and whether the obstacle in the
            cell moves; all changed in place.
        corner: Map cell [row, column] of the window's cell [0, 0]; indices wrap round the map.
        stamp_s: Time of the frame, s.
        config: Weights.
    """
    weights = _evidence_kernels.Weights(
        OBSTACLE_POINTS,
        log_odds(FIRST_OBSTACLE),
        log_odds(FIRST_FLOOR),
        config.obstacle,
        config.floor,
        config.limit,
        MOVING_LOG_ODDS,
    )
    _evidence_kernels.fold_evidence(counts, *layers, corner, stamp_s, weights)


def mark_moving(
    odds: Float32[np.ndarray, "a b"],
    moving: Bool[np.ndarray, "a b"],
    where: Bool[np.ndarray, "a b"],
) -> None:
    """Reclassify the obstacles in some cells from static to moving. Changes both layers.

    Args:
        odds: Log-odds, +inf where never seen.
        moving: Whether the obstacle in the cell moves.
        where: Cells to reclassify; free and unseen ones keep their values.

    Source: ours.
    """
    occupied = where & (odds > 0.0) & np.isfinite(odds)
    odds[occupied] = np.minimum(odds[occupied], np.float32(MOVING_LOG_ODDS))
    moving[occupied] = True


def age(
    odds: Float32[np.ndarray, "a b"],
    moving: Bool[np.ndarray, "a b"],
    where: Bool[np.ndarray, "a b"],
    seconds: float,
) -> None:
    """Move p of moving obstacles towards 0.5; faded cells become unseen. Changes both layers.

    Args:
        odds: Log-odds, +inf where never seen.
        moving: Whether the obstacle in the cell moves.
        where: Cells out of view in the meantime.
        seconds: Time passed, s.

    Source: seed 003, section 3; forgetting faded cells is ours.
    """
    chosen = moving & where
    if not chosen.any():
        return
    surplus = (probability_of(odds[chosen]) - 0.5) * math.exp(-seconds / AGEING_S)
    p = np.clip(0.5 + surplus.astype(np.float64), 1e-6, 1 - 1e-6)
    faded = np.abs(p - 0.5) <= FADED
    odds[chosen] = np.where(faded, np.inf, np.log(p / (1 - p)))
    moving[chosen] = ~faded
