"""Key angles: the head's own directions in the finished panorama, and the angles between them.

Each view is drawn again at its nominal direction and located in the panorama by fast normalised cross
correlation, within a window that the registration allows. Its location gives the column and row of the head's
yaw and pitch. Between key angles, angles are linear, as the panorama is drawn on a sphere.

Source: Kang 2013 (seed 004), eq. (11) after Lewis 1995, eq. (12).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32

from perception.primitives.errors import InputError

from . import _kernels
from .rendering import Drawing, corner, draw_view
from .sphere import angles_of
from .views import View

WINDOW_RAD = math.radians(2.0)  # seed 004 as specified: a match further off is wrong
LEAST_CORRELATION = 0.9  # seed 004 as specified: below, the head's own angle is used
ROW_STEP = 4  # ours: every fourth row suffices, in a quarter of the time
LEAST_SHARE = 0.25  # ours: of the template that must overlap known pixels
SAME_KEY_RAD = math.radians(1.0)  # ours: consecutive sorted angles this close share a key angle


class Found(NamedTuple):
    """Best location of a template's corner: column and row, px, and the correlation there."""

    x: float
    y: float
    correlation: float


def prepared(
    image: Float32[np.ndarray, "h w"],
) -> tuple[Float32[np.ndarray, "h w"], Float32[np.ndarray, "h w"]]:
    """An image without its mean (0 where NaN), and its mask of known pixels as 0 and 1."""
    known = np.isfinite(image)
    mean = np.float32(image[known].mean()) if known.any() else np.float32(0.0)
    return np.where(known, image - mean, np.float32(0.0)), known.astype(np.float32)


def locate(
    panorama: tuple[Float32[np.ndarray, "H W"], Float32[np.ndarray, "H W"]],
    template: tuple[Float32[np.ndarray, "h w"], Float32[np.ndarray, "h w"]],
    expected: tuple[int, int],
    reach: tuple[int, int],
    row_step: int = ROW_STEP,
) -> Found | None:
    """Locate a template in a panorama by normalised cross correlation within a window.

    Args:
        panorama: Values and mask, see `prepared`.
        template: Values and mask.
        expected: (x, y) of its upper left corner, px.
        reach: Largest offset from there in columns and rows, px.
        row_step: Every how many rows are compared.

    Returns:
        The best location, with subpixel accuracy by a parabola; None if too few pixels overlap.

    Source: seed 004, eq. (11).
    """
    (values, known), (wanted, shown) = panorama, template
    out = np.empty((2 * reach[1] + 1, 2 * reach[0] + 1), np.float32)
    least = max(16.0, LEAST_SHARE * wanted.size / row_step)
    _kernels.correlate(
        values,
        known,
        wanted,
        shown,
        expected[1] - reach[1],
        expected[0] - reach[0],
        row_step,
        least,
        out,
    )
    row, column = np.unravel_index(int(np.argmax(out)), out.shape)
    if out[row, column] <= -1.5:
        return None
    x = column + _vertex(out[row], int(column))
    y = row + _vertex(out[:, column], int(row))
    return Found(
        float(expected[0] - reach[0] + x),
        float(expected[1] - reach[1] + y),
        float(out[row, column]),
    )


def _vertex(values: Float32[np.ndarray, "n"], best: int) -> float:
    """Offset of a parabola's vertex from the largest of three values; 0 at the end of the row."""
    if not 0 < best < len(values) - 1 or min(values[best - 1], values[best + 1]) < -1.5:
        return 0.0
    left, middle, right = (float(v) for v in values[best - 1 : best + 2])
    bend = left - 2.0 * middle + right
    return 0.5 * (left - right) / bend if bend < 0.0 else 0.0


@dataclass(frozen=True, eq=False)
class AngleLaw:
    """Angles along one axis of the panorama, linear between key angles.

    Args:
        keys_rad: Key angles, increasing.
        pixels: Pixel of each, strictly monotonic.
    """

    keys_rad: Float[np.ndarray, "n"]
    pixels: Float[np.ndarray, "n"]

    def __post_init__(self) -> None:
        if len(self.keys_rad) < 2:
            raise InputError(f"angle law: {len(self.keys_rad)} key angles; at least two are needed")
        steps = np.diff(self.pixels)
        if not (np.all(steps > 0.0) or np.all(steps < 0.0)) or np.any(
            np.diff(self.keys_rad) <= 0.0
        ):
            raise InputError(
                "angle law: key angles must increase, and their pixels be strictly monotonic"
            )

    def angle(self, pixel: Float[np.ndarray, "*m"]) -> Float[np.ndarray, "*m"]:
        """Angle at pixels, rad; extrapolated linearly beyond the ends.

        Source: seed 004, eq. (12).
        """
        keys, places = self.keys_rad, self.pixels
        if places[0] > places[-1]:
            keys, places = keys[::-1], places[::-1]
        k = np.clip(np.searchsorted(places, pixel) - 1, 0, len(places) - 2)
        share = (pixel - places[k]) / (places[k + 1] - places[k])
        return np.asarray(keys[k] + share * (keys[k + 1] - keys[k]))


def laws(drawing: Drawing, views: Sequence[View]) -> tuple[AngleLaw, AngleLaw]:
    """The laws of theta over columns and phi over rows, from the views located in the panorama.

    Args:
        drawing: The panorama.
        views: Its views; the priors are the head's own directions.

    Returns:
        theta over x and phi over y. A view not found in its window keeps the direction of the head.

    Raises:
        InputError: Fewer than two different yaws or pitches among the views with a prior.

    Source: seed 004, section 2.2.2 (A over x, B over y).
    """
    panorama, sphere = prepared(drawing.range_m), drawing.sphere
    scale = sphere.px_per_rad
    reach = math.ceil(WINDOW_RAD * scale)
    across: list[tuple[float, float]] = []
    down: list[tuple[float, float]] = []
    for view in views:
        if view.prior is None:
            continue
        theta, phi = (float(angle) for angle in angles_of(view.prior.rotation[:, 2]))
        x = (theta - sphere.left_rad) * scale
        y = (sphere.top_rad - phi) * scale
        template, _, part = draw_view(view, view.prior, scale, drawing.centre)
        place = corner(part, sphere)
        found = locate(panorama, prepared(template), place, (reach, reach))
        if found is not None and found.correlation >= LEAST_CORRELATION:
            off = (found.x - place[0], found.y - place[1])
            if max(abs(off[0]), abs(off[1])) < reach:
                x, y = x + off[0], y + off[1]
        across.append((theta, x))
        down.append((phi, y))
    return _law(across), _law(down)


def _law(found: list[tuple[float, float]]) -> AngleLaw:
    """The law through angles and pixels of the views; close consecutive angles share a key."""
    pairs = np.array(sorted(found)).reshape(-1, 2)
    groups = np.split(pairs, np.flatnonzero(np.diff(pairs[:, 0]) >= SAME_KEY_RAD) + 1)
    means = np.array([group.mean(axis=0) for group in groups if group.size]).reshape(-1, 2)
    return AngleLaw(means[:, 0], means[:, 1])
