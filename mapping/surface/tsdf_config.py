"""Settings and protocol of surface maps."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, UInt8

from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError, InputError
from perception.primitives.frame import Depth
from perception.primitives.pose import Pose3

from .meshes import Mesh

METHODS = ("compiled", "open3d")


NO_PICTURE = np.zeros((1, 1, 3), np.uint8)


@dataclass(frozen=True)
class TsdfConfig:
    """Grain and reach of the surface map."""

    method: str = "compiled"  # or "open3d": its VoxelBlockGrid
    voxel_m: float = 0.02  # spec of the benchmark
    band_voxels: float = 4.0  # KinectFusion and after: wide enough for the noise at 4 m
    nearest_m: float = 0.2  # ours: nearer, cameras see nothing right
    farthest_m: float = 5.0  # ours: beyond, a deviation is wider than the band
    least_weight: float = 0.006  # ours: one look of a structured-light camera from 4 m
    most_weight: float = 1000.0  # ours: what has been seen so well still learns
    stride_blocks: float = 0.3  # ours: pixels so far apart, in blocks, make blocks

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise ConfigError(f"tsdf: method={self.method!r} is unknown; choose one of {METHODS}")
        for name in (
            "voxel_m", "band_voxels", "nearest_m", "least_weight", "most_weight", "stride_blocks",
        ):  # fmt: skip
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"tsdf: {name}={value} must be positive and finite")
        if not self.nearest_m < self.farthest_m:
            raise ConfigError(
                f"tsdf: farthest_m={self.farthest_m} must exceed nearest_m={self.nearest_m}"
            )

    @property
    def band_m(self) -> float:
        """Distances are kept up to here on either side of the surface."""
        return self.band_voxels * self.voxel_m


@runtime_checkable
class SurfaceMap(Protocol):
    """What fuses depth images into a surface."""

    def integrate(
        self, depth: Depth, T_map_camera: Pose3, rgb: UInt8[np.ndarray, "h w 3"] | None = None
    ) -> None:
        """Take in one image."""
        ...

    def mesh(self) -> Mesh:
        """The surface so far, map frame."""
        ...


def check(depth: Depth, rgb: np.ndarray | None) -> None:
    """Refuse images that do not belong together."""
    camera = depth.camera
    if depth.z.shape != (camera.height, camera.width):
        raise InputError(
            f"tsdf: depth is {depth.z.shape}, its camera says {(camera.height, camera.width)}; "
            "check the intrinsics"
        )
    if camera.is_distorted:
        raise InputError("tsdf: the lens is distorted; rectify the images first")
    if rgb is not None and rgb.shape[:2] != depth.z.shape:
        raise InputError(
            f"tsdf: picture of {rgb.shape[:2]} for a depth image of {depth.z.shape}; register it first"
        )


def _intrinsics(camera: Camera) -> Float[np.ndarray, "4"]:
    return np.array([camera.fx, camera.fy, camera.cx, camera.cy])
