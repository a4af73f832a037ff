"""The colours of the floor as a range of hue, saturation and value.

A pixel with hardly any chroma has no hue to speak of, so on a floor that has one it is asked for saturation and
value alone. Between two hues less than half a circle apart lies a wedge of the plane of colours, bounded by two half
planes through grey: that is how the test does without a division and without a branch for each colour of the rainbow.
A grey floor has no hue; what bounds it instead is how warm it is, (r - b) / (r + g + b), between two half planes
as well: a cream wall in its own shade is as unsaturated as grey tiles are, and yet warmer.

Source: seed 000, section 3.1 ("floor by colour"; mean +- k sigma); quantiles, wedge and warmth are ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import UInt8

from ..primitives.errors import ConfigError
from . import _monocular_kernels as kernels

_SCALE = 4096  # of the integer normals; 3 * 4096 * 255 fits 32 bit


@dataclass(frozen=True)
class RangeConfig:
    """How far colours may lie from those of the patch and still be floor."""

    share: float = (
        0.02  # ours: quantiles of the patch instead of mean +- k sigma; tails are not floor
    )
    hue_margin_deg: float = 16.0  # ours: jpeg and lamps of two colours
    saturation_margin: float = (
        22.0  # ours: of 255; a third of it for the warmth, which is a share of r + g + b
    )
    widen: float = 0.5  # ours: of the spread itself, added on both sides
    grain: float = 0.35  # ours: of the spread of the brightness: knots and joints of boards
    shade: float = 0.80  # ours: a soft shadow leaves this share of the light
    shine: float = 1.12  # ours: the same towards the lamp
    value_margin: float = 25.0  # ours: of 255, at least
    least_chroma: float = (
        28.0  # ours: of 255; below, sensor noise and white balance decide on the hue
    )

    def __post_init__(self) -> None:
        if not 0.0 <= self.share < 0.5:
            raise ConfigError(f"floor colours: share={self.share} must lie in [0, 0.5)")
        if not 0.0 < self.shade <= 1.0 <= self.shine:
            raise ConfigError(
                f"floor colours: shade={self.shade} must lie in (0, 1] and shine={self.shine} be 1 or more"
            )
        margins = ("hue_margin_deg", "saturation_margin", "widen", "grain", "shine", "value_margin")
        for name in (*margins, "least_chroma"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ConfigError(f"floor colours: {name}={value} must be finite and not negative")


@dataclass(frozen=True)
class ColourRange:
    """Hue in deg (0 red, 120 green), half its width (180: any), saturation and value in [0, 255].

    Where any hue will do, the warmth (r - b) / (r + g + b) bounds the colours.
    """

    hue_deg: float
    hue_half_deg: float
    saturation: tuple[float, float]
    value: tuple[float, float]
    least_chroma: float
    warmth: tuple[float, float] = (-1.0, 1.0)

    def __post_init__(self) -> None:
        for name in ("saturation", "value", "warmth"):
            low, high = getattr(self, name)
            if not low <= high:
                raise ConfigError(f"colour range: {name}={(low, high)} must be (low, high)")

    @property
    def any_hue(self) -> bool:
        """Whether the hue says nothing: from half a circle on."""
        return self.hue_half_deg >= 88.0

    def toward(self, other: ColourRange, share: float) -> ColourRange:
        """This range moved that share of the way to the other."""

        def mix(a: float, b: float) -> float:
            return a + share * (b - a)

        turn = (other.hue_deg - self.hue_deg + 180.0) % 360.0 - 180.0
        return ColourRange(
            (self.hue_deg + share * turn) % 360.0,
            mix(self.hue_half_deg, other.hue_half_deg),
            (
                mix(self.saturation[0], other.saturation[0]),
                mix(self.saturation[1], other.saturation[1]),
            ),
            (mix(self.value[0], other.value[0]), mix(self.value[1], other.value[1])),
            self.least_chroma,
            (mix(self.warmth[0], other.warmth[0]), mix(self.warmth[1], other.warmth[1])),
        )

    @property
    def in_any_light(self) -> ColourRange:
        """The same colours, however bright."""
        return replace(self, value=(0.0, 255.0))


@dataclass(frozen=True)
class Spread:
    """How the colours of a floor are spread, lowest to highest but for a few: what margins are added to.

    Args:
        hue_deg: Their middle.
        hue_half_deg: Half the spread of hues; None if there are hardly any.
        saturation, value: In [0, 255].
        warmth: See `ColourRange`.
        least_chroma: Below it a pixel has no hue, of 255.
    """

    hue_deg: float
    hue_half_deg: float | None
    saturation: tuple[float, float]
    value: tuple[float, float]
    warmth: tuple[float, float]
    least_chroma: float

    def with_margins(self, config: RangeConfig) -> ColourRange:
        """The range that a floor of these colours has, in its own light and a little shade."""
        hue_half = 180.0
        if self.hue_half_deg is not None:
            half = self.hue_half_deg
            hue_half = half + max(2 * half * config.widen, config.hue_margin_deg)
        saturation = _widened(self.saturation, config.widen, config.saturation_margin)
        warmth = _widened(self.warmth, config.widen, config.saturation_margin / (3 * 255.0))
        low, high = self.value
        spread = config.grain * (high - low)
        value = (
            float(min(low - config.value_margin, low * config.shade, low - spread)),
            float(max(high + config.value_margin, high * config.shine, high + spread)),
        )
        half = float(min(hue_half, 180.0))
        return ColourRange(self.hue_deg, half, saturation, value, self.least_chroma, warmth)


def spread_of(colours: UInt8[np.ndarray, "n 3"], config: RangeConfig) -> Spread:
    """How colours are spread.

    Args:
        colours: (n, 3), red first; n at least 1.
        config: Quantiles, and from where on a pixel has a hue.
    """
    ends = [config.share, 1 - config.share]
    hsv = cv2.cvtColor(colours[None], cv2.COLOR_RGB2HSV_FULL)[0].astype(np.float64)
    angle = hsv[:, 0] * (2 * math.pi / 256)
    chroma = hsv[:, 1] * hsv[:, 2] / 255
    middle = math.atan2(float(chroma @ np.sin(angle)), float(chroma @ np.cos(angle)))
    half = None
    vivid = chroma >= config.least_chroma
    if np.mean(vivid) > 0.01:
        off = np.degrees((angle[vivid] - middle + math.pi) % (2 * math.pi) - math.pi)
        low, high = np.quantile(off, ends)
        middle += math.radians((low + high) / 2)
        half = float(high - low) / 2
    rgb = colours.astype(np.float64)
    warmth = (rgb[:, 0] - rgb[:, 2]) / np.maximum(rgb.sum(axis=1), 1.0)
    saturation, value, warm = (
        tuple(np.quantile(part, ends).tolist()) for part in (hsv[:, 1], hsv[:, 2], warmth)
    )
    return Spread(math.degrees(middle) % 360.0, half, saturation, value, warm, config.least_chroma)


def _widened(ends: tuple[float, float], widen: float, least: float) -> tuple[float, float]:
    low, high = ends
    margin = max((high - low) * widen, least)
    return low - margin, high + margin


def range_of(colours: UInt8[np.ndarray, "n 3"], config: RangeConfig) -> ColourRange:
    """The range that a floor of these colours, (n, 3), has in its own light and a little shade."""
    return spread_of(colours, config).with_margins(config)


CORE = RangeConfig(
    hue_margin_deg=2.0, saturation_margin=2.0, widen=0.0, grain=0.0, shade=1.0, shine=1.0,
    value_margin=2.0,
)  # fmt: skip
"""Margins of a range of the colours themselves, without those for other light."""


def mark(
    rgb: UInt8[np.ndarray, "h w 3"], colours: ColourRange, mask: UInt8[np.ndarray, "h w"]
) -> None:
    """Set the mask to 255 where the picture lies in the range; elsewhere it stays as it is."""
    limits = np.array(
        [
            math.ceil(colours.value[0]),
            math.floor(colours.value[1]),
            math.ceil(colours.saturation[0]),
            math.floor(colours.saturation[1]),
            0 if colours.any_hue else math.ceil(colours.least_chroma),
        ],
        np.int32,
    )
    if colours.any_hue:
        low, high = (
            _warmer_than(colours.warmth[0], 1.0),
            _warmer_than(colours.warmth[1], -1.0),
        )
    else:
        low = _half_plane(colours.hue_deg - colours.hue_half_deg, 1.0)
        high = _half_plane(colours.hue_deg + colours.hue_half_deg, -1.0)
    red, green, blue = cv2.split(rgb)
    kernels.mark_range(red, green, blue, limits, low, high, mask)


def _warmer_than(warmth: float, side: float) -> np.ndarray:
    """Normal (r, g, b) of the half plane of colours that are warmer (+1), or colder (-1)."""
    normal = np.array([1.0, 0.0, -1.0]) - warmth
    return np.rint(side * _SCALE * normal).astype(np.int32)


def _half_plane(hue_deg: float, side: float) -> np.ndarray:
    """Normal (r, g, b) of the half plane that begins at a hue and goes up (+1) or down (-1) from it.

    In the plane of colours x = r - (g + b) / 2, y = (g - b) sqrt(3) / 2 the hue of HSV is no angle, but it
    grows with the angle, and both agree on which colours lie beyond a given one.
    """
    part, rest = divmod((hue_deg % 360.0) / 60.0, 1.0)
    r, g, b = (
        (1.0, rest, 0.0),
        (1.0 - rest, 1.0, 0.0),
        (0.0, 1.0, rest),
        (0.0, 1.0 - rest, 1.0),
        (rest, 0.0, 1.0),
        (1.0, 0.0, 1.0 - rest),
    )[int(part)]
    x, y = r - (g + b) / 2, (g - b) * math.sqrt(3) / 2
    # cross((x, y), pixel) = x * y_p - y * x_p, written out in r, g, b
    normal = np.array([-y, x * math.sqrt(3) / 2 + y / 2, -x * math.sqrt(3) / 2 + y / 2])
    whole = np.rint(side * _SCALE * normal)
    whole[2] = -(whole[0] + whole[1])  # grey lies on every such plane
    return whole.astype(np.int32)
