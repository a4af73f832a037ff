"""Where an obstacle will be during a rollout of the guard.

An obstacle stands or goes, with the probabilities that its modes of motion give. One that goes follows its motion
pattern, if it has one. What stands is kept clear by the occupied cells that show it; where none does, a small thing counts as one more cell.

Source: ours.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from perception.obstacles.forecast import AS_OBSERVED, forecast
from perception.primitives.obstacle import MOVING, Obstacle

from .guard_settings import ACCELERATION_MPS2, SMALL_RADIUS_M, SURE_S, TURNS_EVERY_S
from .prediction import MotionPatterns


@dataclass(frozen=True, eq=False)
class Ahead:
    """Where an obstacle will be at n times: m modes, those that keep their velocity on its motion pattern.

    Without modes of motion: it stands, goes on, or has reversed at any time since it was seen.

    Args:
        weights: (n, m) probabilities; rows sum to 1.
        means: (n, m, 2) world frame, m.
        covariances: (n, m, 2, 2).
    """

    weights: Float[np.ndarray, "n m"]
    means: Float[np.ndarray, "n m 2"]
    covariances: Float[np.ndarray, "n m 2 2"]

    @classmethod
    def of(
        cls,
        obstacle: Obstacle,
        stamp_s: float,
        times_s: Float[np.ndarray, "n"],
        patterns: MotionPatterns,
    ) -> Ahead:
        """Of a track at the present time.

        Args:
            obstacle: The track.
            stamp_s: Present time.
            times_s: From the present on, ascending.
            patterns: Learnt from the tracks.
        """
        going = obstacle.gone_straight()
        places = patterns.forecast(going, stamp_s, times_s).places
        if obstacle.motion is not None:
            modes = forecast(obstacle, times_s)
            shifts = places - (going.position + times_s[:, None] * going.velocity)
            modes.means[:, AS_OBSERVED, :2] += shifts[:, None]
            means, P = modes.means[..., :2], modes.covariances[..., :2, :2]
            return cls(modes.probabilities, means.copy(), P.copy())
        moves, t, n = obstacle.moving, times_s[:, None, None], len(times_s)
        place, still = obstacle.position, obstacle.state.covariance[:2, :2]
        since_s = times_s + max(stamp_s - obstacle.seen_s, 0.0)
        seen_at = going.position - (since_s[0] - times_s[0]) * going.velocity
        turned = moves * -np.expm1(-since_s / TURNS_EVERY_S)
        weights = np.stack([np.full(n, 1.0 - moves), moves - turned, turned], axis=1)
        means = np.stack([np.tile(place, (n, 1)), places, np.tile(seen_at, (n, 1))], axis=1)
        grown = np.minimum(t, SURE_S)
        P = going.state.covariance
        start, cross, speed = P[:2, :2], P[:2, 2:], P[2:, 2:]
        kept = start + grown * (cross + cross.T) + grown**2 * speed
        kept = kept + (0.5 * ACCELERATION_MPS2 * grown**2) ** 2 * np.eye(2)
        # reversed at some time since: any place between as far ahead as gone and as far back is equally likely
        spread = since_s[:, None, None] ** 2 / 3.0 * np.outer(going.velocity, going.velocity)
        covariances = [np.broadcast_to(still, kept.shape), kept, start + spread]
        return cls(weights, means, np.stack(covariances, axis=1))


def may_move(obstacle: Obstacle) -> bool:
    """Whether a track counts as more than the occupied cells that it covers: it moves, or is small."""
    return obstacle.moving >= MOVING or obstacle.radius_m <= SMALL_RADIUS_M


def stands_unseen(obstacle: Obstacle, occupied: Float[np.ndarray, "n 2"]) -> bool:
    """Whether a small track more likely stands, and no occupied cell shows where."""
    if obstacle.moving >= MOVING or obstacle.radius_m > SMALL_RADIUS_M:
        return False
    gaps = np.linalg.norm(occupied - obstacle.position, axis=1)
    return not np.any(gaps <= obstacle.radius_m)
