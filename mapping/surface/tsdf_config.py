"""Settings and protocol of the surface maps."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import UInt8

from perception.primitives.errors import ConfigError, InputError
from perception.primitives.frame import Depth
from perception.primitives.pose import Pose3
from perception.primitives.settings import setting

from .meshes import Mesh

METHODS = ("compiled", "open3d")
NEAREST_M = 0.2  # ours: depth cameras are wrong at shorter range
FINEST_M = 0.002  # ours: of a voxel, as --voxel; a finer grid only fills the memory


@dataclass(frozen=True)
class TsdfConfig:
    """Method, resolution and range of the surface map."""

    method: str = setting(
        "compiled", "", 'implementation: "compiled" or "open3d"', "ours: weighs by depth variance"
    )
    voxel_m: float = setting(0.02, "m", "side of a voxel of the surface map", "ours: benchmark")
    band_voxels: float = (
        4.0  # KinectFusion: noise at 4 m; truncation distance of the signed distance
    )
    farthest_m: float = setting(
        5.0, "m", "depth beyond which pixels are ignored", "ours: sigma exceeds the band there"
    )

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise ConfigError(
                f"tsdf: method={self.method!r} is unknown; choose {', '.join(METHODS)}"
            )
        for name in ("voxel_m", "band_voxels", "farthest_m"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"tsdf: {name}={value} must be positive and finite")
        if self.voxel_m < FINEST_M:
            raise ConfigError(f"tsdf: voxel_m={self.voxel_m} must be at least {FINEST_M} m")
        if not self.farthest_m > NEAREST_M:
            raise ConfigError(f"tsdf: farthest_m={self.farthest_m} must exceed {NEAREST_M} m")

    @property
    def band_m(self) -> float:
        """Truncation distance on either side of the surface."""
        return self.band_voxels * self.voxel_m


@runtime_checkable
class SurfaceMap(Protocol):
    """A map that fuses depth images into a surface."""

    def integrate(
        self, depth: Depth, T_map_camera: Pose3, rgb: UInt8[np.ndarray, "h w 3"] | None = None
    ) -> None:
        """Fuse one image."""
        ...

    def mesh(self) -> Mesh:
        """The current surface, map frame."""
        ...


def check(depth: Depth, rgb: np.ndarray | None) -> None:
    """Raise InputError if depth, intrinsics and colours do not fit, or the lens is distorted."""
    camera = depth.camera
    if depth.z.shape != (camera.height, camera.width):
        raise InputError(
            f"tsdf: depth is {depth.z.shape}, its camera has {(camera.height, camera.width)}; "
            "check the intrinsics"
        )
    if camera.is_distorted:
        raise InputError("tsdf: the lens is distorted; undistort the images first")
    if rgb is not None and rgb.shape[:2] != depth.z.shape:
        raise InputError(
            f"tsdf: colour image of {rgb.shape[:2]} for a depth image of {depth.z.shape}; register it first"
        )
