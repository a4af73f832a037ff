"""The colours of the floor as a range of hue, saturation and value.

A pixel of low chroma has no meaningful hue, so on a coloured floor only its saturation and value are tested. The
hues of a range less than 180 deg wide form a wedge in the chromaticity plane, bounded by two half planes through
grey; the test of a pixel therefore needs neither a division nor a branch. A grey floor has no hue; its colours are
bounded by their warmth (r - b) / (r + g + b) instead, again with two half planes. This separates grey tiles from a
cream wall in shadow, which has the same saturation but is warmer.

Source: seed 000, section 3.1 (floor by colour, mean +- k sigma); quantiles, wedge and warmth are ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import UInt8

from ..primitives.errors import ConfigError
from . import _monocular_kernels as kernels

TAIL = 0.02  # ours: quantile at both ends, instead of mean +- k sigma; tails are not floor
MIN_CHROMA = 28.0  # ours: of 255; below, sensor noise and white balance determine the hue
_SCALE = 4096  # of the integer normals; 3 * 4096 * 255 fits 32 bit


@dataclass(frozen=True)
class Margins:
    """Tolerances around the colours of a patch of floor.

    Args:
        hue_deg: At least this much on both sides.
        saturation: The same, of 255; a third of it, as a share of r + g + b, for the warmth.
        widen: Share of the spread of hue, saturation and warmth that is added on both sides.
        value: Brightness on both sides at least, of 255.
        value_widen: Share of the spread of the brightness that is added on both sides.
        shadow: Factor on the lowest brightness.
        highlight: Factor on the highest brightness.
    """

    hue_deg: float
    saturation: float
    widen: float
    value: float
    value_widen: float
    shadow: float
    highlight: float


TOLERANT = Margins(
    hue_deg=16.0,  # jpeg, and lamps of two colours
    saturation=22.0,
    widen=0.5,
    value=25.0,
    value_widen=0.35,  # knots and joints of boards
    shadow=0.80,  # soft shadows
    highlight=1.12,
)
"""Ours: accepts the floor in other light."""

CORE = Margins(
    hue_deg=2.0, saturation=2.0, widen=0.0, value=2.0, value_widen=0.0, shadow=1.0, highlight=1.0
)
"""Ours: accepts little more than the colours themselves."""


@dataclass(frozen=True)
class ColourRange:
    """A range of colours.

    Args:
        hue_deg: Its middle, deg (0 red, 120 green).
        hue_half_deg: Half its width, deg; 180 for any hue.
        saturation, value: Lowest and highest, in [0, 255].
        warmth: Lowest and highest (r - b) / (r + g + b); tested if any hue is accepted.
    """

    hue_deg: float
    hue_half_deg: float
    saturation: tuple[float, float]
    value: tuple[float, float]
    warmth: tuple[float, float] = (-1.0, 1.0)

    def __post_init__(self) -> None:
        for name in ("saturation", "value", "warmth"):
            low, high = getattr(self, name)
            if not low <= high:
                raise ConfigError(f"colour range: {name}={(low, high)} must be (low, high)")

    @property
    def any_hue(self) -> bool:
        """Whether every hue is accepted: from about 180 deg width on."""
        return self.hue_half_deg >= 88.0

    def blended(self, other: ColourRange, share: float) -> ColourRange:
        """This range, moved by a share of the difference to the other."""

        def mix(a: float, b: float) -> float:
            return a + share * (b - a)

        def mix_ends(a: tuple[float, float], b: tuple[float, float]) -> tuple[float, float]:
            return mix(a[0], b[0]), mix(a[1], b[1])

        turn = (other.hue_deg - self.hue_deg + 180.0) % 360.0 - 180.0
        return ColourRange(
            (self.hue_deg + share * turn) % 360.0,
            mix(self.hue_half_deg, other.hue_half_deg),
            mix_ends(self.saturation, other.saturation),
            mix_ends(self.value, other.value),
            mix_ends(self.warmth, other.warmth),
        )

    @property
    def at_any_brightness(self) -> ColourRange:
        """The same range without limits of value."""
        return replace(self, value=(0.0, 255.0))


@dataclass(frozen=True)
class ColourSpread:
    """Middle and quantiles of the colours of a patch of floor.

    Args:
        hue_deg: Middle of the hues, deg.
        hue_half_deg: Half the spread of the hues, deg; None if hardly any pixel has a hue.
        saturation, value: Low and high quantile, in [0, 255].
        warmth: Low and high quantile; see `ColourRange`.
    """

    hue_deg: float
    hue_half_deg: float | None
    saturation: tuple[float, float]
    value: tuple[float, float]
    warmth: tuple[float, float]

    def with_margins(self, margins: Margins) -> ColourRange:
        """The range of these colours, widened by margins."""
        hue_half = 180.0
        if self.hue_half_deg is not None:
            half = self.hue_half_deg
            hue_half = half + max(2 * half * margins.widen, margins.hue_deg)
        saturation = _widened(self.saturation, margins.widen, margins.saturation)
        warmth = _widened(self.warmth, margins.widen, margins.saturation / (3 * 255.0))
        low, high = self.value
        spread = margins.value_widen * (high - low)
        value = (
            float(min(low - margins.value, low * margins.shadow, low - spread)),
            float(max(high + margins.value, high * margins.highlight, high + spread)),
        )
        return ColourRange(self.hue_deg, float(min(hue_half, 180.0)), saturation, value, warmth)


def colour_spread(colours: UInt8[np.ndarray, "n 3"]) -> ColourSpread:
    """Middle and quantiles of colours (n, 3), red first; n at least 1."""
    ends = [TAIL, 1 - TAIL]
    hsv = cv2.cvtColor(colours[None], cv2.COLOR_RGB2HSV_FULL)[0].astype(np.float64)
    angle = hsv[:, 0] * (2 * math.pi / 256)
    chroma = hsv[:, 1] * hsv[:, 2] / 255
    middle = math.atan2(float(chroma @ np.sin(angle)), float(chroma @ np.cos(angle)))
    half = None
    vivid = chroma >= MIN_CHROMA
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
    return ColourSpread(math.degrees(middle) % 360.0, half, saturation, value, warm)


def _widened(ends: tuple[float, float], widen: float, least: float) -> tuple[float, float]:
    low, high = ends
    margin = max((high - low) * widen, least)
    return low - margin, high + margin


def mark(
    rgb: UInt8[np.ndarray, "h w 3"], colours: ColourRange, mask: UInt8[np.ndarray, "h w"]
) -> None:
    """Set the mask to 255 where the picture lies in the range; leave it unchanged elsewhere."""
    if not rgb.size:
        return
    limits = kernels.Limits(
        np.int32(math.ceil(colours.value[0])),
        np.int32(math.floor(colours.value[1])),
        np.int32(math.ceil(colours.saturation[0])),
        np.int32(math.floor(colours.saturation[1])),
        np.int32(0 if colours.any_hue else math.ceil(MIN_CHROMA)),
    )
    if colours.any_hue:
        low = _warmth_plane(colours.warmth[0], 1.0)
        high = _warmth_plane(colours.warmth[1], -1.0)
    else:
        low = _hue_plane(colours.hue_deg - colours.hue_half_deg, 1.0)
        high = _hue_plane(colours.hue_deg + colours.hue_half_deg, -1.0)
    planes = np.empty((3, *mask.shape), np.uint8)
    cv2.split(rgb, list(planes))  # without an output OpenCV copies each once more
    kernels.mark_range(*planes, limits, low, high, mask)


def _warmth_plane(warmth: float, side: float) -> kernels.Normal:
    """Normal of the half plane of colours that are warmer (+1) or colder (-1)."""
    return _integers(side * _SCALE * (np.array([1.0, 0.0, -1.0]) - warmth))


def _hue_plane(hue_deg: float, side: float) -> kernels.Normal:
    """Normal of the half plane that begins at a hue and extends to higher (+1) or lower (-1) ones.

    In the plane x = r - (g + b) / 2, y = (g - b) sqrt(3) / 2 the hue of HSV is not an angle, but it grows with the
    angle, so that both define the same half plane.
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
    return _integers(whole)


def _integers(normal: np.ndarray) -> kernels.Normal:
    return kernels.Normal(*np.rint(normal).astype(np.int32))
