"""Landmarks: places that the robot knows beforehand and can recognise, and sightings of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class Landmark:
    """A fiducial tag on a wall or a piece of furniture.

    Args:
        identity: Number printed on the tag (OpenCV dictionary DICT_4X4_50).
        position: Of the tag's centre, world frame, m.
        side_m: Side of the black square.
    """

    identity: int
    position: tuple[float, float, float]
    side_m: float


@dataclass(frozen=True)
class Sighting:
    """One landmark seen once, in the body frame.

    Args:
        identity: Which landmark; None if it could not be told.
        measured: (range on the floor in m, bearing in rad, left positive).
        covariance: (2, 2) of the two.
    """

    identity: int | None
    measured: Float[np.ndarray, "2"]
    covariance: Float[np.ndarray, "2 2"]
