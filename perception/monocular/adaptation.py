"""How the floor's colours are learnt from the patch ahead of the feet, and follow the light.

The lowest part of the picture is cut into tiles. From one at the bottom the patch grows to neighbours of
nearly the same colour: over a gradient of light it goes on, at the foot of an obstacle it stops, so that an
obstacle in the patch teaches nothing. Nor does a wall whose foot fades into the floor: a tile that has not the
floor's colours, in whatever light, is not grown to. What the patch says moves the remembered range a little; where
nothing in the patch is known floor, the memory stays, and only what the robot then walks over is learnt anew: who
walks along a wall has not walked over it.

Source: seed 000, section 3.1 (a patch in front of the feet); growth, memory and gate are ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Float64, UInt8

from ..primitives.errors import ConfigError
from ..primitives.pose import Pose3
from .back_projection import ahead_of
from .colour_range import CORE, ColourRange, RangeConfig, mark, spread_of


@dataclass(frozen=True)
class AdaptationConfig:
    """The patch, and how fast the memory follows it."""

    patch_share: float = 0.30  # ours: lowest rows; 0.16 to 0.35 m ahead of the seed's camera
    tiles_across: int = 30  # ours: 2 cm of floor each
    value_step: float = 0.15  # ours: neighbours of one floor differ less in brightness, as a share
    chroma_step: float = 0.06  # ours: the same of r, g, b over the brightest of them
    rate: float = (
        0.2  # ours: share of the way to the patch per cycle; half a minute of light in 5 cycles
    )
    known_share: float = 0.8  # ours: of a tile that must be known floor; half would be an edge
    walked_m: float = 0.30  # ours: so far on towards an unknown patch, and the robot stands on it
    least_value: float = (
        16.0  # ours: of 255; a darker patch is a covered lens or no light, not a floor
    )
    ranges: RangeConfig = field(default_factory=RangeConfig)

    def __post_init__(self) -> None:
        if not 0.0 < self.patch_share <= 1.0:
            raise ConfigError(f"adaptation: patch_share={self.patch_share} must lie in (0, 1]")
        if not 0.0 <= self.rate <= 1.0:
            raise ConfigError(f"adaptation: rate={self.rate} must lie in [0, 1]")
        if self.tiles_across < 4:
            raise ConfigError(f"adaptation: tiles_across={self.tiles_across} must be at least 4")
        if not 0.0 <= self.known_share <= 1.0:
            raise ConfigError(f"adaptation: known_share={self.known_share} must lie in [0, 1]")
        if not 0.0 <= self.least_value < 255.0:
            raise ConfigError(f"adaptation: least_value={self.least_value} must lie in [0, 255)")
        for name in ("value_step", "chroma_step", "walked_m"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ConfigError(f"adaptation: {name}={value} must be finite and not negative")


def grown(
    tiles: Float32[np.ndarray, "rows columns 3"],
    begin: int,
    value_step: float,
    chroma_step: float,
    allowed: Bool[np.ndarray, "rows columns"] | None = None,
) -> Bool[np.ndarray, "rows columns"]:
    """The tiles that are reached from the one in the lowest row at column `begin` by small steps of colour.

    Over those that are allowed, if that is given.
    """
    value = tiles.max(axis=2) + 1.0
    chroma, bright = tiles / value[..., None], np.log(value)
    across = (np.abs(np.diff(bright, axis=1)) < value_step) & (
        np.abs(np.diff(chroma, axis=1)).max(axis=2) < chroma_step
    )
    down = (np.abs(np.diff(bright, axis=0)) < value_step) & (
        np.abs(np.diff(chroma, axis=0)).max(axis=2) < chroma_step
    )
    if allowed is not None:
        across &= allowed[:, 1:] & allowed[:, :-1]
        down &= allowed[1:] & allowed[:-1]
    joined = np.zeros(tiles.shape[:2], bool)
    joined[-1, begin] = True
    count = 0
    while np.count_nonzero(joined) != count:
        count = int(np.count_nonzero(joined))
        joined[:, 1:] |= joined[:, :-1] & across
        joined[:, :-1] |= joined[:, 1:] & across
        joined[1:] |= joined[:-1] & down
        joined[:-1] |= joined[1:] & down
    return joined


class FloorColours:
    """The remembered range, and its core without margins; `learn` once per current picture."""

    def __init__(self, config: AdaptationConfig) -> None:
        self.config = config
        self.range: ColourRange | None = None
        self.core: ColourRange | None = None
        self._unknown_since: Pose3 | None = None

    def learn(
        self, rgb: UInt8[np.ndarray, "h w 3"], T_world_camera: Pose3 | None = None
    ) -> ColourRange | None:
        """The range after this picture; None if no picture yet showed a floor bright enough to have a colour.

        Args:
            rgb: Picture whose lowest part shows the floor ahead of the feet, if anything does.
            T_world_camera: None if nobody knows how far it went.
        """
        config = self.config
        patch, side = _patch(rgb, config)
        tiles = _means(patch, side)
        known = self._begin(patch, tiles, side)
        begin = _commonest(tiles) if known is None else known
        if tiles[-1, begin].max() < config.least_value:
            return self.range
        if known is None:
            if T_world_camera is None:
                return self.range
            since = self._unknown_since = self._unknown_since or T_world_camera
            walked = (T_world_camera.position - since.position)[:2]
            if walked @ ahead_of(T_world_camera) < config.walked_m:
                return self.range
            self.range = None  # it walks on what it does not know
        self._unknown_since = None
        allowed = None
        if self.range is not None:
            allowed = _share(patch, side, self.range.in_any_light) >= config.known_share
        joined = grown(tiles, begin, config.value_step, config.chroma_step, allowed)
        step = max(1, side // 5)
        owner = cv2.resize(
            joined.astype(np.uint8),
            (patch.shape[1], patch.shape[0]),
            interpolation=cv2.INTER_NEAREST,
        )
        colours = patch[::step, ::step][owner[::step, ::step] > 0]
        spread = spread_of(colours, config.ranges)
        seen, core = spread.with_margins(config.ranges), spread.with_margins(CORE)
        if self.range is None or self.core is None:
            self.range, self.core = seen, core
        else:
            self.range = self.range.toward(seen, config.rate)
            self.core = self.core.toward(core, config.rate)
        return self.range

    def _begin(self, patch: np.ndarray, tiles: np.ndarray, side: int) -> int | None:
        """Column of the lowest tile to grow from; None if no tile there is known floor."""
        if self.range is None:
            return _commonest(tiles)
        share = _share(patch[-side:], side, self.range)[0]
        middle = len(share) // 2
        order = np.argsort(np.abs(np.arange(len(share)) - middle), kind="stable")
        good = order[share[order] >= self.config.known_share]
        return int(good[0]) if len(good) else None


def _patch(rgb: np.ndarray, config: AdaptationConfig) -> tuple[np.ndarray, int]:
    height, width = rgb.shape[:2]
    side = min(max(2, width // config.tiles_across), height)
    rows = max(1, int(height * config.patch_share) // side) * side
    left = (width % side) // 2
    return rgb[height - rows :, left : left + width // side * side], side


def _share(
    patch: np.ndarray, side: int, colours: ColourRange
) -> Float64[np.ndarray, "rows columns"]:
    """Of each tile's pixels, how many lie in the range."""
    marked = np.zeros(patch.shape[:2], np.uint8)
    mark(np.ascontiguousarray(patch), colours, marked)
    tiles = marked.reshape(len(marked) // side, side, -1, side)
    return np.asarray(tiles.mean(axis=(1, 3)) / 255)


def _means(patch: np.ndarray, side: int) -> Float32[np.ndarray, "rows columns 3"]:
    size = (patch.shape[1] // side, patch.shape[0] // side)
    return np.asarray(cv2.resize(patch, size, interpolation=cv2.INTER_AREA), dtype=np.float32)


def _commonest(tiles: np.ndarray) -> int:
    """Of the middle half of the lowest row, the tile nearest to its median colour."""
    columns = tiles.shape[1]
    first, last = columns // 4, columns - columns // 4
    row = tiles[-1, first:last]
    return first + int(np.argmin(np.abs(row - np.median(row, axis=0)).sum(axis=1)))
