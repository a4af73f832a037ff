"""How the camera may have moved when it moved far: guesses for the alignment to start from.

People and robots turn about the vertical, on the spot or round what they look at. So the guesses are turns
about the floor's normal, each about the camera and about what lies ahead of it.

Source: ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from ..primitives.errors import ConfigError
from ..primitives.pose import Pose3
from .pyramid import Pyramid


@dataclass(frozen=True)
class HypothesesConfig:
    """Which turns are tried."""

    turns_deg: tuple[float, ...] = (8.0, 16.0, 26.0)  # ours: alignment itself finds +- 5 deg

    def __post_init__(self) -> None:
        if not all(0.0 < turn < 180.0 for turn in self.turns_deg):
            raise ConfigError(
                f"odometry: turns_deg={self.turns_deg} must each lie between 0 and 180"
            )


def large_steps(
    target: Pyramid, around: Pose3, config: HypothesesConfig | None = None
) -> list[Pose3]:
    """Guesses of T_target_source for a step that may be large.

    Args:
        target: What will be held still; its floor, if known, says what is up.
        around: The motion that is expected; the guesses turn it.
        config: Which turns.

    Returns:
        Turns to both sides about the camera, and about the middle of what it sees.
    """
    config = config or HypothesesConfig()
    up = _up(target)
    ahead = _middle(target)
    guesses = []
    for turn in config.turns_deg:
        for signed in (turn, -turn):
            R = Rotation.from_rotvec(math.radians(signed) * up).as_matrix()
            for pivot in (around.position, ahead):
                turned = Pose3.from_rotation(R, pivot - R @ pivot)
                guesses.append(turned @ around)
    return guesses


def _up(target: Pyramid) -> Float[np.ndarray, "3"]:
    """Unit vector, camera axes: the floor's normal, or against the image's columns."""
    return np.array([0.0, -1.0, 0.0]) if target.floor is None else target.floor.normal


def _middle(target: Pyramid) -> Float[np.ndarray, "3"]:
    """Median of the points that are not floor, camera axes, m; a metre ahead if there are none."""
    level = target.levels[-1]
    v, u = np.nonzero((level.counts > 0) & np.isfinite(level.z))
    if len(u) == 0:
        return np.array([0.0, 0.0, 1.0])
    z = level.z[v, u].astype(np.float64)
    x, y = level.slopes
    return np.array([np.median(x[u] * z), np.median(y[v] * z), np.median(z)])
