"""Procedural materials: metric and aperiodic, so that stereo matching works everywhere.

A material is a name "kind/colour". Painted on a rectangle it is a sum of noise at octaves from decimetres to
millimetres, plus the structure of its kind: planks, tiles, threads, drawers. The kind "plain" has no texture: stereo
fails on it.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

from perception.primitives.errors import InputError

Image = Float32[np.ndarray, "h w 3"]

PALETTE: dict[str, tuple[int, int, int]] = {
    "white": (236, 233, 226),
    "cream": (238, 222, 194),
    "sage": (186, 204, 172),
    "sky": (174, 200, 220),
    "oak": (190, 148, 98),
    "walnut": (118, 80, 54),
    "pine": (214, 178, 122),
    "teal": (52, 122, 128),
    "rust": (178, 88, 52),
    "plum": (112, 66, 98),
    "mustard": (202, 158, 54),
    "navy": (52, 70, 110),
    "grey": (136, 138, 142),
    "slate": (92, 100, 108),
    "kraft": (186, 146, 100),
    "leaf": (74, 124, 58),
    "clay": (182, 104, 72),
    "red": (190, 52, 48),
    "orange": (232, 128, 40),
    "violet": (134, 84, 176),
    "lime": (150, 190, 60),
}

BAND_ROWS = 64  # ours: rows of an image that stay in the processor's cache
TAG_MODULES = 6  # DICT_4X4_250: 4 x 4 bits in a black frame of one module
MOST_TAGS = 250  # of the dictionary; its first fifty are those of DICT_4X4_50
TAG_MARGIN_MODULES = 1  # white margin on the plate


def paint(
    material: str, size_m: tuple[float, float], metres_per_px: float, rng: np.random.Generator
) -> UInt8[np.ndarray, "h w 3"]:
    """Texture of a rectangle.

    Args:
        material: "kind/colour", or "tag/17" for a tag with its id.
        size_m: Width and height.
        metres_per_px: Resolution.
        rng: Source of all irregular structure.

    Raises:
        InputError: for an unknown kind or colour.
    """
    kind, _, colour = material.partition("/")
    if kind == "tag":
        return _tag(int(colour))
    if kind not in KINDS or colour not in PALETTE:
        raise InputError(
            f"material {material!r}: expected kind/colour with a kind of {', '.join(KINDS)} and a "
            f"colour of {', '.join(PALETTE)}"
        )
    width, height = (max(4, round(side / metres_per_px)) for side in size_m)
    image = np.empty((height, width, 3), np.float32)
    image[:] = PALETTE[colour]
    painted = KINDS[kind](image, metres_per_px, rng)
    return np.clip(painted, 0, 255, out=painted).astype(np.uint8)


def times(image: Image, factor: Float32[np.ndarray, "h w"]) -> Image:
    """Every pixel of the image times its factor, in place; several times faster than by broadcasting over three colours."""
    for first in range(0, len(image), BAND_ROWS):
        band, by = image[first : first + BAND_ROWS], factor[first : first + BAND_ROWS]
        cv2.multiply(band, cv2.merge([by, by, by]), band)
    return image


def shaded(
    image: UInt8[np.ndarray, "h w 3"], light: Float32[np.ndarray, "h w"]
) -> UInt8[np.ndarray, "h w 3"]:
    """The image under light of that strength, in place; in bands of rows, as four floats a pixel are much memory."""
    for first in range(0, len(image), BAND_ROWS):
        rows = slice(first, first + BAND_ROWS)
        lit = times(image[rows].astype(np.float32), light[rows])
        image[rows] = np.clip(lit, 0, 255, out=lit)
    return image


def noise(
    shape: tuple[int, int],
    metres_per_px: float,
    rng: np.random.Generator,
    coarsest_m: float = 0.4,
    finest_m: float = 0.002,
    stretch: float = 1.0,
) -> Float32[np.ndarray, "h w"]:
    """Noise of many octaves of equal strength; mean 0, standard deviation 1.

    Args:
        shape: Rows and columns.
        metres_per_px: Resolution.
        rng: Random source.
        coarsest_m, finest_m: Feature sizes of the first and the last octave.
        stretch: Ratio of feature length along rows to that across.
    """
    height, width = shape
    feature = coarsest_m
    total: np.ndarray = np.zeros((1, 1), np.float32)
    while True:
        rows = min(height, int(height * metres_per_px / feature) + 2)
        columns = min(width, int(width * metres_per_px / (feature * stretch)) + 2)
        total = cv2.resize(total, (columns, rows), interpolation=cv2.INTER_LINEAR)
        total = total + rng.standard_normal((rows, columns), dtype=np.float32)
        feature /= 2
        if feature < max(finest_m, metres_per_px) or (rows, columns) == shape:
            break
    total = np.asarray(cv2.resize(total, (width, height), interpolation=cv2.INTER_LINEAR))
    centred = np.subtract(total, total.mean(), out=total)
    return np.divide(centred, max(float(np.sqrt(np.mean(centred**2))), 1e-6), out=centred)


def _plain(image: Image, px_m: float, rng: np.random.Generator) -> Image:
    """One colour without texture: stereo cannot match it."""
    return image


def _plaster(image: Image, px_m: float, rng: np.random.Generator) -> Image:
    mottled = noise(image.shape[:2], px_m, rng, 0.25)
    mottled *= np.float32(9.0)
    tint = cv2.merge([np.float32(share) * mottled for share in (1.0, 0.98, 0.9)])
    return np.asarray(cv2.add(image, tint, tint))


def _wall(image: Image, px_m: float, rng: np.random.Generator) -> Image:
    """Plaster above a white skirting board."""
    image = _plaster(image, px_m, rng)
    board = round(0.07 / px_m)
    if image.shape[0] > 4 * board:
        image[-board:] = 0.25 * image[-board:] + np.float32(0.75) * np.array(
            PALETTE["white"], np.float32
        )
        image[-board : -board + max(1, round(0.004 / px_m))] *= np.float32(0.6)
    return image


def _fabric(image: Image, px_m: float, rng: np.random.Generator) -> Image:
    woven = noise(image.shape[:2], px_m, rng, 0.2)
    return times(image, 1 + 0.16 * woven)


def _wood(image: Image, px_m: float, rng: np.random.Generator) -> Image:
    veins = noise(image.shape[:2], px_m, rng, 0.03, stretch=10.0)
    pores = noise(image.shape[:2], px_m, rng, 0.06, stretch=2.0)
    veins *= np.float32(0.10)
    pores *= np.float32(0.08)
    veins += 1.0
    veins += pores
    return times(image, veins)


def _planks(image: Image, px_m: float, rng: np.random.Generator) -> Image:
    """Floor boards along the rows, with random lengths and shades."""
    image = _wood(image, px_m, rng)
    height, width = image.shape[:2]
    board = max(8, round(0.13 / px_m))
    for top in range(0, height, board):
        left = -int(rng.integers(0, round(0.8 / px_m)))
        while left < width:
            length = int(rng.uniform(0.6, 1.5) / px_m)
            rows, columns = slice(top, top + board), slice(max(left, 0), max(left + length, 0))
            tint = np.array([1.0, 1.0, 1.0]) + rng.normal(0, 0.02, 3)
            image[rows, columns] *= (rng.normal(1.0, 0.09) * tint).astype(np.float32)
            image[rows, max(left, 0) : max(left, 0) + 1] *= 0.6
            left += length
        image[top : top + 1] *= 0.62
    return image


def _tiles(image: Image, px_m: float, rng: np.random.Generator) -> Image:
    """Square tiles of 33 cm with random shades and low-frequency noise, so that all differ."""
    side = max(8, round(0.33 / px_m))
    image = image * (1 + 0.12 * noise(image.shape[:2], px_m, rng, 0.25))[..., None]
    for top in range(0, image.shape[0], side):
        for left in range(0, image.shape[1], side):
            image[top : top + side, left : left + side] *= np.float32(rng.normal(1.0, 0.07))
        image[top : top + 2] *= 0.7
    for left in range(0, image.shape[1], side):
        image[:, left : left + 2] *= 0.7
    return image


def _rug(image: Image, px_m: float, rng: np.random.Generator) -> Image:
    """A woven rug with a border and irregular bands."""
    height, width = image.shape[:2]
    image = _fabric(image, px_m, rng)
    bands = noise((height, width), px_m, rng, 0.35, 0.08, stretch=3.0)
    image[np.abs(bands) < 0.18] *= np.float32(1.45)
    for inset, thick, factor in ((0.05, 0.025, 1.6), (0.10, 0.012, 0.5)):
        a, b = round(inset / px_m), max(2, round(thick / px_m))
        ring = np.zeros((height, width), bool)
        ring[a : height - a, a : width - a] = True
        ring[a + b : height - a - b, a + b : width - a - b] = False
        image[ring] *= np.float32(factor)
    return image


def _drawers(image: Image, px_m: float, rng: np.random.Generator) -> Image:
    """Wooden doors or drawers with dark joints and small handles."""
    image = _wood(image, px_m, rng)
    height, width = image.shape[:2]
    across = max(1, round(width * px_m / 0.5))
    down = max(1, round(height * px_m / 0.4))
    line = max(1, round(0.006 / px_m))
    for i in range(across):
        for j in range(down):
            x0, x1 = i * width // across, (i + 1) * width // across
            y0, y1 = j * height // down, (j + 1) * height // down
            image[y0 : y1 + 1, x0 : x0 + line] *= 0.45
            image[y0 : y0 + line, x0 : x1 + 1] *= 0.45
            middle = ((x0 + x1) // 2, y0 + max(3, (y1 - y0) // 4))
            reach = max(2, round(0.05 / px_m))
            image[middle[1] - line : middle[1] + line, middle[0] - reach : middle[0] + reach] = 60.0
    return image


def _books(image: Image, px_m: float, rng: np.random.Generator) -> Image:
    """Shelves of books, all different."""
    image = _wood(image, px_m, rng)
    height, width = image.shape[:2]
    shelf, rim = max(12, round(0.32 / px_m)), max(2, round(0.02 / px_m))
    colours = [np.array(c, np.float32) for c in PALETTE.values()]
    for top in range(rim, height - rim, shelf):
        base = min(top + shelf - rim, height - rim)
        image[top:base, rim : width - rim] *= 0.25
        left = rim
        while left < width - rim:
            thick = max(2, round(rng.uniform(0.015, 0.05) / px_m))
            tall = round(rng.uniform(0.55, 0.9) * (base - top))
            if rng.random() < 0.9:
                spine = colours[int(rng.integers(len(colours)))] * rng.uniform(0.6, 1.0)
                image[base - tall : base, left : min(left + thick - 1, width - rim)] = spine
            left += thick
    return image + 5.0 * noise((height, width), px_m, rng, 0.05)[..., None]


def _cardboard(image: Image, px_m: float, rng: np.random.Generator) -> Image:
    image = times(image, 1 + 0.09 * noise(image.shape[:2], px_m, rng, 0.15))
    height, width = image.shape[:2]
    tape = max(2, round(0.025 / px_m))
    image[:, width // 2 - tape : width // 2 + tape] *= np.array([1.12, 1.08, 0.95], np.float32)
    image[int(0.6 * height) : int(0.8 * height), int(0.1 * width) : int(0.35 * width)] *= 0.6
    return image


def _leaves(image: Image, px_m: float, rng: np.random.Generator) -> Image:
    clumps = noise(image.shape[:2], px_m, rng, 0.12)
    return times(image, 1 + 0.38 * clumps) * np.array([0.95, 1.05, 0.9], np.float32)


def _stripes(image: Image, px_m: float, rng: np.random.Generator) -> Image:
    """A painted casing with bands and scratches, for moving robots."""
    height = image.shape[0]
    image = times(image, 1 + 0.10 * noise(image.shape[:2], px_m, rng, 0.08))
    for where, thick in ((0.18, 0.10), (0.62, 0.05)):
        image[int(where * height) : int((where + thick) * height)] *= np.float32(0.35)
    return image


KINDS: dict[str, Callable[[Image, float, np.random.Generator], Image]] = {
    "plain": _plain,
    "plaster": _plaster,
    "wall": _wall,
    "fabric": _fabric,
    "wood": _wood,
    "planks": _planks,
    "tiles": _tiles,
    "rug": _rug,
    "drawers": _drawers,
    "books": _books,
    "cardboard": _cardboard,
    "leaves": _leaves,
    "stripes": _stripes,
}


def _tag(identity: int) -> UInt8[np.ndarray, "h w 3"]:
    """The tag with its white margin, 24 px per module."""
    modules = TAG_MODULES + 2 * TAG_MARGIN_MODULES
    image = np.full((modules * 24, modules * 24), 245, np.uint8)
    inner = slice(TAG_MARGIN_MODULES * 24, (TAG_MARGIN_MODULES + TAG_MODULES) * 24)
    printed = cv2.aruco.generateImageMarker(_dictionary(), identity, TAG_MODULES * 24)
    image[inner, inner] = np.clip(printed, 12, 245)
    return np.repeat(image[..., None], 3, axis=2)


@cache
def _dictionary() -> cv2.aruco.Dictionary:
    return cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_250)
