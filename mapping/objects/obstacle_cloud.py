"""What a run remembers of static obstacles: voxels with all that footprints need.

Every voxel keeps its mean place and colour, the number of frames that saw it, where the sensor stood, and how well the
place was known. Where the body itself has walked is free floor. An obstacle that came or went is known by the frames in
which its cell of the world map showed one.

Source: ours.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, UInt8

from perception.primitives.gaussian import Gaussian

from ..grid.heights import pose_form
from ..grid.world_map import WorldMap
from ..io.clouds import CloudBuilder, CloudConfig
from ..io.nav2 import FREE_BELOW
from . import footprints
from .columns import Voxels
from .footprints import Footprint, FootprintConfig
from .free_cells import FreeCells

STOOD_M = 0.01  # ours: raster of the places where the body stood
HALF_FOOT_M = 0.03  # ours: the floor that a foot covers for certain, to each side of its middle
OCCUPIED = 0.5  # as for planners: voxels in cells with a lower probability have been refuted


class ObstacleCloud:
    """The voxels of static obstacles."""

    def __init__(self, cloud: CloudConfig) -> None:
        """An empty cloud."""
        self._obstacles = CloudBuilder(cloud, values=4)
        self._stood: set[tuple[float, float]] = set()

    def add(
        self,
        points: Float[np.ndarray, "n 3"],
        sigma_m: Float[np.ndarray, "n"],
        sensor: Float[np.ndarray, "3"],
        pose: Gaussian | None,
        colours: UInt8[np.ndarray, "n 3"] | None,
    ) -> None:
        """Add the points of static obstacles of one view.

        Args:
            points: World frame, z above the floor, m.
            sigma_m: Standard deviation of each along its ray.
            sensor: Position of the camera, world frame, m.
            pose: (x, y, yaw) of the body with its covariance; None: without doubt.
            colours: RGB of each; None without a colour camera.
        """
        values = np.zeros((len(points), 4))
        values[:, :2] = sensor[:2]
        places = np.column_stack([points[:, :2], np.ones(len(points))])
        values[:, 2] = np.sum(places @ pose_form(pose) * places, axis=1)
        values[:, 3] = sigma_m**2
        self._obstacles.add(points, colours, values)

    def stand(self, place: Float[np.ndarray, "2"]) -> None:
        """The body walks here, so the floor is free.

        Args:
            place: Of the body, world frame, m.
        """
        x, y = np.round(place / STOOD_M).tolist()
        self._stood.add((x, y))

    def footprints(self, world: WorldMap, config: FootprintConfig) -> list[Footprint]:
        """Footprints of the obstacles that the map shows, none over a cell that it shows free."""
        xyz, colours = self._obstacles.cloud()
        probability = world.probability
        if not len(xyz) or not probability.size:
            return []
        rows, columns = world.cell_of(xyz[:, :2]).T
        inside = (rows >= 0) & (columns >= 0)
        inside &= (rows < probability.shape[0]) & (columns < probability.shape[1])
        occupancy, stay = np.zeros((2, len(xyz)))
        occupancy[inside] = probability[rows[inside], columns[inside]]
        stay[inside] = world.stay[rows[inside], columns[inside]]
        values = self._obstacles.values
        voxels = Voxels(
            stay,
            values[:, :2],
            values[:, 2],
            values[:, 3],
            np.full((len(xyz), 3), np.nan) if colours is None else colours.astype(np.float64),
            occupancy,
            xyz,
            self._obstacles.sightings.astype(np.float64),
        )
        free = world.known & (probability < FREE_BELOW)
        free |= self._walked(world)
        cells = FreeCells(free, world.origin, world.cell_m)
        return footprints.find(voxels.of(occupancy > OCCUPIED), config, cells)

    def _walked(self, world: WorldMap) -> Bool[np.ndarray, "rows columns"]:
        """The cells of the map within half a foot of a place where the body stood."""
        height, width = world.probability.shape
        walked = np.zeros((height, width), np.bool_)
        if not self._stood:
            return walked
        offsets = np.array([(x, y) for x in (-1, 0, 1) for y in (-1, 0, 1)]) * HALF_FOOT_M
        places = STOOD_M * np.array(sorted(self._stood))[:, None] + offsets
        rows, columns = world.cell_of(places.reshape(-1, 2)).T
        inside = (rows >= 0) & (columns >= 0) & (rows < height) & (columns < width)
        walked[rows[inside], columns[inside]] = True
        return walked
