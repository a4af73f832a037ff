"""Level sets: segmentation of the panorama by forward distance.

The panorama is cut into levels of forward distance `r cos(phi) cos(theta)`, so that a face perpendicular to
the x axis lies in one level. Two neighbouring pixels belong to one part if they lie in the same level. All
levels are labelled in one pass.

Source: Kang 2013 (seed 004), eq. (13) and (14).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Int32, UInt8
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from perception.primitives.errors import ConfigError
from perception.primitives.settings import setting

from . import _kernels
from .sphere import Sphere


@dataclass(frozen=True)
class LevelConfig:
    """Range and number of the levels."""

    farthest_m: float = setting(
        2.5, "m", "forward distance up to which obstacles are segmented", "seed 004: d_max"
    )
    count: int = setting(50, "", "number of levels of forward distance", "seed 004: m; dd = 0.05 m")

    def __post_init__(self) -> None:
        if not self.farthest_m > 0.0 or not 1 <= self.count <= 255:
            raise ConfigError(
                f"level sets: farthest_m={self.farthest_m} must be positive and count={self.count} "
                "lie in 1 to 255"
            )


def forward_distance(
    range_m: Float32[np.ndarray, "h w"], sphere: Sphere
) -> Float32[np.ndarray, "h w"]:
    """`d = r cos(phi) cos(theta)`, m, NaN without range. Source: seed 004, eq. (15)."""
    theta = sphere.left_rad + np.arange(sphere.width) / sphere.px_per_rad
    phi = sphere.top_rad - np.arange(sphere.height) / sphere.px_per_rad
    return np.asarray(range_m * np.outer(np.cos(phi), np.cos(theta)).astype(np.float32))


def levels(
    forward_m: Float32[np.ndarray, "h w"], config: LevelConfig | None = None
) -> UInt8[np.ndarray, "h w"]:
    """Level of every pixel, `floor(d / dd) + 1`; 0 without range or beyond the farthest level.

    Source: seed 004, eq. (13), without the inner floor, which would leave three levels of a metre each.
    """
    config = config or LevelConfig()
    with np.errstate(invalid="ignore"):
        number = np.floor(forward_m * (config.count / config.farthest_m)) + 1.0
        known = (number >= 1.0) & (number <= config.count)
    return np.where(known, number, 0.0).astype(np.uint8)


@dataclass(frozen=True, eq=False)
class Parts:
    """Connected parts of a panorama within a level.

    Args:
        labels: Part of every pixel, from 1 in reading order of their first pixels; 0 for none.
        boxes: (left, top, right, bottom) of each part, px, all inclusive.
        areas: Number of pixels of each part.
        levels: Level of each part.
    """

    labels: Int32[np.ndarray, "h w"]
    boxes: Int32[np.ndarray, "n 4"]
    areas: Int32[np.ndarray, "n"]
    levels: Int32[np.ndarray, "n"]

    def __len__(self) -> int:
        return len(self.areas)


def label(slices: UInt8[np.ndarray, "h w"]) -> Parts:
    """8-connected parts within a level.

    Args:
        slices: Level of every pixel, see `levels`; 0 for none.

    Source: seed 004, eq. (14).
    """
    labels = np.empty(slices.shape, np.int32)
    parent = np.empty(slices.size + 2, np.int32)
    count = int(_kernels.label(slices, labels, parent))
    table = np.empty((count, 6), np.int32)
    _kernels.measure(slices, labels, table)
    return Parts(labels, table[:, :4], table[:, 4], table[:, 5])


def merge_parts(
    parts: Parts, forward_m: Float32[np.ndarray, "h w"], reach_px: int, step_m: float, least_px: int
) -> Int32[np.ndarray, "h w"]:
    """Obstacles: touching parts of the same or adjacent levels, merged.

    A face on the border of two levels, a face oblique to them, and a receding top each consist of several
    parts. Two parts merge if pixels of both lie within reach of each other, in the same or adjacent levels,
    and differ in distance by at most one level.

    Args:
        parts: See `label`.
        forward_m: Forward distance from which the levels were made.
        reach_px: Largest pixel distance, in rows and columns.
        step_m: Largest difference of distance.
        least_px: Obstacles of fewer pixels are dropped.

    Returns:
        Label of the obstacle at every pixel, from 1 in reading order; 0 for none.

    Source: seed 004, eq. (14); touching pixels replace overlapping boxes, which would merge neighbours.
    """
    labels = parts.labels
    slice_of = np.concatenate([[0], parts.levels]).astype(np.int32)[labels]
    pairs = [np.zeros((2, 0), np.int32)]
    height, width = labels.shape
    for down in range(reach_px + 1):
        for across in range(-reach_px if down else 1, reach_px + 1):
            here = slice(0, height - down), slice(max(0, -across), width - max(0, across))
            there = slice(down, height), slice(max(0, across), width + min(0, across))
            one, other = labels[here], labels[there]
            with np.errstate(invalid="ignore"):
                met = (one > 0) & (other > 0) & (one != other)
                met &= np.abs(slice_of[here] - slice_of[there]) <= 1
                met &= np.abs(forward_m[here] - forward_m[there]) <= step_m
            pairs.append(np.unique(np.stack([one[met], other[met]]), axis=1))
    i, j = np.concatenate(pairs, axis=1)
    count = len(parts) + 1
    graph = coo_array((np.ones(i.size, np.int8), (i, j)), shape=(count, count))
    _, obstacle = connected_components(graph, directed=False)
    areas = np.bincount(obstacle, weights=np.concatenate([[0], parts.areas]), minlength=count)
    kept = areas[obstacle] >= least_px
    kept[0] = False
    number = np.zeros(count, np.int32)
    _, first = np.unique(obstacle[kept], return_index=True)
    order = obstacle[kept][np.sort(first)]
    rank = np.zeros(count, np.int32)
    rank[order] = np.arange(1, order.size + 1)
    number[kept] = rank[obstacle[kept]]
    return number[labels]
