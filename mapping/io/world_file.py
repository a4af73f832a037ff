"""The files of a world map: its probability for Nav2, and all its layers as GeoTIFF."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..grid.world_map import WorldMap
from . import geotiff, nav2

LAYERS = "map_layers.tif"


def save(folder: str | Path, world: WorldMap) -> None:
    """Write map_probability.yaml with map_probability.png (mode "scale"), and map_layers.tif.

    The bands are occupancy (probability), height_m and height_variance_m2; NaN where the cell was not seen.

    Raises:
        OutputError: The folder cannot be written.
    """
    known, probability = world.known, world.probability
    nav2.save_scale(folder, "map_probability", probability, known, world.origin, world.cell_m)
    layers = {
        "occupancy": np.where(known, probability, np.float32(np.nan)),
        "height_m": world.height_m,
        "height_variance_m2": world.height_variance_m2,
    }
    geotiff.save(Path(folder) / LAYERS, layers, world.origin, world.cell_m)
