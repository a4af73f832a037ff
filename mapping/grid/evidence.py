"""Evidence: how one sighting changes the probability that a cell is occupied.

The seed's update rule is lost; this is the log-odds filter that its specification proposes. A cell never
seen keeps the seed's p = 1, held as log-odds of +inf, so that no stamp has to double as a mark.

What moves breaks the filter's assumption that a cell stays as it is: a walker would need three sightings
to show on floor long known as free, and its trail five to vanish. The cells of what is known to move
therefore take one fixed small value at once, which one floor sighting turns, and fade while nobody looks
(ours).

Source: seed 003, section 3, "Update of p".
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Int32, UInt8

from perception.primitives.errors import ConfigError, InputError

from . import _evidence_kernels


def log_odds(probability: float) -> float:
    """ln(p / (1 - p)) for p in (0, 1)."""
    return math.log(probability / (1.0 - probability))


@dataclass(frozen=True)
class EvidenceConfig:
    """Weight of one sighting of a cell."""

    first_obstacle: float = 0.85  # seed 003: p after the first sighting of an obstacle
    first_floor: float = 0.15  # seed 003: p after the first sighting of floor
    obstacle: float = 1.73  # seed 003: log-odds added by a further obstacle sighting
    floor: float = -0.85  # seed 003: log-odds added by a further floor sighting
    limit: float = 3.9  # seed 003: log-odds stay within +- this; p within 0.02 and 0.98
    obstacle_points: int = 3  # seed 003: fewer obstacle points in a cell are stray
    tail_share: float = (
        0.0  # ours: fewer obstacle points than this share of a neighbour's say nothing
    )
    mover: float = (
        0.8  # ours: log-odds of a mover's cell; below -floor, so that one floor sighting frees it
    )
    ageing_s: float = 10.0  # seed 003: time constant of p towards 0.5
    faded: float = 0.05  # ours: an aged cell this close to p = 0.5 counts as never seen

    def __post_init__(self) -> None:
        if not 0.0 < self.first_floor < 0.5 < self.first_obstacle < 1.0:
            raise ConfigError(
                f"evidence: first_floor={self.first_floor} and first_obstacle={self.first_obstacle} must lie "
                "on either side of 0.5, inside (0, 1)"
            )
        if not self.floor < 0.0 < self.obstacle:
            raise ConfigError(
                f"evidence: floor={self.floor} must be negative and obstacle={self.obstacle} positive"
            )
        if not 0.0 < self.mover <= self.limit:
            raise ConfigError(
                f"evidence: mover={self.mover} must lie between 0 and limit={self.limit}"
            )
        if not 0.0 <= self.tail_share < 1.0:
            raise ConfigError(f"evidence: tail_share={self.tail_share} must lie in [0, 1)")
        if self.obstacle_points < 1:
            raise ConfigError(
                f"evidence: obstacle_points={self.obstacle_points} must be at least 1"
            )
        if not (self.ageing_s > 0.0 and 0.0 <= self.faded < 0.5):
            raise ConfigError(
                f"evidence: ageing_s={self.ageing_s} must be positive and faded={self.faded} in [0, 0.5)"
            )


def kinds_of(
    is_obstacle: Bool[np.ndarray, "n"], is_moving: Bool[np.ndarray, "n"] | None
) -> UInt8[np.ndarray, "n"]:
    """Each point's kind for the kernels: floor, obstacle at rest, obstacle that moves.

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
    """Change each cell of a window of the map once, by the points counted in it.

    At least `obstacle_points` obstacle points make an obstacle sighting, whatever floor is seen beside
    them; else any floor point makes a floor sighting. Near by, noise alone carries so many points over the edge
    of a cell: with a `tail_share` a cell with fewer obstacle points than that share of a neighbour's stays as it
    is.

    Args:
        counts: Points of each kind (floor, at rest, moving) in each cell of the window.
        layers: Log-odds (+inf: never seen), time of the last update in s, and whether what stands there
            moves; all changed in place.
        corner: Map cell [row, column] of the window's cell [0, 0]; indices wrap round the map.
        stamp_s: Time of the frame, s.
        config: Weights.
    """
    _evidence_kernels.fold_evidence(
        counts,
        *layers,
        *corner,
        stamp_s,
        config.obstacle_points,
        log_odds(config.first_obstacle),
        log_odds(config.first_floor),
        config.obstacle,
        config.floor,
        config.limit,
        config.mover,
        config.tail_share,
    )


def mark_moving(
    odds: Float32[np.ndarray, "a b"],
    moving: Bool[np.ndarray, "a b"],
    where: Bool[np.ndarray, "a b"],
    config: EvidenceConfig,
) -> None:
    """Take what stands in some cells for something that moves after all. Changes both layers.

    Args:
        odds: Log-odds, +inf where never seen.
        moving: Whether what stands there moves.
        where: Which cells; those free or never seen stay as they are.
        config: The value of a mover's cell.

    Source: ours.
    """
    occupied = where & (odds > 0.0) & np.isfinite(odds)
    odds[occupied] = np.minimum(odds[occupied], np.float32(config.mover))
    moving[occupied] = True


def age(
    odds: Float32[np.ndarray, "a b"],
    moving: Bool[np.ndarray, "a b"],
    where: Bool[np.ndarray, "a b"],
    seconds: float,
    config: EvidenceConfig,
) -> None:
    """Let p of moving things drift to 0.5; what has faded counts as never seen. Changes both layers.

    Args:
        odds: Log-odds, +inf where never seen.
        moving: Whether what stands there moves.
        where: Cells that nobody looked at meanwhile.
        seconds: Time passed, s.
        config: Time constant and the p at which a cell is forgotten.

    Source: seed 003, section 3; the forgetting is ours.
    """
    chosen = moving & where
    if not chosen.any():
        return
    surplus = (probability_of(odds[chosen]) - 0.5) * math.exp(-seconds / config.ageing_s)
    p = np.clip(0.5 + surplus.astype(np.float64), 1e-6, 1 - 1e-6)
    faded = np.abs(p - 0.5) <= config.faded
    odds[chosen] = np.where(faded, np.inf, np.log(p / (1 - p)))
    moving[chosen] = ~faded


def probability_of(odds: Float32[np.ndarray, "*cells"]) -> Float32[np.ndarray, "*cells"]:
    """p of log-odds; 1 where they are +inf."""
    return np.asarray(np.float32(1) / (np.float32(1) + np.exp(-odds)))
