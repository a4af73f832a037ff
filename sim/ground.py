"""The ground of a scene with several levels: its height, and how a level sole stands on it.

Truth, for bodies and referees; no sensor and no estimate reads it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from perception.primitives.pose import Pose2

from .shapes import Shape, distance

ALONG, ACROSS = 41, 5  # ours: points of a sole
GIVES_M = 0.005  # ours: ground lower than this below a sole does not carry it


class Ground:
    """Levels of the ground below the soles of a robot.

    Args:
        pieces: What may be stood on; the floor at height 0 is below all of them.
        sole_m: Length and width of a sole.
    """

    def __init__(self, pieces: Sequence[Shape], sole_m: tuple[float, float]) -> None:
        self._pieces = tuple(pieces)
        x, y = np.linspace(-0.5, 0.5, ALONG), np.linspace(-0.5, 0.5, ACROSS)
        points = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
        self._sole = points * np.array(sole_m)

    def height(self, points: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n"]:
        """Height of the ground at places in the world, m."""
        flat = points.reshape(-1, 2)
        found = np.zeros(len(flat))
        for piece in self._pieces:
            on = distance(piece, flat) <= 0.0
            found[on] = np.maximum(found[on], piece.top_m)
        return found.reshape(points.shape[:-1])

    def under(self, sole: Pose2) -> float:
        """Height at which a level sole comes to rest: that of the highest ground below it, m."""
        return float(self._below(sole).max())

    def carried(self, sole: Pose2) -> tuple[float, bool]:
        """The share of a sole's length with ground below it, and whether its middle has."""
        heights = self._below(sole)
        held = heights >= heights.max() - GIVES_M
        return float(held.mean(axis=0).min()), bool(held[ALONG // 2].all())

    def struck(self, swing: Float[np.ndarray, "n 4"]) -> float:
        """By how much a swinging sole goes below the ground on its way, m; 0 if it does not.

        Args:
            swing: Its middle, x and y, heading, and height, tick by tick.
        """
        deepest = 0.0
        for x, y, yaw, z in swing:
            top = float(self._below(Pose2(float(x), float(y), float(yaw))).max())
            deepest = max(deepest, top - float(z))
        return deepest

    def _below(self, sole: Pose2) -> Float[np.ndarray, "k m"]:
        return self.height(self._sole @ sole.rotation.T + sole.vector[:2])
