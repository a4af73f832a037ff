"""The moments of a run that its page holds: evenly thinned, with the pictures and grids that came with them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any

import cv2
import numpy as np

from ...results.moment import Layers, Moment
from ...results.moments import held

MOST_MOMENTS = 1200
"""Ours: twice as many are halved, so a page holds at least this many of a longer run."""


@dataclass(frozen=True, eq=False)
class Shot:
    """A picture of a moment.

    Args:
        moment: Number of the moment.
        data: Encoded, as the page shows it.
    """

    moment: int
    data: bytes

    @property
    def kind(self) -> str:
        """The format by its first bytes: webp or jpeg."""
        return "webp" if self.data[:4] == b"RIFF" else "jpeg"


@dataclass(eq=False)
class Strip:
    """The pictures of one sensor.

    Args:
        name: Of the sensor.
        shots: In their order.
        step_m: Of a depth picture: metres of one grey level, 0 is no depth; None for colour.
        far_step: Grey level that is drawn darkest.
        wide: Whether it takes the whole width.
        labels: Caption of each picture; empty: its time.
        sensor: Camera that took them; empty where that does not matter.
    """

    name: str
    shots: list[Shot] = field(default_factory=list)
    step_m: float | None = None
    far_step: float = 255.0
    wide: bool = False
    labels: list[str] = field(default_factory=list)
    sensor: str = ""

    def pane(self) -> dict[str, Any]:
        """What a page needs to know of the pictures, which it holds elsewhere."""
        return {
            "name": self.name,
            "moments": [shot.moment for shot in self.shots],
            "mime": f"image/{self.shots[0].kind}",
            "metres": self.step_m,
            "far_step": self.far_step,
            "wide": self.wide,
            "labels": self.labels or None,
            "sensor": self.sensor,
        }


@dataclass(eq=False)
class Gathered:
    """What the page holds of the moments.

    Args:
        moments: With the plan that holds, but without pictures and grids.
        strips: Pictures by sensor.
        grids: Number of the moment from which it holds, and the grid.
    """

    moments: list[Moment]
    strips: list[Strip]
    grids: list[tuple[int, Layers]]


def gather(moments: Iterable[Moment]) -> Gathered:
    """Read a run once, and keep at most twice `MOST_MOMENTS` of it, evenly."""
    kept: list[Moment] = []
    every = 1
    for number, moment in enumerate(held(iter(moments))):
        if number % every:
            continue
        kept.append(moment)
        if len(kept) >= 2 * MOST_MOMENTS:
            kept, every = kept[::2], 2 * every
    strips: dict[str, Strip] = {}
    grids: list[tuple[int, Layers]] = []
    colour, depth = None, None
    for k, moment in enumerate(kept):
        if moment.colour is not None and moment.colour is not colour:
            colour = moment.colour
            name = "Camera (stereo)" if moment.colour_sensor == "stereo" else "Camera"
            strip = strips.setdefault(name, Strip(name, sensor=moment.colour_sensor))
            strip.shots.append(Shot(k, colour))
        if moment.depth is not None and moment.depth is not depth:
            depth = moment.depth
            _add_depth(strips, k, moment)
        if moment.grid is not None and (not grids or moment.grid is not grids[-1][1]):
            grids.append((k, moment.grid))
    bare = [replace(moment, colour=None, depth=None, grid=None) for moment in kept]
    ordered = sorted(strips.values(), key=lambda strip: strip.step_m is not None)  # cameras first
    return Gathered(bare, ordered, grids)


def _add_depth(strips: dict[str, Strip], number: int, moment: Moment) -> None:
    """A depth picture, without loss; its darkest level is the largest 98th percentile of all pictures."""
    assert moment.depth is not None
    name = "Depth" if moment.depth_sensor in ("", "depth") else f"Depth ({moment.depth_sensor})"
    made = Strip(name, step_m=moment.depth_step_m, far_step=1.0, sensor=moment.depth_sensor)
    strip = strips.setdefault(name, made)
    levels = moment.depth
    if moment.depth_step_m != strip.step_m and strip.step_m:  # one unit for the whole strip
        scaled = np.rint(levels * (moment.depth_step_m / strip.step_m))
        levels = np.clip(scaled, 0, 255).astype(np.uint8)
    seen = levels[levels > 0]
    if seen.size:
        strip.far_step = max(strip.far_step, float(np.percentile(seen, 98)))
    done, data = cv2.imencode(".webp", levels, [cv2.IMWRITE_WEBP_QUALITY, 101])
    if done:
        strip.shots.append(Shot(number, data.tobytes()))
