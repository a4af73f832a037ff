"""The colour model of the floor: learnt from the floor ahead of the feet, and adapted to the light.

The lowest part of the picture is divided into tiles. A region grows from a tile in the bottom row to neighbours of
nearly the same colour, so that it follows a gradient of light and stops at the edge of an obstacle. Tiles whose
colours lie outside the model at any brightness are excluded, so that a wall that fades into the floor is not learnt.
Each picture moves the model a little towards the colours of this region. If no bottom tile matches the model, the
model is kept until the robot has walked onto the unknown floor, and is then learnt anew.

Source: seed 000, section 3.1 (the patch in front of the feet); region growing, memory and gating are ours.
"""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Float64, UInt8

from ..primitives.pose import Pose3
from .back_projection import viewing_direction
from .colour_range import CORE, TOLERANT, ColourRange, colour_spread, mark

PATCH_SHARE = 0.30  # ours: lowest rows; 0.16 to 0.35 m ahead of the camera of seed 000
TILES_ACROSS = 30  # ours: 2 cm of floor each
VALUE_STEP = 0.15  # ours: difference in log brightness between adjacent tiles of one floor
CHROMA_STEP = 0.06  # ours: the same of r, g, b, each divided by the largest of them
RATE = 0.2  # ours: share of the difference learnt per cycle
KNOWN_SHARE = 0.8  # ours: pixels of a tile that must match the model; half would be an edge
WALKED_M = 0.30  # ours: after this distance towards an unknown floor the robot stands on it
MIN_VALUE = 16.0  # ours: of 255; a darker patch is a covered lens or an unlit room


def grow_region(
    tiles: Float32[np.ndarray, "rows columns 3"],
    seed_column: int,
    allowed: Bool[np.ndarray, "rows columns"] | None = None,
) -> Bool[np.ndarray, "rows columns"]:
    """Region of similar colour grown from a tile of the lowest row.

    Args:
        tiles: Mean colour of each tile.
        seed_column: Column of the first tile.
        allowed: Tiles that the region may contain; None for all.
    """
    value = tiles.max(axis=2) + 1.0
    chroma, bright = tiles / value[..., None], np.log(value)
    across = (np.abs(np.diff(bright, axis=1)) < VALUE_STEP) & (
        np.abs(np.diff(chroma, axis=1)).max(axis=2) < CHROMA_STEP
    )
    down = (np.abs(np.diff(bright, axis=0)) < VALUE_STEP) & (
        np.abs(np.diff(chroma, axis=0)).max(axis=2) < CHROMA_STEP
    )
    if allowed is not None:
        across &= allowed[:, 1:] & allowed[:, :-1]
        down &= allowed[1:] & allowed[:-1]
    region = np.zeros(tiles.shape[:2], bool)
    region[-1, seed_column] = True
    count = 0
    while np.count_nonzero(region) != count:
        count = int(np.count_nonzero(region))
        region[:, 1:] |= region[:, :-1] & across
        region[:, :-1] |= region[:, 1:] & across
        region[1:] |= region[:-1] & down
        region[:-1] |= region[1:] & down
    return region


class FloorColourModel:
    """The colours of the floor: `range` with tolerance for other light, `core` almost without."""

    def __init__(self) -> None:
        self.range: ColourRange | None = None
        self.core: ColourRange | None = None
        self._unknown_since: Pose3 | None = None

    def learn(
        self, rgb: UInt8[np.ndarray, "h w 3"], T_world_camera: Pose3 | None = None
    ) -> ColourRange | None:
        """Update the model with the current picture; call once per picture.

        Args:
            rgb: Picture whose lowest part shows the floor ahead of the feet.
            T_world_camera: Its camera pose; None if unknown, then an unknown floor is never learnt.

        Returns:
            `range`; None until a picture shows a floor that is bright enough.
        """
        patch, side = _patch(rgb)
        tiles = _means(patch, side)
        known = self._seed_column(patch, tiles, side)
        seed_column = _most_typical(tiles) if known is None else known
        if tiles[-1, seed_column].max() < MIN_VALUE:
            return self.range
        if known is None:
            if T_world_camera is None:
                return self.range
            since = self._unknown_since = self._unknown_since or T_world_camera
            walked = (T_world_camera.position - since.position)[:2]
            if walked @ viewing_direction(T_world_camera) < WALKED_M:
                return self.range
            self.range = None  # the robot stands on the unknown floor
        self._unknown_since = None
        allowed = None
        if self.range is not None:
            allowed = _matching_share(patch, side, self.range.at_any_brightness) >= KNOWN_SHARE
        region = grow_region(tiles, seed_column, allowed)
        step = max(1, side // 5)
        owner = cv2.resize(
            region.astype(np.uint8),
            (patch.shape[1], patch.shape[0]),
            interpolation=cv2.INTER_NEAREST,
        )
        spread = colour_spread(patch[::step, ::step][owner[::step, ::step] > 0])
        seen, core = spread.with_margins(TOLERANT), spread.with_margins(CORE)
        if self.range is None or self.core is None:
            self.range, self.core = seen, core
        else:
            self.range = self.range.blended(seen, RATE)
            self.core = self.core.blended(core, RATE)
        return self.range

    def _seed_column(self, patch: np.ndarray, tiles: np.ndarray, side: int) -> int | None:
        """Column of the bottom tile from which to grow; None if no bottom tile matches the model."""
        if self.range is None:
            return _most_typical(tiles)
        share = _matching_share(patch[-side:], side, self.range)[0]
        middle = len(share) // 2
        order = np.argsort(np.abs(np.arange(len(share)) - middle), kind="stable")
        good = order[share[order] >= KNOWN_SHARE]
        return int(good[0]) if len(good) else None


def _patch(rgb: np.ndarray) -> tuple[np.ndarray, int]:
    """The lowest part of a picture, cut to whole tiles, and the side of a tile, px."""
    height, width = rgb.shape[:2]
    side = min(max(2, width // TILES_ACROSS), height)
    rows = max(1, int(height * PATCH_SHARE) // side) * side
    left = (width % side) // 2
    return rgb[height - rows :, left : left + width // side * side], side


def _matching_share(
    patch: np.ndarray, side: int, colours: ColourRange
) -> Float64[np.ndarray, "rows columns"]:
    """Share of each tile's pixels that lie in the range."""
    marked = np.zeros(patch.shape[:2], np.uint8)
    mark(np.ascontiguousarray(patch), colours, marked)
    tiles = marked.reshape(len(marked) // side, side, -1, side)
    return np.asarray(tiles.mean(axis=(1, 3)) / 255)


def _means(patch: np.ndarray, side: int) -> Float32[np.ndarray, "rows columns 3"]:
    """Mean colour of each tile."""
    size = (patch.shape[1] // side, patch.shape[0] // side)
    return np.asarray(cv2.resize(patch, size, interpolation=cv2.INTER_AREA), dtype=np.float32)


def _most_typical(tiles: np.ndarray) -> int:
    """Column of the tile nearest to the median colour, in the middle half of the lowest row."""
    columns = tiles.shape[1]
    first, last = columns // 4, columns - columns // 4
    row = tiles[-1, first:last]
    return first + int(np.argmin(np.abs(row - np.median(row, axis=0)).sum(axis=1)))
