"""The surface of a place, fused from depth images: truncated signed distances in blocks of voxels.

Blocks exist only near surfaces, so memory grows with what was seen, not with the time looked at it. The
surface is drawn through the voxels by surface nets, each vertex then put onto the zero of the distance.

Source: Curless and Levoy 1996; Nießner et al. 2013 (blocks in a hash table); Gibson 1998 (surface nets).
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, UInt8

from perception.primitives.frame import Depth
from perception.primitives.pose import Pose3

from . import _tsdf_kernels as kernels
from .meshes import Mesh
from .tsdf_config import NO_PICTURE, TsdfConfig, _intrinsics, check


class Tsdf:
    """Our own surface map."""

    def __init__(self, config: TsdfConfig | None = None) -> None:
        self.config = config or TsdfConfig()
        self._count = 0
        self._images = 0
        self._coloured = False
        self._places = np.zeros((0, 3), np.int32)
        self._stamps = np.zeros(0, np.int64)
        self._voxels = np.zeros((0, kernels.CELLS, 2), np.float32)
        self._colours = np.zeros((0, kernels.CELLS, 3), np.uint16)
        self._allocate(1024)

    @property
    def blocks(self) -> int:
        """How many blocks of 8x8x8 voxels exist."""
        return self._count

    def integrate(
        self, depth: Depth, T_map_camera: Pose3, rgb: UInt8[np.ndarray, "h w 3"] | None = None
    ) -> None:
        """Take in one image; work grows with the surface in view, not with the map.

        Args:
            depth: Image with its deviation; pixels without depth say nothing.
            T_map_camera: Where the camera was.
            rgb: Picture registered to the depth, red first.

        Raises:
            InputError: The picture does not fit, or the lens is distorted.
        """
        camera = depth.camera
        check(depth, rgb)
        c = self.config
        T = T_map_camera.matrix
        x, y = camera.single_slopes
        block_m = kernels.SIDE * c.voxel_m
        stride = max(1, int(c.stride_blocks * block_m * camera.fx / self._typical(depth)))
        visible = self._touch(depth.z, x[0], y[:, 0], T, stride)
        picture = NO_PICTURE
        if rgb is not None:
            self._colour()
            picture = rgb
        kernels.integrate(
            depth.z, depth.sigma, picture, _intrinsics(camera), T_map_camera.inverse().matrix,
            c.farthest_m, c.band_m, c.voxel_m, 0.002, c.most_weight,
            self._places, visible, self._voxels, self._colours,
        )  # fmt: skip
        self._images += 1

    def mesh(self) -> Mesh:
        """The surface so far, map frame; empty if nothing was seen well enough."""
        ids = np.empty((self._count, kernels.CELLS), np.int32)
        none = np.empty((0, 3), np.float32)
        parts = (
            self._keys, self._values, self._voxels, self._colours, self._places, self._count,
            self.config.least_weight, self.config.voxel_m, ids,
        )  # fmt: skip
        count = kernels.corners(*parts, none, none, np.empty((0, 3), np.uint8))
        vertices, normals = np.empty((2, count, 3), np.float32)
        tints = np.empty((count, 3), np.uint8)
        kernels.corners(*parts, vertices, normals, tints)
        table = (self._keys, self._values, self._voxels, self._places, self._count, ids)
        size = kernels.faces(*table, np.empty((0, 3), np.int32))
        triangles = np.empty((size, 3), np.int32)
        kernels.faces(*table, triangles)
        return Mesh(vertices, triangles, normals, tints if self._coloured else None)

    def cloud(self) -> tuple[Float32[np.ndarray, "n 3"], UInt8[np.ndarray, "n 3"] | None]:
        """Points of the surface, about one a voxel, m, and their colours."""
        mesh = self.mesh()
        return mesh.vertices, mesh.colours

    def _touch(
        self, z: np.ndarray, x: np.ndarray, y: np.ndarray, T: np.ndarray, stride: int
    ) -> np.ndarray:
        """Numbers of the blocks that this image speaks of, made where missing."""
        c = self.config
        while True:
            visible = np.empty(len(self._places), np.int64)
            self._count, seen = kernels.touch(
                z, x, y, T, c.nearest_m, c.farthest_m, c.band_m, kernels.SIDE * c.voxel_m, stride,
                self._keys, self._values, self._places, self._stamps, self._images, self._count,
                visible,
            )  # fmt: skip
            if seen >= 0:
                return visible[:seen]
            self._stamps[:] = -1
            self._allocate(2 * len(self._places))

    @staticmethod
    def _typical(depth: Depth) -> float:
        """A depth that few pixels exceed, m, from a few of them."""
        few = depth.z[::16, ::16]
        few = few[np.isfinite(few)]
        return float(np.quantile(few, 0.9)) if few.size else 1.0

    def _allocate(self, capacity: int) -> None:
        """Room for so many blocks; what there is stays."""
        places = np.zeros((capacity, 3), np.int32)
        stamps = np.full(capacity, -1, np.int64)
        voxels = np.zeros((capacity, kernels.CELLS, 2), np.float32)
        colours = np.zeros((capacity if self._coloured else 0, kernels.CELLS, 3), np.uint16)
        n = self._count
        places[:n], stamps[:n] = self._places[:n], self._stamps[:n]
        voxels[:n] = self._voxels[:n]
        if len(self._colours):
            colours[:n] = self._colours[:n]
        self._places, self._stamps, self._voxels, self._colours = places, stamps, voxels, colours
        self._keys = np.full(4 * capacity, kernels.EMPTY, np.int64)
        self._values = np.full(4 * capacity, -1, np.int32)
        kernels.rehash(places, n, self._keys, self._values)

    def _colour(self) -> None:
        """Room for colours, from the first picture on."""
        if not self._coloured:
            self._coloured = True
            self._colours = np.zeros((len(self._places), kernels.CELLS, 3), np.uint16)
