"""What a run remembers of static obstacles: voxels with all that footprints need.

Every voxel keeps its mean place and colour, the number of frames that saw it, where the sensor stood, and how well the
place was known. Floor is counted per cell of the map, in frames: an obstacle that stood there all the time was seen in
as many frames as the floor before it, and one that came or went in fewer.

Source: ours.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, UInt8

from perception.primitives.gaussian import Gaussian

from ..grid.world_map import WorldMap
from ..io.clouds import CloudBuilder, CloudConfig
from ..io.nav2 import FREE_BELOW
from . import footprints
from .columns import Voxels
from .footprints import Footprint, FootprintConfig
from .free_cells import FreeCells

OCCUPIED = 0.5  # as for planners: voxels in cells with a lower probability have been refuted


class ObstacleCloud:
    """The voxels of obstacles, and the frames in which each cell showed floor."""

    def __init__(self, cloud: CloudConfig, cell_m: float) -> None:
        """Empty; `cell_m` is the side of a cell of the map."""
        self._cell_m = cell_m
        self._obstacles = CloudBuilder(cloud, values=4)
        self._occupied_cells = CloudBuilder(CloudConfig(cell_m))
        self._floor_cells = CloudBuilder(CloudConfig(cell_m))

    def add(
        self,
        upright: Float[np.ndarray, "n 3"],
        is_obstacle: Bool[np.ndarray, "n"],
        is_moving: Bool[np.ndarray, "n"],
        sigma_m: Float[np.ndarray, "n"],
        sensor: Float[np.ndarray, "3"],
        pose: Gaussian | None,
        colours: UInt8[np.ndarray, "n 3"] | None,
    ) -> None:
        """Add the points of one view.

        Args:
            upright: World frame, z above the floor, m.
            is_obstacle: Whether each is of an obstacle; the others are floor.
            is_moving: Whether each belongs to an obstacle that moves; those are left out.
            sigma_m: Standard deviation of each along its ray.
            sensor: Position of the camera, world frame, m.
            pose: (x, y, yaw) of the body with its covariance; None: without doubt.
            colours: RGB of each; None without a colour camera.
        """
        flat = upright * [1.0, 1.0, 0.0]
        self._occupied_cells.add(flat[is_obstacle])
        self._floor_cells.add(flat[~is_obstacle])
        still = is_obstacle & ~is_moving
        points = upright[still]
        values = np.zeros((len(points), 4))
        values[:, :2] = sensor[:2]
        if pose is not None:
            P = pose.covariance
            away = points[:, :2] - pose.mean[:2]
            values[:, 2] = 0.5 * (P[0, 0] + P[1, 1]) + P[2, 2] * (away**2).sum(axis=1)
        values[:, 3] = sigma_m[still] ** 2
        self._obstacles.add(points, None if colours is None else colours[still], values)

    def footprints(self, world: WorldMap, config: FootprintConfig) -> list[Footprint]:
        """Footprints of the obstacles that the map shows, none over a cell that it shows free."""
        xyz, colours = self._obstacles.cloud()
        probability = world.probability
        if not len(xyz) or not probability.size:
            return []
        rows, columns = world.cell_of(xyz[:, :2]).T
        inside = (rows >= 0) & (columns >= 0)
        inside &= (rows < probability.shape[0]) & (columns < probability.shape[1])
        occupancy = np.zeros(len(xyz))
        occupancy[inside] = probability[rows[inside], columns[inside]]
        values = self._obstacles.values
        voxels = Voxels(
            xyz,
            self._obstacles.sightings.astype(np.float64),
            self._stay(xyz),
            values[:, :2],
            values[:, 2],
            values[:, 3],
            np.full((len(xyz), 3), np.nan) if colours is None else colours.astype(np.float64),
            occupancy,
        )
        free = FreeCells(world.known & (probability < FREE_BELOW), world.origin, world.cell_m)
        return footprints.find(voxels.of(occupancy > OCCUPIED), config, free)

    def _stay(self, xyz: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
        """Share of the frames that saw the cell of each voxel in which an obstacle was there."""
        layers = (self._occupied_cells, self._floor_cells)
        places = [xyz[:, :2], *(layer.cloud()[0][:, :2] for layer in layers)]
        lattice = np.floor(np.concatenate(places) / self._cell_m + 1e-9).astype(np.int64)
        _, cell = np.unique(lattice, axis=0, return_inverse=True)
        own, occupied, free = np.split(cell.reshape(-1), np.cumsum([len(p) for p in places])[:2])
        frames = np.zeros((2, int(cell.max()) + 1))
        for count, where, layer in zip(frames, (occupied, free), layers, strict=True):
            count[where] = layer.sightings
        share = frames[0] / np.maximum(frames.sum(axis=0), 1.0)
        return np.asarray(share[own])
