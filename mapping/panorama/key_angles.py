"""Key angles: where in the panorama the head's own directions lie, and every angle between them.

Each view is drawn once more at its nominal direction and looked for in the panorama by fast normalised
cross correlation, only where registration allows it to be. Where a view lies tells at which column and row
the head's yaw and pitch are; between them angles are linear, as the panorama is drawn on a sphere.

Source: seed 004, eq. (11) after Lewis 1995, eq. (12).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32

from perception.primitives.errors import ConfigError, InputError

from . import _kernels
from .rendering import Drawing, corner, draw_view
from .sphere import angles_of
from .views import View

SAME_KEY_RAD = math.radians(1.0)  # ours: of sorted angles, neighbours nearer share a key angle


@dataclass(frozen=True)
class KeyAngleConfig:
    """Where views are looked for, and what is believed."""

    window_deg: float = 2.0  # spec of 004: further from the head's angle it is not believed
    least_likeness: float = 0.9  # spec of 004: below it the head's angle is taken
    row_step: int = 4  # ours: every fourth row tells as much, for a quarter of the time
    least_share: float = 0.25  # ours: of the template that must lie on known ground

    def __post_init__(self) -> None:
        if not self.window_deg > 0.0 or self.row_step < 1:
            raise ConfigError(
                f"key angles: window_deg={self.window_deg} must be positive and "
                f"row_step={self.row_step} at least 1"
            )
        if not -1.0 <= self.least_likeness <= 1.0 or not 0.0 < self.least_share <= 1.0:
            raise ConfigError("key angles: least_likeness lies in -1 to 1, least_share in (0, 1]")


class Found(NamedTuple):
    """Where a template's corner lies best: column and row, px with fraction, and how alike it is."""

    x: float
    y: float
    likeness: float


def prepared(
    image: Float32[np.ndarray, "h w"],
) -> tuple[Float32[np.ndarray, "h w"], Float32[np.ndarray, "h w"]]:
    """An image about its mean with 0 where it is NaN, and 1 where it is known."""
    known = np.isfinite(image)
    mean = np.float32(image[known].mean()) if known.any() else np.float32(0.0)
    return np.where(known, image - mean, np.float32(0.0)), known.astype(np.float32)


def locate(
    panorama: tuple[Float32[np.ndarray, "H W"], Float32[np.ndarray, "H W"]],
    template: tuple[Float32[np.ndarray, "h w"], Float32[np.ndarray, "h w"]],
    expected: tuple[int, int],
    reach: tuple[int, int],
    config: KeyAngleConfig,
) -> Found | None:
    """Where a template lies in a panorama, by normalised cross correlation within a window.

    Args:
        panorama: Values and knowledge, as of `prepared`.
        template: Likewise.
        expected: (x, y) of its upper left corner, px.
        reach: How far across and down it may be from there, px.
        config: Row step and least share.

    Returns:
        The best place, to a fraction of a pixel by a parabola; None if too little is shared.

    Source: seed 004, eq. (11).
    """
    (values, known), (wanted, shown) = panorama, template
    out = np.empty((2 * reach[1] + 1, 2 * reach[0] + 1), np.float32)
    least = max(16.0, config.least_share * wanted.size / config.row_step)
    _kernels.correlate(
        values,
        known,
        wanted,
        shown,
        expected[1] - reach[1],
        expected[0] - reach[0],
        config.row_step,
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
    """Offset of a parabola's top from the highest of three values; 0 at the end of the row."""
    if not 0 < best < len(values) - 1 or min(values[best - 1], values[best + 1]) < -1.5:
        return 0.0
    left, middle, right = (float(v) for v in values[best - 1 : best + 2])
    bend = left - 2.0 * middle + right
    return 0.5 * (left - right) / bend if bend < 0.0 else 0.0


@dataclass(frozen=True, eq=False)
class AngleLaw:
    """Angles along one axis of the panorama, linear between key angles.

    Args:
        keys_rad: Key angles, growing.
        pixels: Where each lies, px; growing or falling throughout.
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
            raise InputError("angle law: key angles must grow, and their pixels run one way")

    def angle(self, pixel: Float[np.ndarray, "*m"]) -> Float[np.ndarray, "*m"]:
        """Angle at pixels, rad; beyond the ends the last segment goes on.

        Source: seed 004, eq. (12).
        """
        keys, places = self.keys_rad, self.pixels
        if places[0] > places[-1]:
            keys, places = keys[::-1], places[::-1]
        k = np.clip(np.searchsorted(places, pixel) - 1, 0, len(places) - 2)
        share = (pixel - places[k]) / (places[k + 1] - places[k])
        return np.asarray(keys[k] + share * (keys[k + 1] - keys[k]))


def laws(
    drawing: Drawing, views: Sequence[View], config: KeyAngleConfig | None = None
) -> tuple[AngleLaw, AngleLaw]:
    """The laws of theta over columns and phi over rows, by finding the views in the panorama.

    Args:
        drawing: The panorama.
        views: Those it was made of; the priors are the head's own directions.
        config: What is believed.

    Returns:
        theta over x and phi over y. A view that is not found where the head says counts as lying there.

    Raises:
        InputError: Fewer than two different yaws or pitches among the views with a prior.

    Source: seed 004, section 2.2.2 (A over x, B over y).
    """
    config = config or KeyAngleConfig()
    panorama, sphere = prepared(drawing.range_m), drawing.sphere
    scale = sphere.px_per_rad
    reach = math.ceil(math.radians(config.window_deg) * scale)
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
        found = locate(panorama, prepared(template), place, (reach, reach), config)
        if found is not None and found.likeness >= config.least_likeness:
            off = (found.x - place[0], found.y - place[1])
            if max(abs(off[0]), abs(off[1])) < reach:
                x, y = x + off[0], y + off[1]
        across.append((theta, x))
        down.append((phi, y))
    return _law(across), _law(down)


def _law(found: list[tuple[float, float]]) -> AngleLaw:
    """The law through views' angles and pixels; those that follow each other closely share a key."""
    pairs = np.array(sorted(found)).reshape(-1, 2)
    groups = np.split(pairs, np.flatnonzero(np.diff(pairs[:, 0]) >= SAME_KEY_RAD) + 1)
    means = np.array([group.mean(axis=0) for group in groups if group.size]).reshape(-1, 2)
    return AngleLaw(means[:, 0], means[:, 1])
