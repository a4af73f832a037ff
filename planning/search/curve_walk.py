"""Walking the curve of a path: straight lines and arcs that the gait can follow, one aim per footstep.

Every footstep searches a new path, which begins at the robot. In the middle of an arc that new path has a corner close by,
for which no arc fits any more. Therefore the curve that the robot has begun is kept while it is free and a new path
saves little.

Source: seed 003, section 3, "Shortcuts": arcs of radius at least step length / largest turn per step; keeping the
curve is ours, pursuit after Coulter 1992.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from perception.primitives.robot_model import GaitLimits

from .path import Path

AHEAD = 1.76  # ours: cruising steps; on the arcs of a DARwIn-OP this cuts 4 mm inside
OFF = 2.2  # ours: cruising steps; a robot farther from its curve, after an evasive step, takes the new one
SAVING = 0.05  # ours: share of the cost that a new path must save


class CurveWalk:
    """The curve to one goal that the robot follows."""

    def __init__(self, gait: GaitLimits) -> None:
        """Begin without a curve.

        Args:
            gait: That follows it.
        """
        step_m = gait.cruise_mps * gait.step_s
        self._ahead_m, self._off_m = AHEAD * step_m, OFF * step_m
        self._goal: np.ndarray | None = None
        self.curve: np.ndarray | None = None
        """(n, 2) world frame, m: the curve from the robot on; None before the first path."""

    def aim(self, path: Path, here: Float[np.ndarray, "2"]) -> Float[np.ndarray, "2"]:
        """Where to walk with the next footstep, world frame, m; call once per footstep.

        Args:
            path: The new path from the position of the robot.
            here: That position, m.
        """
        new = path.curve
        kept = None if self.curve is None else _rest(self.curve, here)
        same = self._goal is not None and np.array_equal(path.goal, self._goal)
        if kept is None or not same or not self._is_good(kept, new, path, here):
            kept = new
        self.curve, self._goal = kept, path.goal.copy()
        lengths = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(kept, axis=0).T))])
        if lengths[-1] <= self._ahead_m:
            return np.asarray(path.waypoints[-1])
        return np.array([np.interp(self._ahead_m, lengths, axis) for axis in kept.T])

    def _is_good(self, kept: np.ndarray, new: np.ndarray, path: Path, here: np.ndarray) -> bool:
        """Whether the robot is on the kept curve, it is free, and the new one costs hardly less."""
        if float(np.hypot(*(kept[0] - here))) > self._off_m:
            return False
        costs = path.ground.cost_m(kept), path.ground.cost_m(new)
        return bool(costs[0] < np.inf and (1.0 - SAVING) * costs[0] <= costs[1])


def _rest(curve: np.ndarray, here: np.ndarray) -> np.ndarray:
    """The curve from the point on that is nearest to a position."""
    begin, way = curve[:-1], np.diff(curve, axis=0)
    length = np.maximum(np.einsum("ij,ij->i", way, way), 1e-12)
    share = np.clip(np.einsum("ij,ij->i", here - begin, way) / length, 0.0, 1.0)
    feet = begin + share[:, None] * way
    k = int(np.argmin(np.hypot(*(feet - here).T)))
    return np.vstack([feet[k], curve[k + 1 :]])
