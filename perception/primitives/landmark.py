"""Landmarks at known positions, and their detections."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class Landmark:
    """A fiducial tag on a wall or a piece of furniture.

    Args:
        identity: Number printed on the tag (OpenCV dictionary DICT_4X4_250).
        position: Centre of the tag, world frame, m.
        side_m: Side of the black square.
    """

    identity: int
    position: tuple[float, float, float]
    side_m: float


@dataclass(frozen=True)
class Sighting:
    """One detection of a landmark, body frame.

    Args:
        identity: Number of the landmark; None if unknown.
        measured: (range on the floor in m, bearing in rad, left positive).
        covariance: (2, 2) of range and bearing.
    """

    identity: int | None
    measured: Float[np.ndarray, "2"]
    covariance: Float[np.ndarray, "2 2"]
