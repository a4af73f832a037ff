"""A tracked obstacle whose sigma-point update is filterpy's: the reference for the compiled one.

Everything else, from the prediction to the evidence of motion, is that of `track.Track`.

Source: Yoo and Kim 2010 (seed 001), section 3, eq. (2) (sigma-point filter); Labbe, filterpy.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float

from ..filtering.models import positive, spread
from ..primitives.gaussian import Gaussian
from ._track_kernels import SIZE
from .track import Detection, Track, TrackConfig


class FilterpyTrack(Track):
    """The filter of one obstacle, updated by filterpy."""

    def __init__(self, seen: Detection, robot: Gaussian, config: TrackConfig) -> None:
        """Start at the first detection with an unknown velocity."""
        super().__init__(seen, robot, config)
        self._filter = _filter()

    def __getstate__(self) -> dict[str, Any]:
        return {key: value for key, value in vars(self).items() if key != "_filter"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state, _filter=_filter())

    def _learn(
        self,
        x: Float[np.ndarray, "7"],
        P: Float[np.ndarray, "7 7"],
        position: Float[np.ndarray, "2"],
        noise: Float[np.ndarray, "2 2"],
    ) -> None:
        """Sigma-point update of one mode, in place, by a position in the body frame."""
        one = self._filter
        one.x, one.P = x.copy(), P.copy()
        one.sigmas_f = one.points_fn.sigma_points(one.x, one.P)
        one.update(position, R=positive(noise), robot=self._robot)
        x[:], P[:] = one.x, positive(one.P)


def _filter() -> Any:
    from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter  # slow to import

    points = MerweScaledSigmaPoints(SIZE, spread(SIZE), 2.0, 0.0)
    return UnscentedKalmanFilter(SIZE, 2, 0.0, in_body, None, points)


def in_body(state: Float[np.ndarray, "7"], robot: Float[np.ndarray, "3"]) -> Float[np.ndarray, "2"]:
    """Position of the obstacle in the body frame: the true viewpoint is the robot's pose and its error.

    Args:
        state: Of a track: x, y, vx, vy, error of the viewpoint in x, y, yaw.
        robot: Pose x, y, yaw.
    """
    x, y = state[0] - robot[0] - state[4], state[1] - robot[1] - state[5]
    yaw = robot[2] + state[6]
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([c * x + s * y, c * y - s * x])
