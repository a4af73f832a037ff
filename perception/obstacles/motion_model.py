"""The protocol of a motion model: the filter of one tracked obstacle.

`track.Track` implements it. A motion model of a user's own needs these members and a constructor that takes the first
`Detection`, the Gaussian over the robot's (x, y, yaw), and `TrackConfig`.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from ..filtering.consistency import Innovation
from ..primitives.gaussian import Gaussian
from ..primitives.motion import Motion
from .track import Detection

MODELS = {"switching": "perception.obstacles.track:Track"}
"""Our motion models: name to class. "switching": modes that change into each other (stands, straight, curving, turned)."""

MEMBERS = ("state", "motion", "moving", "predict", "density", "update")


@runtime_checkable
class MotionModel(Protocol):
    """The filter of one obstacle."""

    radius_m: float
    height_m: float

    @property
    def state(self) -> Gaussian:
        """Over (x, y, vx, vy), m and m/s, world frame."""
        ...

    @property
    def motion(self) -> Motion | None:
        """Modes of motion, for predictions; None: it goes straight on with `state`, or stands."""
        ...

    @property
    def moving(self) -> float:
        """Probability that it moves, in [0, 1]."""
        ...

    def predict(self, dt: float, robot: Gaussian) -> None:
        """Predict dt seconds; the robot's pose (x, y, yaw) in the world is now this one."""
        ...

    def density(
        self, positions: Float[np.ndarray, "n 2"], covariances: Float[np.ndarray, "n 2 2"]
    ) -> Float[np.ndarray, "n"]:
        """Probability density of each detection (body frame, m) if it is of this obstacle, per square metre."""
        ...

    def update(self, seen: Detection) -> Innovation:
        """Update with a detection; returns its innovation, divided by the root of its covariance."""
        ...
