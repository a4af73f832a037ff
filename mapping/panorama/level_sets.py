"""Level sets: the panorama cut into slices of forward distance, and in each the parts that hang together.

All slices are labelled in one pass: two neighbours belong together if they lie in the same slice.

Source: seed 004, eq. (13) and (14); slices by forward distance `r cos(phi) cos(theta)`, so that a face
across the way lies in one of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Int32, UInt8

from perception.primitives.errors import ConfigError

from . import _kernels
from .sphere import Sphere


@dataclass(frozen=True)
class LevelConfig:
    """How finely forward distance is cut."""

    farthest_m: float = 2.5  # seed 004: d_max
    count: int = 50  # seed 004: m; dd = 0.05 m

    def __post_init__(self) -> None:
        if not self.farthest_m > 0.0 or not 1 <= self.count <= 255:
            raise ConfigError(
                f"level sets: farthest_m={self.farthest_m} must be positive and count={self.count} "
                "lie in 1 to 255"
            )


def forward_distance(
    range_m: Float32[np.ndarray, "h w"], sphere: Sphere
) -> Float32[np.ndarray, "h w"]:
    """`d = r cos(phi) cos(theta)`, m, NaN where there is no range. Source: seed 004, eq. (15)."""
    theta = sphere.left_rad + np.arange(sphere.width) / sphere.px_per_rad
    phi = sphere.top_rad - np.arange(sphere.height) / sphere.px_per_rad
    return np.asarray(range_m * np.outer(np.cos(phi), np.cos(theta)).astype(np.float32))


def levels(
    forward_m: Float32[np.ndarray, "h w"], config: LevelConfig | None = None
) -> UInt8[np.ndarray, "h w"]:
    """The slice of every pixel, `floor(d / dd) + 1`; 0 where there is none or it is too far.

    Source: seed 004, eq. (13), without the inner floor, which leaves three slices of a metre.
    """
    config = config or LevelConfig()
    with np.errstate(invalid="ignore"):
        number = np.floor(forward_m * (config.count / config.farthest_m)) + 1.0
        known = (number >= 1.0) & (number <= config.count)
    return np.where(known, number, 0.0).astype(np.uint8)


@dataclass(frozen=True, eq=False)
class Parts:
    """Parts of a panorama that hang together within a slice.

    Args:
        labels: Part of every pixel, from 1 in reading order of their first pixels; 0 for none.
        boxes: (left, top, right, bottom) of each part, px, the last ones inclusive.
        areas: Pixels of each part.
        levels: Slice of each part.
    """

    labels: Int32[np.ndarray, "h w"]
    boxes: Int32[np.ndarray, "n 4"]
    areas: Int32[np.ndarray, "n"]
    levels: Int32[np.ndarray, "n"]

    def __len__(self) -> int:
        return len(self.areas)


def label(slices: UInt8[np.ndarray, "h w"]) -> Parts:
    """Parts that hang together within a slice, 8-connected.

    Args:
        slices: As of `levels`; 0 belongs to nothing.

    Source: seed 004, eq. (14).
    """
    labels = np.empty(slices.shape, np.int32)
    parent = np.empty(slices.size + 2, np.int32)
    count = int(_kernels.label(slices, labels, parent))
    table = np.empty((count, 6), np.int32)
    _kernels.measure(slices, labels, table)
    return Parts(labels, table[:, :4], table[:, 4], table[:, 5])
