"""Pictures of plane regions in simulated views of staircases."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import UInt8

from perception.depth.reach import ReachesConfig
from perception.floor.choose import FloorConfig
from perception.primitives.frame import Depth
from perception.terrain import segmentation, staircase
from perception.terrain.region import Region

from ...report.plots.style import SERIES, sheet
from . import stair_views

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NAMES = {"tof": "time of flight", "stereo": "stereo", "depth": "structured light"}


def draw(seed: int, config: FloorConfig) -> Figure:
    """A staircase up and one down by each sensor, every region in a colour of its own."""
    figure, axes = sheet(2, 3, height_in=4.8)
    for row, kind in zip(axes, ("up", "down"), strict=True):
        view = stair_views.draw(seed, kind)
        depths = stair_views.measure(view, seed)
        for ax, sensor in zip(row, stair_views.SENSORS, strict=True):
            reach = ReachesConfig().of(sensor, depths[sensor])
            regions = segmentation.find(depths[sensor], reach, config, sensor)
            found = staircase.find(regions, view.prior)
            ax.imshow(coloured(depths[sensor], regions))
            words = "unknown" if found is None else _words(found.riser_m, found.tread_m)
            ax.set(title=f"{NAMES[sensor]}\n{words}", xticks=[], yticks=[])
            ax.grid(False)
        assert view.stairs is not None, "both kinds are stairs"
        row[0].set_ylabel(f"true:\n{_words(view.stairs.riser_m, view.stairs.tread_m)}")
    return figure


def coloured(depth: Depth, regions: list[Region]) -> UInt8[np.ndarray, "h w 3"]:
    """The regions of an image in colours; black without depth, grey without region."""
    picture = np.zeros((*depth.z.shape, 3), np.uint8)
    picture[np.isfinite(depth.z)] = 90
    for k, one in enumerate(regions):
        colour = SERIES[k % len(SERIES)]
        picture[one.mask(depth.camera)] = [int(colour[i : i + 2], 16) for i in (1, 3, 5)]
    return picture


def _words(riser_m: float, tread_m: float) -> str:
    return f"riser {100 * riser_m:.1f}, tread {100 * tread_m:.1f} cm"
